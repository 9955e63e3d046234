"""Ego-motion from several sensors at once: one velocity, the sum of their costs."""

from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike

from d2d._checks import check_members, check_rows
from d2d._types import Array
from d2d.radar.motion.doppler import doppler_ego_motion, doppler_starts
from d2d.radar.motion.estimate import check_velocity, estimate_velocity
from d2d.radar.motion.model import EstimationOptions, split_options
from d2d.radar.motion.pairs import (
    ScanPair,
    check_distinct,
    check_pairs,
    check_separation,
    scan_before,
    scan_pair,
)
from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.scans.scan import Mounting, RadarScan
from d2d.radar.tracks.limits import VehicleLimits
from d2d.radar.tracks.one_sensor import MAX_INTERVAL, Track, check_intervals, increasing
from d2d.radar.tracks.tracking import DEFAULT_LIMITS, Interval, Search, check_tracking, follow
from d2d.registration import Estimate

Sensor = tuple[Sequence[RadarScan], Mounting]


def estimate_joint_ego_motion(
    pairs: Iterable[ScanPair],
    *,
    initial: ArrayLike | None = None,
    **options: Unpack[EstimationOptions],
) -> Estimate:
    """The vehicle's velocity that best fits the scans of several sensors.

    Minimises the sum of the pairs' costs (those of `estimate_ego_motion`).  Each pair has its own
    mounting and its own interval tau, over which the vehicle moves by exp(tau theta).  The velocity
    is assumed constant from the first scan to the last.

    Parameters
    ----------
    pairs : iterable of (previous, current, mounting)
        At least one pair; its scans are in time order, each with at least one target.
    initial : (3,) array, optional
        Start [v_x, v_y, omega] in m/s, m/s, rad/s.  By default, the velocity that
        `doppler_ego_motion` finds from all current scans; if they do not determine all of it, the
        starts that `estimate_ego_motion` would take from the scan with the most targets.
    **options
        ``doppler``, ``outlier``, ``doppler_width``, ``slips``, ``first_order`` and ``scales``, as
        for `estimate_ego_motion`.

    Returns
    -------
    Estimate
        theta = [v_x, v_y, omega] in m/s, m/s, rad/s; the covariance is the inverse of the exact
        Hessian of the sum.

    Raises
    ------
    ValueError
        If there is no pair, scans are out of time order or have no targets, or ``initial`` is
        invalid; the message names the argument.
    """
    pairs = check_pairs(pairs)
    model, scales = split_options(options)
    start = _starts(pairs) if initial is None else check_velocity(initial)
    problem = model.problem([scan_pair(*pair, model) for pair in pairs])
    return estimate_velocity(problem, start, scales)


def _starts(pairs: Sequence[ScanPair]) -> Array:
    motion = doppler_ego_motion([(current, mounting) for _, current, mounting in pairs])
    if np.isfinite(motion.covariance).all():
        return motion.theta[np.newaxis]
    _, current, mounting = max(pairs, key=lambda pair: pair[1].size)
    return doppler_starts(current, mounting)


def track_joint(
    sensors: Iterable[tuple[Iterable[RadarScan], Mounting]],
    *,
    baseline: int = 1,
    horizon: float | None = None,
    initial: ArrayLike | None = None,
    max_interval: float = MAX_INTERVAL,
    budget: ErrorBudget | None = None,
    limits: VehicleLimits | None = DEFAULT_LIMITS,
    progress: bool | None = None,
    **options: Unpack[EstimationOptions],
) -> Track:
    """Ego-motion over a whole drive from several sensors that need not be synchronised.

    The scans of all sensors, in time order, are divided into rounds.  A new round begins whenever a
    sensor already has a scan in the current one; scans of the same time stay together, and a sensor
    may be missing from a round.  Each round gives one estimate.

    Parameters
    ----------
    sensors : iterable of (scans, mounting)
        The scans of each sensor, an iterable in strictly increasing time, and its mounting.
    baseline, horizon : int, or float in s
        How many scans, or how long, before its second scan the first one of a pair is; see `track`.
    initial : (3,) array, optional
        Start [v_x, v_y, omega] of the first estimate.
    max_interval : float, s
        Longest time between two scans of a sensor, and between two rounds; see `track`.
    budget, limits, progress
        As for `track`.  Each sensor has errors of its own, all of the same standard deviations.
    **options
        ``doppler``, ``outlier``, ``doppler_width``, ``slips``, ``first_order`` and ``scales``, as
        for `estimate_ego_motion`.

    Returns
    -------
    Track
        ``times`` are the mean times of each round's scans.  Pairs with an empty scan are left out.
        Estimates that fail are handled as in `track`.

    Warns
    -----
    UserWarning
        As `track` does.

    Raises
    ------
    ValueError
        If there is no sensor, two have a scan in common, scans are out of time order or farther
        apart than ``max_interval``, there are fewer than two rounds or another argument is invalid;
        the message names the argument.
    """
    check_separation(baseline, horizon)
    check_tracking(budget, limits, progress)
    drives = [
        (check_members(f"sensors[{number}][0]", scans, RadarScan), mounting)
        for number, (scans, mounting) in enumerate(
            check_rows("sensors", sensors, Iterable, Mounting)
        )
    ]
    check_distinct("sensors", [scans for scans, _ in drives])
    model, scales = split_options(options)
    limits = None if limits is None else limits.for_doppler(model.doppler)
    groups = rounds([scans for scans, _ in drives], max_interval)
    if len(groups) < 2:
        raise ValueError(f"sensors must have at least two rounds of scans, but have {len(groups)}")
    times = np.array([np.mean([drives[s][0][i].time for s, i in group]) for group in groups])
    check_intervals("the rounds of all sensors", times, max_interval)

    def bind(i: int) -> Interval | None:
        pairs = joint_pairs(drives, groups[i + 1], baseline, horizon)
        if not pairs:
            return None
        return Interval(model.problem([scan_pair(*pair, model) for pair in pairs]), pairs)

    def begin(i: int) -> Array:
        return _starts(joint_pairs(drives, groups[i + 1], baseline, horizon))

    return follow(times, Search(bind, begin, scales), initial, budget, limits, progress)


def rounds(
    scans: Sequence[Sequence[RadarScan]], max_interval: float = MAX_INTERVAL
) -> list[list[tuple[int, int]]]:
    """Rounds of (sensor, scan) indices: all scans in time order, no sensor twice in a round.

    Scans of the same time are in the same round, so that the sensors' order does not count.
    """
    for number, own in enumerate(scans):
        increasing(f"the scans of sensor {number} (counted from 0)", own, max_interval)
    order = sorted((scan.time, s, i) for s, own in enumerate(scans) for i, scan in enumerate(own))
    groups: list[list[tuple[int, int]]] = []
    seen: set[int] = set()
    for _, entries in groupby(order, key=lambda entry: entry[0]):
        together = [(sensor, scan) for _, sensor, scan in entries]
        sensors = {sensor for sensor, _ in together}
        if not groups or sensors & seen:
            groups.append([])
            seen = set()
        groups[-1] += together
        seen |= sensors
    return groups


def joint_pairs(
    sensors: Sequence[Sensor],
    group: Sequence[tuple[int, int]],
    baseline: int = 1,
    horizon: float | None = None,
) -> list[ScanPair]:
    """Each scan of a round, paired with the one of its sensor that `track` would take.

    A sensor's first scan and pairs with an empty scan are left out.
    """
    chosen = [
        (scan_before(sensors[s][0], i, baseline, horizon), sensors[s][0][i], sensors[s][1])
        for s, i in group
        if i > 0
    ]
    return [pair for pair in chosen if pair[0].size and pair[1].size]
