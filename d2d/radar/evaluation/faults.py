"""Faults of a log as a table, each with the transformation that undoes it.

A fault is found if the log is clearly more likely once it is undone.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from d2d._types import Array
from d2d.problem import Estimate
from d2d.radar.evaluation.sensor_motion import wrapped
from d2d.radar.motion.doppler import doppler_ego_motion, doppler_starts
from d2d.radar.motion.estimate import estimate_velocity
from d2d.radar.motion.model import DEFAULT_DOPPLER_WIDTH, EgoMotionModel
from d2d.radar.motion.pairs import ScanPair, problem_of
from d2d.radar.scans.scan import Mounting, RadarScan, doppler_velocity
from d2d.radar.tracks.rounds import SensorScans, rounds_of
from d2d.registration import ANNEALED

_INTERVALS = 24  # that are tried with each transformation
_FIRST = 4  # of them, every which is tried first
_APART = 0.3  # s, between the scans of such an interval
_MOST = 5.0  # nats that one interval may count for or against a fault: an optimum may be missed
_TELLING, _SIGMAS = 15.0, 4.0  # nats in all, and standard deviations of their sum
_ALIKE = 12.0  # nats, within which two explanations are as good
_ASKEW, _AHEAD = 3.0, math.cos(math.radians(15.0))  # nats against a vehicle that drives otherwise
_KNOWN = 5.0  # standard deviations of a speed that has a direction
_SPEEDS = np.array([0.0, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 45.0])  # m/s, where a search starts
_LEAST_LIMIT = 0.5  # m/s, of Doppler velocities that fold
# Velocities at which they may be unfolded, and how many of these are tried.
_AHEAD_OR_TURNING = np.array(
    [[v, 0.0, w] for v in np.arange(0.0, 60.0, 0.25) for w in np.linspace(-0.4, 0.4, 9)]
)
_UNFOLDINGS = 3


class Epoch(dict[str, ScanPair]):
    """An interval of each sensor at about one time."""

    def changed(self, change: Callable[[str, ScanPair], ScanPair]) -> "Epoch":
        """The intervals after a change of each, given the sensor's name."""
        return Epoch({name: change(name, pair) for name, pair in self.items()})

    @cached_property
    def by_positions(self) -> Estimate:
        """The velocity that the positions alone show."""
        starts = np.column_stack([_SPEEDS, 0.0 * _SPEEDS, 0.0 * _SPEEDS])
        problem = problem_of([*self.values()], EgoMotionModel(doppler=False))
        return estimate_velocity(problem, starts, ANNEALED)


class Fault(NamedTuple):
    """A fault, and how to undo it in the scans and mountings of an interval."""

    symptom: str
    sensor: str  # its name; empty if it is about all
    undo: Callable[[Epoch], Epoch]
    volume: float = 0.0  # nats per target: log of the factor between the units of densities
    doppler: bool = True  # whether it has Doppler velocities once it is undone


def likelier_without(
    log: Mapping[str, SensorScans], turned: Mapping[str, Mounting], *, scaled: bool
) -> list[tuple[Fault, float]]:
    """The faults without which the log is clearly more likely, and by how many nats an interval.

    Mountings that are ``turned`` are another explanation, with these: there is no fault if it is
    better.  If ranges, Doppler velocities and times are known to be ``scaled`` rightly, their
    faults are not tried.
    """
    epochs = _epochs(log)
    if not epochs:
        return []
    stated = np.array([max(_likelihood(each), _likelihood(_compensated(each))) for each in epochs])

    def gains(fault: Fault, step: int = 1) -> Array:
        """Nats that every ``step``-th interval gains without the fault."""
        sizes = [sum(pair.current.size for pair in epoch.values()) for epoch in epochs[::step]]
        undone = [
            _likelihood(fault.undo(each)) if fault.doppler else -float(each.by_positions.value)
            for each in epochs[::step]
        ]
        return np.asarray(undone + fault.volume * np.array(sizes) - stated[::step])

    table = [fault for fault in _table(log) if not (scaled and fault.symptom in _OF_SCALES)]
    tried = [fault for fault in table if gains(fault, _FIRST).mean() > 0.0]
    found = [(fault, gains(fault)) for fault in tried]
    likelier = [(fault, each) for fault, each in found if _is_clear(each)]
    if not likelier:
        return []
    best = max((each for _, each in likelier), key=lambda each: np.median(each) + each.mean())
    aligned = gains(Fault("", "", partial(_mounted, mountings=turned)))
    if turned and _is_clear(aligned - best):
        return []
    return [
        (fault, float(np.mean(each)))
        for fault, each in likelier
        if np.clip(best - each, -_MOST, _MOST).sum() < _ALIKE
    ]


def _is_clear(gains: Array) -> bool:
    """Whether nats (n,) of single intervals together speak for a fault.

    A fault may show in some intervals only, as a fold does when the vehicle is fast, so that chance
    is judged by what speaks against it.
    """
    clipped = np.clip(gains, -_MOST, _MOST)
    chance = math.sqrt(2.0 * float((np.minimum(clipped, 0.0) ** 2).sum()))
    return bool(clipped.sum() > max(_TELLING, _SIGMAS * chance))


def _epochs(log: Mapping[str, SensorScans]) -> list[Epoch]:
    """Intervals of all sensors, spread evenly over the log."""
    names = [*log]
    rounds = [each for each in rounds_of([*log.values()], horizon=_APART) if each.pairs]
    return [
        Epoch({names[s]: pair for s, pair in zip(each.sensors, each.pairs, strict=True)})
        for each in rounds[:: max(1, len(rounds) // _INTERVALS)]
    ]


def _likelihood(epoch: Mapping[str, ScanPair]) -> float:
    """Log-likelihood of an interval at its best velocity, with a prior that it drives ahead."""
    problem = problem_of([*epoch.values()], EgoMotionModel())
    best = estimate_velocity(problem, doppler_starts(_views(epoch)), (1.0,))
    speed = math.hypot(*best.theta[:2])
    sigma = math.sqrt(max(float(best.covariance[0, 0] + best.covariance[1, 1]), 0.0))
    askew = speed > _KNOWN * sigma and best.theta[0] < _AHEAD * speed
    return -float(best.value) - (_ASKEW if askew else 0.0)


def _views(epoch: Mapping[str, ScanPair]) -> list[tuple[RadarScan, Mounting]]:
    return [(pair.current, pair.mounting) for pair in epoch.values()]


# ---- The table

# Faults after which the ranges of targets do not change as their Doppler velocities say.
_OF_SCALES = (
    *("the path runs backwards", "Doppler velocities in km/h", "ranges in feet", "ranges in dm"),
    *("the vehicle hardly moves", "Doppler velocities are folded"),
    *("Doppler velocities in mph", "Doppler velocities are doubled"),
    "Doppler velocities show another motion",
)


def _table(log: Mapping[str, SensorScans]) -> Iterator[Fault]:
    """The faults, of all sensors and of each."""
    groups = ["", *(log if len(log) > 1 else ())]
    for sensor in groups:
        yield _changed("the path runs backwards", sensor, doppler=-1.0)
        yield _changed("Doppler velocities in km/h", sensor, doppler=1.0 / 3.6)
        yield _changed("azimuths count clockwise", sensor, azimuth=-1.0)
    yield _changed("Doppler velocities in mph", "", doppler=0.44704)
    yield _changed("Doppler velocities are doubled", "", doppler=0.5)
    yield _changed("ranges in feet", "", range=0.3048)
    yield _changed("ranges in dm", "", range=0.1)
    yield _each("x and y are swapped", "", _swapped)
    values = np.concatenate([scan.doppler for scans, _ in log.values() for scan in scans])
    yield Fault("the vehicle hardly moves", "", _measured)
    limit = float(np.abs(values).max(initial=0.0))
    if limit > _LEAST_LIMIT:
        undo = partial(_unfolded, limit=limit)
        yield Fault("Doppler velocities are folded", "", undo)
    width = max(DEFAULT_DOPPLER_WIDTH, float(np.ptp(values)))
    volume = -math.log(width)
    yield Fault("Doppler velocities show another motion", "", Epoch, volume, doppler=False)
    at = {name: mounting for name, (_, mounting) in log.items()}
    if max(abs(each.yaw) for each in at.values()) < 2.0 * math.pi / math.degrees(1.0):
        degrees = {name: replace(each, yaw=math.degrees(each.yaw)) for name, each in at.items()}
        yield Fault("yaw of the mountings in radians", "", partial(_mounted, mountings=degrees))
    for first, second in itertools.combinations(log, 2):
        exchanged = {first: at[second], second: at[first]}
        both = f"{first} and {second}"
        yield Fault("sensors are swapped", both, partial(_mounted, mountings=exchanged))


def _changed(symptom: str, sensor: str, **factors: float) -> Fault:
    """The fault that is undone by factors on what a sensor measures, or on that of all."""

    def scaled(scan: RadarScan) -> RadarScan:
        changes: Any = {name: factor * getattr(scan, name) for name, factor in factors.items()}
        return replace(scan, **changes)

    powers = {"range": 2.0}  # positions have a density per area
    volume = sum(powers.get(name, 1.0) * math.log(abs(by)) for name, by in factors.items())
    return _each(symptom, sensor, scaled, volume)


def _each(
    symptom: str, sensor: str, change: Callable[[RadarScan], RadarScan], volume: float = 0.0
) -> Fault:
    """The fault that is undone by a change of each scan of a sensor, or of all."""

    def undone(name: str, pair: ScanPair) -> ScanPair:
        if sensor not in ("", name):
            return pair
        return ScanPair(change(pair.previous), change(pair.current), pair.mounting)

    return Fault(symptom, sensor, lambda epoch: epoch.changed(undone), volume)


def _swapped(scan: RadarScan) -> RadarScan:
    return replace(scan, azimuth=wrapped(0.5 * np.pi - scan.azimuth))


def _mounted(epoch: Epoch, mountings: Mapping[str, Mounting]) -> Epoch:
    """The interval with other mountings of some sensors."""
    return epoch.changed(
        lambda name, pair: pair._replace(mounting=mountings.get(name, pair.mounting))
    )


def _measured(epoch: Epoch) -> Epoch:
    """The interval with the motion that the positions show put back into the Doppler velocities."""
    return _with_velocity(epoch, epoch.by_positions.theta)


def _compensated(epoch: Epoch) -> Epoch:
    """The interval without the motion that the Doppler velocities show.

    It is the more likely one where positions travel with the vehicle, as those of a guardrail.
    """
    return _with_velocity(epoch, -doppler_ego_motion(_views(epoch)).theta)


def _with_velocity(epoch: Epoch, velocity: Array) -> Epoch:
    """The interval with Doppler velocities of static targets at a velocity (3,) added."""
    return _with_doppler(
        epoch, lambda pair: doppler_velocity(velocity, pair.current.azimuth, pair.mounting)
    )


def _unfolded(epoch: Epoch, limit: float) -> Epoch:
    """The most likely interval with Doppler velocities unfolded to those of static targets.

    They are unfolded about the velocities at which most of them are those of static targets but
    for a multiple of twice the limit.
    """

    def rest(pair: ScanPair, velocities: Array) -> Array:
        static = doppler_velocity(velocities, pair.current.azimuth, pair.mounting)
        return np.asarray(static - pair.current.doppler)

    def disagreement(pair: ScanPair) -> Array:
        scan, speed = pair.current, _AHEAD_OR_TURNING[:, :1]
        off = (rest(pair, _AHEAD_OR_TURNING) + limit) % (2.0 * limit) - limit
        sigma = 3.0 * np.hypot(scan.sigma_doppler, scan.sigma_azimuth * speed)
        return np.asarray(np.minimum((off / sigma) ** 2, 1.0).sum(axis=-1))

    def unfolded(velocity: Array) -> Epoch:
        turns = 2.0 * limit
        return _with_doppler(epoch, lambda pair: turns * np.round(rest(pair, velocity) / turns))

    agreed = np.argsort(sum(map(disagreement, epoch.values())))
    tried = [epoch.by_positions.theta, *_AHEAD_OR_TURNING[agreed[:_UNFOLDINGS]]]
    return max(map(unfolded, tried), key=_likelihood)


def _with_doppler(epoch: Epoch, added: Callable[[ScanPair], Array]) -> Epoch:
    def shifted(_: str, pair: ScanPair) -> ScanPair:
        doppler = pair.current.doppler + added(pair)
        return pair._replace(current=replace(pair.current, doppler=doppler))

    return epoch.changed(shifted)
