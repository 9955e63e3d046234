"""Ego-motion from several sensors at once: one velocity, the sum of their costs."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize

from d2d._checks import Array, count, finite, members, rows, schedule
from d2d.cost import OutlierModel, RegistrationCost
from d2d.radar.doppler import doppler_ego_motion, doppler_starts
from d2d.radar.ego_motion import DEFAULT_OUTLIER, Attempt, Track, follow, increasing
from d2d.radar.pair import Pair
from d2d.radar.scan import Mounting, RadarScan
from d2d.registration import MOST_ITERATIONS, TOLERANCE, Estimate

ScanPair = tuple[RadarScan, RadarScan, Mounting]
Sensor = tuple[Sequence[RadarScan], Mounting]

# Some standard deviations of a velocity, in which the optimiser's trust region is round.
_UNITS = np.array([0.1, 0.1, 0.02])  # m/s, m/s, rad/s
_FLAT = 1e-3  # of the gradient in these units: near enough for Newton's method


def estimate_joint_ego_motion(
    pairs: Iterable[ScanPair],
    *,
    doppler: bool = True,
    outlier: OutlierModel | None = DEFAULT_OUTLIER,
    initial: ArrayLike | None = None,
    scales: Sequence[float] = (1.0,),
) -> Estimate:
    """The vehicle's velocity that suits the scans of several sensors best.

    Minimises the sum of the pairs' costs (those of `estimate_ego_motion`), each pair moved by
    exp(tau theta) over its own interval tau and seen from its own mounting.  The velocity is taken
    for constant from the first of the scans to the last.

    Parameters
    ----------
    pairs : iterable of (previous, current, mounting)
        At least one; the scans of each in time order, with at least one target each.
    doppler, outlier, scales
        As for `estimate_ego_motion`.
    initial : (3,) array, optional
        Start [v_x, v_y, omega].  Unless given, that of `doppler_ego_motion` over all current scans;
        where these do not show all of it, the starts that the scan with the most targets gives.

    Returns
    -------
    Estimate
        theta = [v_x, v_y, omega] in m/s, m/s, rad/s; the covariance is the inverse of the exact
        Hessian of the sum.

    Raises
    ------
    ValueError
        Naming the argument: no pair, scans out of time order or without targets, a wrong start.
    """
    pairs = rows("pairs", pairs, RadarScan, RadarScan, Mounting)
    if not pairs:
        raise ValueError("pairs must hold at least one pair of scans, but is empty")
    problems = [Pair.of(*pair, doppler) for pair in pairs]
    return _estimate(problems, RegistrationCost(outlier=outlier), pairs, initial, scales)


def _estimate(
    problems: Sequence[Pair],
    cost: RegistrationCost,
    pairs: Sequence[ScanPair],
    initial: ArrayLike | None,
    scales: Sequence[float],
) -> Estimate:
    """The best optimum from the start that is given, or from those that the pairs suggest."""
    starts = _starts(pairs) if initial is None else finite("initial", initial)[np.newaxis]
    if starts.shape[1:] != (3,):
        raise ValueError(f"initial must have the shape (3,), but has {starts.shape[1:]}")
    steps = schedule("scales", scales)
    found = [_anneal(problems, cost, start, steps) for start in starts]
    return min(found, key=lambda estimate: (not estimate.converged, estimate.value))


def _starts(pairs: Sequence[ScanPair]) -> Array:
    motion = doppler_ego_motion([(current, mounting) for _, current, mounting in pairs])
    if np.isfinite(motion.covariance).all():
        return motion.theta[np.newaxis]
    _, current, mounting = max(pairs, key=lambda pair: pair[1].size)
    return doppler_starts(current, mounting)


def _anneal(
    problems: Sequence[Pair], cost: RegistrationCost, start: Array, scales: Array
) -> Estimate:
    for scale in scales:
        inflated = [p if scale == 1.0 else p.inflated(float(scale)) for p in problems]
        estimate = _minimise(_Sum(inflated, cost), start)
        start = estimate.theta
    return estimate


class _Sum:
    """The sum of the pairs' costs; what was asked for last is kept for the optimiser."""

    def __init__(self, problems: Sequence[Pair], cost: RegistrationCost) -> None:
        self.problems, self.cost = problems, cost
        self.theta, self.last = np.full(3, np.nan), (np.inf, np.zeros(3), np.zeros((3, 3)))

    def derivatives(self, theta: Array) -> tuple[float, Array, Array]:
        """Value, gradient (3,) and Hessian (3, 3) at the velocity theta (3,)."""
        if not np.array_equal(theta, self.theta):
            parts = [pair.derivatives(theta, self.cost) for pair in self.problems]
            value, gradient, hessian = (sum(column) for column in zip(*parts, strict=True))
            self.theta, self.last = theta.copy(), (value, gradient, hessian)
        return self.last


def _minimise(total: _Sum, start: Array) -> Estimate:
    """Trust region from the start, then Newton steps to the tolerance of `d2d.register`."""
    result = minimize(
        lambda z: total.derivatives(z * _UNITS)[0],
        start / _UNITS,
        jac=lambda z: total.derivatives(z * _UNITS)[1] * _UNITS,
        hess=lambda z: total.derivatives(z * _UNITS)[2] * np.outer(_UNITS, _UNITS),
        method="trust-exact",
        options={"gtol": _FLAT, "maxiter": MOST_ITERATIONS},
    )
    theta, iterations, decrement = result.x * _UNITS, int(result.nit), np.inf
    for _ in range(5):
        value, gradient, hessian = total.derivatives(theta)
        if not _positive_definite(hessian):
            break
        step = np.linalg.solve(hessian, gradient)
        decrement = float(gradient @ step)
        if decrement <= TOLERANCE:
            break
        theta, iterations = theta - step, iterations + 1
    converged = decrement <= TOLERANCE
    covariance = np.linalg.inv(hessian) if converged else np.full((3, 3), np.nan)
    return Estimate(
        theta,
        0.5 * (covariance + covariance.T),
        np.asarray(value),
        gradient,
        hessian,
        np.asarray(converged),
        np.asarray(iterations),
    )


def _positive_definite(matrix: Array) -> bool:
    scaled = matrix * np.outer(_UNITS, _UNITS)
    eigenvalues = np.linalg.eigvalsh(scaled)
    return bool(eigenvalues[0] > 1e-12 * eigenvalues[-1] > 0.0)


def track_joint(
    sensors: Iterable[tuple[Iterable[RadarScan], Mounting]],
    *,
    baseline: int = 1,
    doppler: bool = True,
    outlier: OutlierModel | None = DEFAULT_OUTLIER,
    initial: ArrayLike | None = None,
    scales: Sequence[float] = (1.0,),
) -> Track:
    """Ego-motion over a whole drive from several sensors that need not run in step.

    The scans of all sensors in time order are cut into rounds, a new one wherever a sensor comes
    up for the second time; a sensor may miss rounds.  Each round is one estimate.

    Parameters
    ----------
    sensors : iterable of (scans, mounting)
        Each sensor's scans, an iterable, in strictly increasing time.
    baseline : int
        How many scans back each scan is registered, see `track`.
    initial : (3,) array, optional
        Start of the first estimate.
    doppler, outlier, scales
        Of `estimate_joint_ego_motion`.

    Returns
    -------
    Track
        ``times`` are the mean times of each round's scans.  Pairs of scans of which one is empty
        are left out; what is said of `track` about estimates that fail holds here too.

    Raises
    ------
    ValueError
        Without a sensor, with one whose scans are out of time order, or fewer than two rounds;
        otherwise naming the argument that does not fit.
    """
    count("baseline", baseline)
    drives = [
        (members(f"sensors[{number}][0]", scans, RadarScan), mounting)
        for number, (scans, mounting) in enumerate(rows("sensors", sensors, Iterable, Mounting))
    ]
    cost = RegistrationCost(outlier=outlier)
    groups = rounds([scans for scans, _ in drives])
    if len(groups) < 2:
        raise ValueError(f"sensors must have at least two rounds of scans, but have {len(groups)}")
    times = np.array([np.mean([drives[s][0][i].time for s, i in group]) for group in groups])

    def solve(i: int, start: Array | None) -> Attempt | None:
        pairs = joint_pairs(drives, groups[i + 1], baseline)
        if not pairs:
            return None
        problems = [Pair.of(*pair, doppler) for pair in pairs]
        estimate = _estimate(problems, cost, pairs, start, scales)
        inliers = [problem.inlier_probabilities(estimate.theta, cost) for problem in problems]
        return Attempt(estimate, float(np.concatenate(inliers).mean()))

    return follow(times, solve, initial)


def rounds(scans: Sequence[Sequence[RadarScan]]) -> list[list[tuple[int, int]]]:
    """Rounds of (sensor, scan) indices: all scans in time order, no sensor twice in a round."""
    for number, own in enumerate(scans):
        increasing(f"the scans of sensor {number} (counted from 0)", own)
    order = sorted((scan.time, s, i) for s, own in enumerate(scans) for i, scan in enumerate(own))
    groups: list[list[tuple[int, int]]] = []
    seen: set[int] = set()
    for _, sensor, scan in order:
        if not groups or sensor in seen:
            groups.append([])
            seen = set()
        groups[-1].append((sensor, scan))
        seen.add(sensor)
    return groups


def joint_pairs(
    sensors: Sequence[Sensor], group: Sequence[tuple[int, int]], baseline: int = 1
) -> list[ScanPair]:
    """Each scan of a round with the one ``baseline`` scans before; none for a sensor's first."""
    chosen = [
        (sensors[s][0][max(i - baseline, 0)], sensors[s][0][i], sensors[s][1])
        for s, i in group
        if i > 0
    ]
    return [pair for pair in chosen if pair[0].size and pair[1].size]
