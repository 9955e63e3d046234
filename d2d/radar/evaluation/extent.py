"""How far the targets of extended objects scatter, by maximum likelihood from the scans alone."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Unpack

import numpy as np
import scipy

from d2d._checks import check_count, check_instance
from d2d._types import Array
from d2d.problem import Problem
from d2d.radar.evaluation.sandwich import covariance_of_sum, sqrt_standard_errors
from d2d.radar.motion.doppler import doppler_starts
from d2d.radar.motion.estimate import estimate_velocity
from d2d.radar.motion.model import EgoMotionModel, ModelOptions
from d2d.radar.motion.pairs import ScanPair, problem_of
from d2d.radar.scans.scan import Mounting, RadarScan
from d2d.radar.tracks.intake import usable
from d2d.radar.tracks.rounds import named_sensors

CANDIDATES = np.array([0.0, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2])  # m
_MIDDLE = 0.4  # m; the search at every extent starts at the velocity found with this one
_TOLERANCE = 1e-3  # m
_STEP = 0.1  # relative change of the variance, for the derivative of the slope
_SMALL = 0.03  # m; if the extent is zero, this derivative is taken from zero to here
_SHORTEST_BLOCK = 4  # pairs

# The problem of a pair of scans of extent 0, and a velocity (3,) near its optima at every extent.
_Started = tuple[Problem, Array]


@dataclass(frozen=True, eq=False)
class ExtentEstimate:
    """The extent of a recording's targets, see `estimate_extent`.

    ``extent`` (m) is the standard deviation along each axis, 0 if the likelihood falls from there
    on.  Its standard error ``sigma`` (m) comes from how much the slope of the likelihood differs
    between the pairs, and is nan if there is none.  ``pairs`` and ``targets`` count the pairs of
    scans, and the targets in their current scans, that were used.
    """

    extent: float
    sigma: float
    pairs: int
    targets: int

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
    **options: Unpack[ModelOptions],
) -> ExtentEstimate:
    """Estimate the extent of a sensor's targets (`RadarScan.extent`) by maximum likelihood.

    All targets get the one extent with which the registered pairs of scans are most likely.  No
    reference is needed, and the scans' own ``extent`` is not used.  The scans of a pair are
    ``baseline`` scans apart.  At most ``max_pairs`` are used, spread evenly over the recording;
    None uses all.  The other options are the fields of `EgoMotionModel`.

    Raises a ``ValueError`` if fewer than two pairs have targets in both scans, the likelihood still
    grows at the largest candidate (3.2 m), or an argument is invalid.

    Notes
    -----
    With the extent e, the density of a target about a component of the other scan has the
    covariance S = S_0 + 2 e^2 I.  By the heat equation, the slope of a target's log-likelihood, its
    derivative in e^2, is its inlier probability times the Laplacian of its inlier density over that
    density; at a pair's best velocity nothing else changes (envelope theorem).  At the maximum the
    slopes add up to zero.

    The slopes may depend on each other: overlapping blocks of at least four successive pairs give
    the variance of their sum (sandwich, see `d2d.block_length`).  Its root over the curvature is
    the standard error of e^2, and over 2 e that of e; close to zero, at most the root of that of
    e^2.  The velocities, which are fitted to the same positions, make the extent a little too
    small: by 1 to 2 % with 40 targets.

    The extent equals the scatter of the points only if each target has one counterpart.  If an
    object returns several targets, they cover it together, and a smaller extent predicts the next
    scan best: 0.4 to 0.7 of the scatter in simulations with one to eight targets per object.  The
    extent is larger than the scatter if more targets lack a counterpart than the outlier component
    assumes, or if a blur predicts a scan of dense clutter better.

    The likeliest extent does not always give the best velocities.  On RadarScenes it is 0.5 to
    0.7 m, but omega is most accurate with at most 0.1 m.  Many targets there are at rest relative
    to the sensor, not to the street: reflections slide along guard rails, and the places where
    targets are dense move with the sensor.  A wide extent lets them pull the velocity.

    Examples
    --------
    >>> import numpy as np
    >>> from d2d.radar import estimate_extent, simulate_drive
    >>> drive = simulate_drive(np.random.default_rng(0), duration=3.0)
    >>> found = estimate_extent(drive.scans, drive.mounting)
    >>> wider = [scan.with_extent(found.extent) for scan in drive.scans]
    """
    check_instance("mounting", mounting, Mounting)
    ((scans, mounting),) = usable(named_sensors((scans, mounting))).values()
    check_count("baseline", baseline)
    if max_pairs is not None:
        check_count("max_pairs", max_pairs, minimum=2)
    model = EgoMotionModel(**options)
    points = [scan.with_extent(0.0) for scan in scans]
    pairs = [
        (previous, current)
        for previous, current in zip(points, points[baseline:], strict=False)
        if previous.size and current.size
    ]
    if len(pairs) < 2:
        raise ValueError(
            "scans must hold at least two pairs of scans with targets that are baseline = "
            f"{baseline} apart, but hold {len(pairs)}"
        )
    if max_pairs is not None and len(pairs) > max_pairs:
        spread = np.linspace(0, len(pairs) - 1, max_pairs).round().astype(int)
        pairs = [pairs[i] for i in spread]
    started = []
    for previous, current in pairs:
        problem = problem_of([ScanPair(previous, current, mounting)], model)
        starts = doppler_starts([(current, mounting)])
        near = estimate_velocity(widened(problem, _MIDDLE), starts, (1.0,)).theta
        started.append((problem, near))
    return _most_likely(started, sum(current.size for _, current in pairs))


def _most_likely(pairs: Sequence[_Started], targets: int) -> ExtentEstimate:
    """The extent of largest likelihood, with its standard error."""
    profiles = np.array([_profile(pairs, candidate) for candidate in CANDIDATES])
    curve, slopes = profiles.sum(axis=-1).T
    extent = _maximum(pairs, curve, slopes)
    if extent > 0.0:
        slope = _profile(pairs, extent)[1]
        below, above = (_profile(pairs, extent * np.sqrt(1.0 + s))[1] for s in (-_STEP, _STEP))
        curvature = (below - above).sum() / (2.0 * _STEP * extent**2)
    else:
        slope = profiles[0, 1]
        curvature = (slope - _profile(pairs, _SMALL)[1]).sum() / _SMALL**2
    # successive pairs may share a scan, which a few slopes do not show
    shortest = max(min(_SHORTEST_BLOCK, len(pairs) // 3), 1)
    ((variance,),), _ = covariance_of_sum(slope[:, None], shortest)
    of_square = np.sqrt(variance) / curvature if curvature > 0.0 else np.nan
    sigma = float(sqrt_standard_errors(extent, of_square))
    return ExtentEstimate(extent, sigma, len(pairs), targets)


def _profile(pairs: Sequence[_Started], extent: float) -> Array:
    """Log-likelihoods and their derivatives in e^2 (2, n), each at the best velocity."""
    found = np.empty((2, len(pairs)))
    for i, (problem, velocity) in enumerate(pairs):
        wider = widened(problem, extent)
        best = estimate_velocity(wider, velocity, (1.0,))
        found[:, i] = -best.value, wider.widening_slopes(wider.bind(best.theta)).sum()
    return found


def widened(problem: Problem, extent: float) -> Problem:
    """The problem with the variance extent^2 added along each axis to all targets of both sets."""
    pairs = [
        pair._replace(fixed=pair.fixed.widened(extent), moving=pair.moving.widened(extent))
        for pair in problem.pairs
    ]
    return replace(problem, pairs=pairs)


def _maximum(pairs: Sequence[_Started], curve: Array, slopes: Array) -> float:
    """The extent of largest likelihood, from its logarithm and the slopes at the candidates.

    The slope changes its sign from plus to minus between the candidates beside a maximum.  Of
    several such intervals, the one beside the most likely candidate is taken.
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
            lambda extent: _profile(pairs, extent)[1].sum(),
            CANDIDATES[first],
            CANDIDATES[first + 1],
            xtol=_TOLERANCE,
            rtol=1e-6,
        )
    )
