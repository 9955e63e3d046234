"""The motion that registers two point sets, and its covariance."""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from d2d import _kernel, rigid
from d2d._checks import Array, count, finite, instance, positive, scalar, schedule
from d2d.cost import Problems, RegistrationCost, check_types, evaluate
from d2d.measurement import LinearMeasurement
from d2d.point_set import PointSet

TOLERANCE = 1e-14  # of the Newton decrement: 1e-7 standard deviations from the optimum
MOST_ITERATIONS = 200
_MOST_STARTS = 10_000_000  # of a grid: 240 MB

# Standard deviations inflated tenfold and stepped down: a start at zero then finds the truth in
# nearly all of the study's scenes.
ANNEALED = (10.0, 5.5, 3.2, 1.7, 1.0)


@dataclass(frozen=True, eq=False)
class Estimate:
    """The optimum of a registration cost, or a batch of optima.

    Attributes
    ----------
    theta : (..., P) array
        Motion parameters: [t_x] or [t_x, t_y, phi_z] in m, m, rad.
    covariance : (..., P, P) array
        Inverse Hessian; nan where not ``converged``.
    value, gradient, hessian : (...), (..., P), (..., P, P) arrays
        Of the cost at ``theta``.
    converged : (...) array of bool
        Whether ``theta`` is a local optimum: positive definite Hessian, vanishing Newton step.
        It may be a wrong one, see `register`.
    iterations : (...) array of int
        Newton steps tried, over all scales.
    """

    theta: Array
    covariance: Array
    value: Array
    gradient: Array
    hessian: Array
    converged: NDArray[np.bool_]
    iterations: NDArray[np.int64]


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

    Newton's method with exact derivatives in a trust region (Moré & Sorensen 1983), one problem
    or a whole batch in one call.

    Parameters
    ----------
    fixed, moving : PointSet
        Their batch axes broadcast with those of ``initial``.
    cost : RegistrationCost, optional
        D2D likelihood without an outlier component unless given.
    initial : (..., P) array, optional
        Where to start; zeros unless given.
    scales : sequence of positive numbers
        All standard deviations are multiplied by each in turn, each optimum starting the next
        (Jian & Vemuri 2011).  The last one is the scale of the result, usually 1.  Use a long
        schedule such as `ANNEALED` or none: one that begins at 4, say, can lead astray from where
        a plain start succeeds.
    measurement : LinearMeasurement, optional
        Of each moving target, multiplied into its inlier density.
    threads : int
        Number of threads that share a batch; the result does not depend on it.

    Returns
    -------
    Estimate
        Never of a higher cost than ``initial`` has at the last scale.

    Raises
    ------
    ValueError
        Naming the argument that does not fit.

    Notes
    -----
    ``converged`` says that ``theta`` is an optimum near the start, not that it is the right one: a
    cost has several.  From a start far off take ``scales=ANNEALED`` or `multi_start`, an outlier
    model where targets may lack a counterpart, and look at the optimum's
    `RegistrationCost.inlier_probabilities`: low ones throughout tell a wrong one.

    Examples
    --------
    >>> import numpy as np
    >>> from d2d import PointSet, register, rigid
    >>> fixed = PointSet([[8.0, 1.0], [5.0, -3.0], [6.0, 4.0]], [0.04 * np.eye(2)] * 3)
    >>> moving = fixed.transformed(rigid.inverse([0.5, -0.2, 0.1]))
    >>> estimate = register(fixed, moving)
    >>> bool(estimate.converged), estimate.theta.round(3).tolist()
    (True, [0.5, -0.2, 0.1])
    >>> np.sqrt(np.diag(estimate.covariance)).round(2).tolist()  # standard deviations
    [0.17, 0.35, 0.05]
    """
    cost = RegistrationCost() if cost is None else cost
    instance("cost", cost, RegistrationCost)
    steps = schedule("scales", scales)
    count("threads", threads)
    if initial is None:
        check_types(fixed, moving, measurement)
        initial = np.zeros(rigid.PARAMETERS[fixed.dimension])
    theta, iterations = initial, np.zeros((), dtype=np.int64)
    for scale in steps:
        problems = _inflated_problems(cost, theta, fixed, moving, measurement, scale)
        optimum = _minimise(problems, threads)
        iterations = np.asarray(iterations + optimum.iterations)
        theta = optimum.theta
    optimum = replace(optimum, iterations=iterations)
    if len(steps) > 1:
        problems = _inflated_problems(cost, initial, fixed, moving, measurement, steps[-1])
        optimum = _no_worse_than_start(optimum, problems, threads)
    return optimum


def multi_start(
    fixed: PointSet,
    moving: PointSet,
    cost: RegistrationCost | None,
    starts: ArrayLike,
    scales: Sequence[float] = (1.0,),
    *,
    measurement: LinearMeasurement | None = None,
    threads: int = 1,
) -> Estimate:
    """The best of the optima that are found from several starts, all in one batch.

    Parameters
    ----------
    starts : (S, P) array
        Tried for each problem of the batch, see `start_grid`.
    fixed, moving, cost, scales, measurement, threads
        As for `register`.

    Returns
    -------
    Estimate
        Of each problem the converged optimum of the lowest cost, with the iterations of all its
        starts together; where none converged, what the first start came to, not converged.

    Raises
    ------
    ValueError
        Naming the argument that does not fit.
    """
    check_types(fixed, moving, measurement)
    tried = rigid.motion("starts", starts, fixed.dimension)
    if tried.ndim != 2 or not len(tried):
        raise ValueError(f"starts must have the shape (S, P), but has {tried.shape}")
    batches = [fixed.batch_shape, moving.batch_shape]
    batches.append(() if measurement is None else measurement.batch_shape)
    axes = max(map(len, batches))
    spread = tried.reshape(len(tried), *(1,) * axes, tried.shape[-1])
    found = register(fixed, moving, cost, spread, scales, measurement=measurement, threads=threads)
    best = np.argmin(np.where(found.converged, found.value, np.inf), axis=0)[np.newaxis]

    def pick(array: NDArray[Any]) -> Any:
        index = best.reshape(best.shape + (1,) * (array.ndim - best.ndim))
        return np.asarray(np.take_along_axis(array, index, axis=0)[0])

    picked = Estimate(**{f.name: pick(getattr(found, f.name)) for f in fields(Estimate)})
    return replace(picked, iterations=np.asarray(found.iterations.sum(axis=0)))


def start_grid(reach: float, spacing: float, angles: ArrayLike) -> Array:
    """Starts (S, 3) on a square grid of translations, each with every rotation.

    Parameters
    ----------
    reach, spacing : float, m
        The grid extends from -reach to reach along x and y, in steps of at most ``spacing``.
    angles : (A,) array, rad

    Raises
    ------
    ValueError
        Naming the argument that is not positive or of another shape; also if there would be more
        than ten million starts.
    """
    span = positive("reach", scalar("reach", reach))
    step = positive("spacing", scalar("spacing", spacing))
    turns = finite("angles", angles)
    if turns.ndim != 1 or not turns.size:
        raise ValueError(f"angles must have the shape (A,), but has {turns.shape}")
    side = 2.0 * np.ceil(span / step) + 1.0
    if side > math.sqrt(_MOST_STARTS / turns.size):
        raise ValueError(
            f"spacing must be longer: {step:g} m within a reach of {span:g} m and {turns.size} "
            f"angles make more than {_MOST_STARTS} starts"
        )
    line = np.linspace(-span, span, int(side))
    grid = np.meshgrid(line, line, turns, indexing="ij")
    return np.stack([axis.ravel() for axis in grid], axis=-1)


def _inflated_problems(
    cost: RegistrationCost,
    theta: ArrayLike,
    fixed: PointSet,
    moving: PointSet,
    measurement: LinearMeasurement | None,
    scale: float,
) -> Problems:
    if scale == 1.0:
        return cost.bind(theta, fixed, moving, measurement, name="initial")
    check_types(fixed, moving, measurement)
    inflated = None if measurement is None else measurement.inflated(scale)
    sets = (fixed.inflated(scale), moving.inflated(scale))
    return cost.bind(theta, *sets, inflated, name="initial")


def _minimise(problems: Problems, threads: int) -> Estimate:
    count, p, shape = len(problems.thetas), problems.parameters, problems.shape
    thetas = problems.thetas.copy()
    value, gradient, hessian = np.empty(count), np.empty((count, 3)), np.empty((count, 3, 3))
    covariance = np.full((count, 3, 3), np.nan)
    converged, iterations = np.empty(count, dtype=np.bool_), np.empty(count, dtype=np.int64)

    def run(part: slice) -> None:
        _kernel.minimise_batch(
            thetas[part],
            *problems.sets,
            problems.which[part],
            problems.d2d,
            problems.planar,
            problems.fusion,
            problems.outlier,
            problems.measurements,
            problems.in_twist,
            TOLERANCE,
            MOST_ITERATIONS,
            value[part],
            gradient[part],
            hessian[part],
            covariance[part],
            converged[part],
            iterations[part],
        )

    if threads == 1 or count == 1:
        run(slice(None))
    else:
        # the kernel releases the GIL; four parts a thread even out problems of unequal length
        edges = np.linspace(0, count, min(count, 4 * threads) + 1).astype(int)
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(run, map(slice, edges[:-1], edges[1:])))

    return Estimate(
        theta=thetas[:, :p].reshape(*shape, p),
        covariance=covariance[:, :p, :p].reshape(*shape, p, p),
        value=value.reshape(shape),
        gradient=gradient[:, :p].reshape(*shape, p),
        hessian=hessian[:, :p, :p].reshape(*shape, p, p),
        converged=converged.reshape(shape),
        iterations=iterations.reshape(shape),
    )


def _no_worse_than_start(optimum: Estimate, problems: Problems, threads: int) -> Estimate:
    """Where the detour over the scales ended above the start's own cost, descend from the start."""
    worse = (optimum.value > evaluate(problems)[0].reshape(problems.shape)).ravel()
    if not worse.any():
        return optimum
    again = problems._replace(
        thetas=problems.thetas[worse], which=problems.which[worse], shape=(int(worse.sum()),)
    )
    direct = _minimise(again, threads)
    merged = {}
    for field in fields(Estimate):
        array = getattr(optimum, field.name).copy()
        flat = array.reshape(worse.size, *array.shape[len(problems.shape) :])  # a view
        flat[worse] = getattr(direct, field.name) + (
            flat[worse] if field.name == "iterations" else 0
        )
        merged[field.name] = array
    return Estimate(**merged)
