"""How far the targets of extended objects scatter, by maximum likelihood from the scans alone."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Unpack

import numpy as np
import scipy

from d2d._checks import check_count, check_instance, check_members
from d2d._types import Array
from d2d.bootstrap import block_length
from d2d.problem import Problem
from d2d.radar.motion.doppler import doppler_starts
from d2d.radar.motion.estimate import estimate_velocity
from d2d.radar.motion.model import EgoMotionModel, ModelOptions
from d2d.radar.motion.pairs import scan_pair
from d2d.radar.scans.scan import Mounting, RadarScan
from d2d.radar.tracks.rounds import MAX_INTERVAL, increasing

# m; the likelihood is computed at each, the maximum is looked for between neighbours
CANDIDATES = np.array([0.0, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2])
_MIDDLE = 0.4  # m; the velocities found with it are where all others are looked for
_TOLERANCE = 1e-3  # m
_STEP = 0.1  # of the variance, over which the score's slope is taken
_SHORTEST_BLOCK = 4  # pairs
_SMALL = 0.03  # m; that at an extent of zero is taken up to here


@dataclass(frozen=True, eq=False)
class ExtentEstimate:
    """The extent of a recording's targets, see `estimate_extent`.

    Attributes
    ----------
    extent : float, m
        Standard deviation along each axis; 0 if the likelihood falls from there on.
    sigma : float, m
        Its standard error, from the scatter of the pairs' scores; nan if there is none.
    sigma_independent : float, m
        Its standard error if all targets were independent and the model true, from the curvature of
        the likelihood.  It is the smaller one as a rule.
    pairs, targets : int
        Number of pairs of scans, and of targets in their current scans, that were used.
    candidates : (G,) array, m
        Extents at which the likelihood was computed, ascending from 0, ``extent`` among them.
    log_likelihoods : (G,) array
        Log-likelihood per target at each of them, every pair at its own best velocity.
    """

    extent: float
    sigma: float
    sigma_independent: float
    pairs: int
    targets: int
    candidates: Array
    log_likelihoods: Array

    def __repr__(self) -> str:
        """The extent with its standard error."""
        return (
            f"ExtentEstimate({self.extent:.3f} m, standard error {self.sigma:.3f} m, "
            f"{self.pairs} pairs of scans, {self.targets} targets)"
        )


def estimate_extent(
    scans: Iterable[RadarScan],
    mounting: Mounting,
    *,
    baseline: int = 1,
    max_pairs: int | None = 50,
    max_interval: float = MAX_INTERVAL,
    **options: Unpack[ModelOptions],
) -> ExtentEstimate:
    """Extent of a sensor's targets, for `RadarScan.extent`, by maximum likelihood.

    It is the one extent of all targets at which the pairs of scans, each registered with it, are
    most likely together.  No reference is needed.  The scans' own ``extent`` is not used.

    Parameters
    ----------
    scans : iterable of RadarScan
        Scans of one sensor, in strictly increasing time.
    mounting : Mounting
    baseline : int
        Number of scans between the two of a pair, as for `track`.
    max_pairs : int or None
        Largest number of pairs used, spread evenly over the recording; None uses all.
    max_interval : float, s
        Longest time between two scans; see `track`.
    **options
        ``doppler``, ``outlier``, ``doppler_width`` and ``first_order``, as for
        `estimate_ego_motion`.

    Returns
    -------
    ExtentEstimate

    Raises
    ------
    ValueError
        If fewer than two pairs have targets in both scans, the likelihood still grows at the
        largest candidate (3.2 m), or an argument is invalid; the message names the argument.

    Notes
    -----
    With the extent e, the density of a target about a component of the other scan has the
    covariance S = S_0 + 2 e^2 I.  By the heat equation, the derivative of a target's log-likelihood
    in e^2 is its inlier probability times the Laplacian of its inlier density over that density,
    and at a pair's best velocity nothing else changes (envelope theorem).  The maximum is where the
    sum of these scores vanishes between two candidates.

    The standard error is that of an estimate by a cost whose terms are not independent (sandwich):
    with the pairs' scores s_p and their sum's derivative -H in e^2, sqrt(var(sum s_p)) / H for e^2,
    by overlapping blocks of at least four successive pairs, see `d2d.block_length`.  For e it is
    divided by 2 e; close to zero it is at most the square root of that for e^2, which is thus the
    extent one standard error away from zero.  The velocities, which are fitted to the
    same positions, make the extent a little too small: by 1 to 2 % with 40 targets.

    The extent equals the scatter of the points only if each target has one counterpart.  An object
    that returns several targets is covered by all of them together, so that a smaller extent
    predicts the targets of the next scan best: in simulation, with one to eight targets per object,
    0.4 to 0.7 of the scatter.  It is larger than the scatter if more targets lack a counterpart
    than the outlier component assumes, or if a blur predicts a scan of dense clutter better.

    The likeliest extent is not always the one with the best velocities.  On RadarScenes it is 0.5
    to 0.7 m, but omega is most accurate with at most 0.1 m.  Many targets there are at
    rest relative to the sensor, not to the street: reflections slide along guard rails, and the
    places where targets are dense move with the sensor.  A wide extent lets them pull the velocity.

    Examples
    --------
    >>> import numpy as np
    >>> from d2d.radar import estimate_extent, simulate_drive
    >>> drive = simulate_drive(np.random.default_rng(0), duration=3.0)
    >>> found = estimate_extent(drive.scans, drive.mounting)
    >>> wider = [scan.with_extent(found.extent) for scan in drive.scans]
    """
    scans = check_members("scans", scans, RadarScan)
    check_instance("mounting", mounting, Mounting)
    check_count("baseline", baseline)
    if max_pairs is not None:
        check_count("max_pairs", max_pairs, minimum=2)
    model = EgoMotionModel(**options)
    increasing("scans", scans, max_interval)
    chosen = [
        (scans[i].with_extent(0.0), scans[i + baseline].with_extent(0.0))
        for i in range(len(scans) - baseline)
        if scans[i].size and scans[i + baseline].size
    ]
    if len(chosen) < 2:
        raise ValueError(
            "scans must hold at least two pairs of scans with targets that are baseline = "
            f"{baseline} apart, but hold {len(chosen)}"
        )
    if max_pairs is not None and len(chosen) > max_pairs:
        spread = np.linspace(0, len(chosen) - 1, max_pairs).round().astype(int)
        chosen = [chosen[i] for i in spread]
    started = [_start(*pair, mounting, model) for pair in chosen]
    return _most_likely(started, sum(current.size for _, current in chosen))


class _Start(NamedTuple):
    """The problem of a pair of scans of extent 0, and a velocity (3,) near its optima."""

    problem: Problem
    velocity: Array


class _Profile(NamedTuple):
    """Log-likelihood of each pair at its best velocity, and its derivative in e^2; both (n,)."""

    log_likelihood: Array
    score: Array


def _start(
    previous: RadarScan, current: RadarScan, mounting: Mounting, model: EgoMotionModel
) -> _Start:
    problem = model.problem([scan_pair(previous, current, mounting, model)])
    starts = doppler_starts([(current, mounting)])
    return _Start(problem, estimate_velocity(widened(problem, _MIDDLE), starts, (1.0,)).theta)


def _most_likely(pairs: Sequence[_Start], targets: int) -> ExtentEstimate:
    """The extent of largest likelihood, with its standard errors."""
    profiles = [_profile(pairs, candidate) for candidate in CANDIDATES]
    curve = np.array([profile.log_likelihood.sum() for profile in profiles])
    slopes = np.array([profile.score.sum() for profile in profiles])
    extent = _maximum(pairs, curve, slopes)
    candidates = CANDIDATES.copy()
    if extent > 0.0:
        best = _profile(pairs, extent)
        place = np.searchsorted(candidates, extent)
        candidates = np.insert(candidates, place, extent)
        curve = np.insert(curve, place, best.log_likelihood.sum())
        near = [_profile(pairs, extent * np.sqrt(1.0 + step)) for step in (-_STEP, _STEP)]
        curvature = (near[0].score - near[1].score).sum() / (2.0 * _STEP * extent**2)
    else:
        best = profiles[0]
        curvature = (best.score - _profile(pairs, _SMALL).score).sum() / _SMALL**2
    return ExtentEstimate(
        extent,
        _standard_error(extent, np.sqrt(_variance_of_sum(best.score)), curvature),
        _standard_error(extent, np.sqrt(max(curvature, 0.0)), curvature),
        len(pairs),
        targets,
        candidates,
        curve / targets,
    )


def _profile(pairs: Sequence[_Start], extent: float) -> _Profile:
    """The log-likelihoods at an extent, each at the best velocity from its start."""
    log_likelihood, score = np.empty(len(pairs)), np.empty(len(pairs))
    for i, (problem, velocity) in enumerate(pairs):
        wider = widened(problem, extent)
        best = estimate_velocity(wider, velocity, (1.0,))
        log_likelihood[i] = -best.value
        score[i] = wider.widening_slopes(wider.bind(best.theta)).sum()
    return _Profile(log_likelihood, score)


def widened(problem: Problem, extent: float) -> Problem:
    """The problem with the variance extent^2 added along each axis to all targets of both sets."""
    pairs = [
        pair._replace(
            fixed=pair.fixed.widened(np.full(pair.fixed.size, extent)),
            moving=pair.moving.widened(np.full(pair.moving.size, extent)),
        )
        for pair in problem.pairs
    ]
    return replace(problem, pairs=pairs)


def _maximum(pairs: Sequence[_Start], curve: Array, slopes: Array) -> float:
    """The extent of largest likelihood, from its logarithm and scores at the candidates.

    Every maximum between two candidates has a score above zero at the first and below at the
    second; the one beside the most likely candidate is taken.
    """
    if slopes[-1] > 0.0 and curve.argmax() == len(curve) - 1:
        raise ValueError(
            f"scans have a likelihood that still grows at {CANDIDATES[-1]:g} m: positions of one "
            "scan do not fit those of the other"
        )
    inside = np.flatnonzero((slopes[:-1] > 0.0) & (slopes[1:] <= 0.0))
    if not len(inside) or (curve.argmax() == 0 and slopes[0] <= 0.0):
        return 0.0
    first = max(inside, key=lambda i: max(curve[i], curve[i + 1]))
    return float(
        scipy.optimize.brentq(
            lambda extent: _profile(pairs, extent).score.sum(),
            CANDIDATES[first],
            CANDIDATES[first + 1],
            xtol=_TOLERANCE,
            rtol=1e-6,
        )
    )


def _variance_of_sum(scores: Array) -> float:
    """Variance of the sum of scores (n,) in time order, by overlapping blocks on a ring.

    Successive pairs may share a scan, which a few scores do not show: blocks have at least four.
    """
    count = len(scores)
    centred = scores - scores.mean()
    block = max(block_length(centred), min(_SHORTEST_BLOCK, count // 3), 1)
    sums = np.cumsum(np.concatenate([[0.0], centred, centred[: block - 1]]))
    variance = float(((sums[block:] - sums[:-block]) ** 2).sum() / block)
    return variance / (1.0 - block / count)  # the mean is that of the same scores


def _standard_error(extent: float, scatter: float, curvature: float) -> float:
    """That of the extent, from the standard deviation of the score and its slope in e^2."""
    if not curvature > 0.0:
        return float("nan")
    of_square = scatter / curvature
    if 2.0 * extent > np.sqrt(of_square):
        return float(of_square / (2.0 * extent))
    return float(np.sqrt(of_square))
