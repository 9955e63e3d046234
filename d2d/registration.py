"""The motion that registers two point sets, and its covariance."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from d2d import rigid
from d2d._checks import (
    ANGLE,
    check_count,
    check_instance,
    check_positive_scalar,
    check_schedule,
    check_shape,
)
from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.measurement import LinearMeasurement
from d2d.point_set import PointSet
from d2d.problem import Estimate, Problem, check_pair, where

_MAX_STARTS = 10_000_000  # in a grid: 240 MB
_TURNS = np.deg2rad(np.arange(-150.0, 181.0, 30.0))

# Standard deviations are first inflated tenfold, then reduced in steps.  A start at zero then finds
# the truth in nearly all of the study's scenes.
ANNEALED = (10.0, 5.5, 3.2, 1.7, 1.0)
# With targets more than _UNLIKE times as precise as the median, a schedule also begins that much
# wider, in steps as long as those of `ANNEALED`.
_UNLIKE, _STEP = 10.0, 1.8
# Where points lie closer together than their errors, as those of a wall, the lower cost is often
# that of dense places upon dense places.  A schedule's optimum then also has to fit a fifth better:
# chosen on two logs of lidars, confirmed on three; 0.7 and 0.9 do nearly as well.
_BETTER_FIT = 0.8


def register(
    fixed: PointSet,
    moving: PointSet,
    cost: RegistrationCost | None = None,
    initial: ArrayLike | None = None,
    scales: Sequence[float] = (1.0,),
    *,
    measurement: LinearMeasurement | None = None,
    threads: int = 1,
) -> Estimate:
    """Minimise the cost over the rigid motion that maps ``moving`` onto ``fixed``.

    Newton's method with exact derivatives in a trust region (Moré & Sorensen 1983) solves a single
    problem or a whole batch in one call.

    The result's cost is not above that of ``initial`` at the last scale; with more than 64 fixed
    targets, where the first steps are rough, hardly ever.

    Parameters
    ----------
    fixed, moving : PointSet
        Their batch axes broadcast with those of ``initial``.
    cost : RegistrationCost, optional
        By default, the D2D likelihood without an outlier component.
    initial : (..., P) array, optional
        Start or starts, with angles in rad within −2π and 2π; zeros by default.
    scales : sequence of positive numbers
        All standard deviations are multiplied by each scale in turn, and each optimum is the start
        of the next (Jian & Vemuri 2011).  The last, usually 1, is that of the result, whose cost is
        never higher than without the schedule; that alone takes a sixth of the time.  With an
        outlier model and points closer together than their errors, as in a lidar scan, the optimum
        without the schedule is left only for one whose ``fit`` is also a fifth lower.
    measurement : LinearMeasurement, optional
        A measurement of each moving target, whose density multiplies the inlier density.
    threads : int
        Number of threads that share a batch; the result does not depend on it.

    Notes
    -----
    ``converged`` means that ``theta`` is an optimum near the start, not that it is the right one: a
    cost has several.  If the start is far off, use ``scales=ANNEALED`` or `multi_start`, and if
    targets may lack a counterpart, an outlier model; low ``inliers`` and a ``fit`` above its region
    then reveal a wrong optimum.  Where less than half of the targets have a counterpart, as where
    two views overlap in part, `UniformOutlier` leaves an optimum the wider basin.

    All covariances take both sets for measurements of *the same physical points*.  Points of a wall
    that are sampled anew in each view are not: along it the errors are far larger than stated.

    A set whose mean is a thousand times as far from the origin as its targets lie apart, as in map
    coordinates, is taken about its mean for the computation, unless there is a measurement.  All
    arguments and results are in the coordinates of the sets.

    Examples
    --------
    >>> import numpy as np
    >>> from d2d import PointSet, register, rigid
    >>> fixed = PointSet([[8, 1], [5, -3], [6, 4]], [0.04 * np.eye(2)] * 3)
    >>> moving = fixed.transformed(rigid.inverse([0.5, -0.2, 0.1]))
    >>> estimate = register(fixed, moving)
    >>> bool(estimate.converged), estimate.theta.round(3).tolist()
    (True, [0.5, -0.2, 0.1])
    >>> np.sqrt(np.diag(estimate.covariance)).round(2).tolist()  # sigmas
    [0.17, 0.35, 0.05]
    """
    cost = RegistrationCost() if cost is None else cost
    check_instance("cost", cost, RegistrationCost)
    steps = check_schedule("scales", scales)
    check_count("threads", threads)
    problem = cost.problem(fixed, moving, measurement)
    start = np.zeros(problem.parameters)
    if initial is not None:
        start = rigid.start("initial", initial, fixed.dimension)
        if _is_matrix(start) and not any(problem.pairs[0].batch_shapes):
            raise ValueError(
                "initial must be parameters [t_x, t_y, phi_z] in m, m, rad, but is the matrix of a "
                "motion, which would be taken for three starts"
            )
    best = anneal(problem, start, steps[-1:], threads)
    if len(steps) == 1:
        return best
    best = _lower(best, anneal(problem, start, steps, threads), fixed)
    spread = _spread(fixed, moving)
    if spread > _UNLIKE:
        wider = np.geomspace(spread, 1.0, 1 + math.ceil(math.log(spread) / math.log(_STEP)))
        schedule = [*(steps[0] * wider[:-1]), *steps]
        best = _lower(best, anneal(problem, start, schedule, threads), fixed)
    return best


def _is_matrix(start: Array) -> bool:
    """Whether three starts are the homogeneous matrix of a motion of the plane."""
    return (
        start.shape == (3, 3)
        and np.array_equal(start[2], [0.0, 0.0, 1.0])
        and np.allclose(start[:2, :2] @ start[:2, :2].T, np.eye(2))
    )


def multi_start(
    fixed: PointSet,
    moving: PointSet,
    cost: RegistrationCost | None = None,
    starts: ArrayLike | None = None,
    scales: Sequence[float] = (1.0,),
    *,
    measurement: LinearMeasurement | None = None,
    threads: int = 1,
) -> Estimate:
    """The best of the optima from several starts, all in one batch.

    For each problem of the batch, the ``starts`` (S, P) are tried, see `start_grid`: each turns the
    moving set about its middle, the mean of its targets, then shifts it.  By default, 108 starts
    turn it by every 30 degrees and shift it by up to a quarter of its size.  The other arguments
    are those of `register`.  The result is the converged optimum of lowest cost, or, if there is
    none, that of the first start; ``iterations`` counts those of all starts.
    """
    pair = check_pair(fixed, moving, measurement)
    if starts is None:
        reach = 0.25 * float(np.ptp(moving.means, axis=-2).max(initial=0.0)) or 1.0
        starts = start_grid(reach, reach, _TURNS)[:, : rigid.PARAMETERS[fixed.dimension]]
    tried = rigid.start("starts", starts, fixed.dimension)
    check_shape("starts", tried, "(S, P)", empty=False)
    axes = max(map(len, pair.batch_shapes))
    spread = tried.reshape(len(tried), *(1,) * axes, tried.shape[-1])
    if fixed.dimension == 2:
        spread = rigid.about(moving.means.mean(axis=-2), spread)
    optima = register(fixed, moving, cost, spread, scales, measurement=measurement, threads=threads)
    return best_of(optima)


def best_of(optima: Estimate) -> Estimate:
    """The converged estimate of lowest cost among several starts, which are the first axis.

    Its iterations are the total over all starts.  Where none converged, it is the first.
    """
    best = np.argmin(np.where(optima.converged, optima.value, np.inf), axis=0)
    index = (best, *np.indices(best.shape))
    picked = {name: np.asarray(values[index]) for name, values in vars(optima).items()}
    return Estimate(**picked | {"iterations": np.asarray(optima.iterations.sum(axis=0))})


def start_grid(reach: float, spacing: float, angles: ArrayLike = (0.0,)) -> Array:
    """Starts (S, 3) for `multi_start`: a square grid of translations, each with every rotation.

    The grid extends from -reach to reach along x and y, in steps of at most ``spacing``, both in m;
    the ``angles`` (A,) in rad are within −2π and 2π.  Raises a ``ValueError`` if there would be
    more than ten million starts.
    """
    span = check_positive_scalar("reach", reach)
    step = check_positive_scalar("spacing", spacing)
    turns = ANGLE.array("angles", angles)
    check_shape("angles", turns, "(A,)", empty=False)
    side = 2.0 * np.ceil(span / step) + 1.0
    if side > math.sqrt(_MAX_STARTS / turns.size):
        raise ValueError(
            f"spacing must be larger: a spacing of {step:g} m from {-span:g} to {span:g} m and "
            f"{turns.size} angles make more than {_MAX_STARTS} starts"
        )
    line = np.linspace(-span, span, int(side))
    grid = np.meshgrid(line, line, turns, indexing="ij")
    return np.stack([axis.ravel() for axis in grid], axis=-1)


def anneal(
    problem: Problem, start: Array, scales: Sequence[float] = (1.0,), threads: int = 1
) -> Estimate:
    """Minimise a problem from parameters (..., P), its standard deviations inflated by each scale.

    Each optimum starts the next.  Where the last one is worse than the start, the last scale alone
    is used.
    """
    theta, iterations = start, np.asarray(0)
    for scale in scales:
        inflated = problem.inflated(scale)
        optimum = inflated.minimise(inflated.bind(theta, "initial"), threads)
        theta, iterations = optimum.theta, iterations + optimum.iterations
    if len(scales) == 1:
        return optimum
    optimum = replace(optimum, iterations=np.asarray(iterations))
    worse = ~(optimum.value <= inflated.derivatives(inflated.bind(start))[0])
    if worse.any():
        direct = anneal(problem, start, scales[-1:], threads)
        total = np.asarray(iterations + direct.iterations)
        optimum = where(worse, replace(direct, iterations=total), optimum)
    return optimum


def _spread(*sets: PointSet) -> float:
    """Ratio of the median standard deviation of a set's targets to that of the most precise one."""
    variances = [np.diagonal(each.covariances, axis1=-2, axis2=-1).max(axis=-1) for each in sets]
    ratios = [np.median(each, axis=-1) / each.min(axis=-1) for each in variances]
    return math.sqrt(max(float(ratio.max(initial=1.0)) for ratio in ratios))


def _overlap(points: PointSet) -> NDArray[np.bool_]:
    """Whether the others at least double the density at most of a set's points."""
    at_rest = np.zeros(rigid.PARAMETERS[points.dimension])
    densities = RegistrationCost().target_densities(at_rest, points, points)
    own = points.weights / np.sqrt(np.linalg.det(4.0 * np.pi * points.covariances))
    return np.asarray(np.median(densities / own, axis=-1) > 2.0)


def _lower(one: Estimate, other: Estimate, fixed: PointSet) -> Estimate:
    """The other optima where they are lower and, of points that overlap, fit clearly better."""
    lower = np.asarray((other.value < one.value) | ~np.isfinite(one.value))
    better = other.fit < _BETTER_FIT * np.nan_to_num(one.fit, nan=np.inf)
    better |= np.isnan(other.inliers)  # no outlier model: all squared distances are in the cost
    if not (better | ~lower).all():
        better = better | ~_overlap(fixed)
    merged = where(lower & better, other, one)
    return replace(merged, iterations=one.iterations + other.iterations)
