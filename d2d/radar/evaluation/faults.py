"""Faults of a log as a table, each with the transformation that undoes it.

A fault is found if the log is clearly more likely once it is undone.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache, cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from d2d._types import Array
from d2d.problem import Estimate
from d2d.radar.evaluation.sensor_motion import wrapped
from d2d.radar.motion.doppler import View, doppler_ego_motion, doppler_starts
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

    def with_doppler(self, added: Callable[[ScanPair], Array]) -> "Epoch":
        """The intervals with something added to the later scans' Doppler velocities."""

        def shifted(_: str, pair: ScanPair) -> ScanPair:
            doppler = pair.current.doppler + added(pair)
            return pair._replace(current=replace(pair.current, doppler=doppler))

        return self.changed(shifted)

    @property
    def views(self) -> list[View]:
        """The later scans, with their mountings."""
        return [(pair.current, pair.mounting) for pair in self.values()]

    @property
    def size(self) -> int:
        """Targets of the later scans."""
        return sum(scan.size for scan, _ in self.views)

    @cached_property
    def by_positions(self) -> Estimate:
        """The velocity that the positions alone show."""
        starts = np.column_stack([_SPEEDS, 0.0 * _SPEEDS, 0.0 * _SPEEDS])
        problem = problem_of([*self.values()], EgoMotionModel(doppler=False))
        return estimate_velocity(problem, starts, ANNEALED)

    @property
    def likelihood(self) -> float:
        """Log-likelihood at the best velocity, with a prior that the vehicle drives ahead."""
        problem = problem_of([*self.values()], EgoMotionModel())
        best = estimate_velocity(problem, doppler_starts(self.views), (1.0,))
        speed = math.hypot(*best.theta[:2])
        sigma = math.sqrt(max(float(best.covariance[0, 0] + best.covariance[1, 1]), 0.0))
        askew = speed > _KNOWN * sigma and best.theta[0] < _AHEAD * speed
        return -float(best.value) - (_ASKEW if askew else 0.0)


class Fault(NamedTuple):
    """A fault, and the log-likelihood of an interval once it is undone there."""

    symptom: str
    sensor: str  # its name; empty if it is about all
    without: Callable[[Epoch], float]


def likelier_without(
    log: Mapping[str, SensorScans], turned: Mapping[str, Mounting], *, scaled: bool
) -> list[tuple[Fault, float]]:
    """The faults without which the log is clearly more likely, and by how many nats an interval.

    None if the mountings that are ``turned`` explain it better.  If ranges, Doppler velocities and
    times are known to be ``scaled`` rightly, their faults are not tried.
    """
    rounds = [each for each in rounds_of([*log.values()], horizon=_APART) if each.pairs]
    names = [*log]
    epochs = [
        Epoch({names[s]: pair for s, pair in zip(each.sensors, each.pairs, strict=True)})
        for each in rounds[:: max(1, len(rounds) // _INTERVALS)]
    ]
    if not epochs:
        return []
    # without the motion where positions travel with the vehicle, as those of a guardrail
    stated = [max(e.likelihood, _moved(e, -doppler_ego_motion(e.views).theta)) for e in epochs]
    gain = cache(lambda fault, e: fault.without(epochs[e]) - stated[e])

    def gains(fault: Fault, step: int = 1) -> Array:
        """Nats that every ``step``-th interval gains without the fault."""
        return np.array([gain(fault, e) for e in range(0, len(epochs), step)])

    tried = [fault for fault in _table(log, scaled=scaled) if gains(fault, _FIRST).mean() > 0.0]
    found = [(fault, gains(fault)) for fault in tried]
    likelier = [(fault, each) for fault, each in found if _is_clear(each)]
    if not likelier:
        return []
    best = max((each for _, each in likelier), key=lambda each: np.median(each) + each.mean())
    if turned and _is_clear(gains(_mounted("", "", turned)) - best):
        return []
    return [
        (fault, float(np.mean(each)))
        for fault, each in likelier
        if np.clip(best - each, -_MOST, _MOST).sum() < _ALIKE
    ]


def _is_clear(gains: Array) -> bool:
    """Whether nats (n,) of single intervals together speak for a fault."""
    clipped = np.clip(gains, -_MOST, _MOST)
    # it may show in some of them only, so that chance is judged by what speaks against it
    chance = math.sqrt(2.0 * float((np.minimum(clipped, 0.0) ** 2).sum()))
    return bool(clipped.sum() > max(_TELLING, _SIGMAS * chance))


# ---- The table


def _table(log: Mapping[str, SensorScans], *, scaled: bool) -> Iterator[Fault]:
    """The faults, of all sensors and of each."""
    for sensor in ["", *(log if len(log) > 1 else ())]:
        if not scaled:
            yield _scaled("the path runs backwards", sensor, doppler=-1.0)
            yield _scaled("Doppler velocities in km/h", sensor, doppler=1.0 / 3.6)
        yield _scaled("azimuths count clockwise", sensor, azimuth=-1.0)
    if not scaled:
        yield _scaled("Doppler velocities in mph", doppler=0.44704)
        yield _scaled("Doppler velocities are doubled", doppler=0.5)
        yield _scaled("ranges in feet", range=0.3048)
        yield _scaled("ranges in dm", range=0.1)
        yield Fault("the vehicle hardly moves", "", lambda e: _moved(e, e.by_positions.theta))
        values = np.concatenate([scan.doppler for scans, _ in log.values() for scan in scans])
        limit = float(np.abs(values).max(initial=0.0))
        if limit > _LEAST_LIMIT:
            yield Fault("Doppler velocities are folded", "", partial(_unfolded, limit=limit))
        volume = math.log(max(DEFAULT_DOPPLER_WIDTH, float(np.ptp(values))))
        alone = "Doppler velocities show another motion"
        yield Fault(alone, "", lambda e: -float(e.by_positions.value) - volume * e.size)
    yield _changed(
        "x and y are swapped", "", lambda s: replace(s, azimuth=wrapped(0.5 * np.pi - s.azimuth))
    )
    at = {name: mounting for name, (_, mounting) in log.items()}
    if max(abs(each.yaw) for each in at.values()) < 2.0 * math.pi / math.degrees(1.0):
        degrees = {name: replace(each, yaw=math.degrees(each.yaw)) for name, each in at.items()}
        yield _mounted("yaw of the mountings in radians", "", degrees)
    for first, second in itertools.combinations(log, 2):
        exchanged = {first: at[second], second: at[first]}
        yield _mounted("sensors are swapped", f"{first} and {second}", exchanged)


def _scaled(symptom: str, sensor: str = "", **factors: float) -> Fault:
    """The fault that is undone by factors on what a sensor measures, or on that of all."""

    def scaled(scan: RadarScan) -> RadarScan:
        changes: Any = {name: factor * getattr(scan, name) for name, factor in factors.items()}
        return replace(scan, **changes)

    powers = {"range": 2.0}  # positions have a density per area
    # the logarithm of the factor between the units of a target's density
    volume = sum(powers.get(name, 1.0) * math.log(abs(by)) for name, by in factors.items())
    return _changed(symptom, sensor, scaled, volume)


def _changed(
    symptom: str, sensor: str, change: Callable[[RadarScan], RadarScan], volume: float = 0.0
) -> Fault:
    """The fault that is undone by a change of each scan of a sensor, or of all."""

    def undone(name: str, pair: ScanPair) -> ScanPair:
        if sensor not in ("", name):
            return pair
        return ScanPair(change(pair.previous), change(pair.current), pair.mounting)

    return Fault(symptom, sensor, lambda e: e.changed(undone).likelihood + volume * e.size)


def _mounted(symptom: str, sensor: str, mountings: Mapping[str, Mounting]) -> Fault:
    """The fault that is undone by other mountings of some sensors."""

    def undone(name: str, pair: ScanPair) -> ScanPair:
        return pair._replace(mounting=mountings.get(name, pair.mounting))

    return Fault(symptom, sensor, lambda e: e.changed(undone).likelihood)


def _moved(epoch: Epoch, velocity: Array) -> float:
    """The log-likelihood with Doppler velocities of static targets at a velocity (3,) added."""
    return epoch.with_doppler(
        lambda pair: doppler_velocity(velocity, pair.current.azimuth, pair.mounting)
    ).likelihood


def _unfolded(epoch: Epoch, limit: float) -> float:
    """The largest log-likelihood with Doppler velocities unfolded to those of static targets."""
    turn = 2.0 * limit

    def rest(pair: ScanPair, velocities: Array) -> Array:
        static = doppler_velocity(velocities, pair.current.azimuth, pair.mounting)
        return np.asarray(static - pair.current.doppler)

    def unfolded(at: Array) -> float:
        return epoch.with_doppler(lambda p: turn * np.round(rest(p, at) / turn)).likelihood

    def disagreement(pair: ScanPair) -> Array:
        scan, speed = pair.current, _AHEAD_OR_TURNING[:, :1]
        off = (rest(pair, _AHEAD_OR_TURNING) + limit) % turn - limit
        sigma = 3.0 * np.hypot(scan.sigma_doppler, scan.sigma_azimuth * speed)
        return np.asarray(np.minimum((off / sigma) ** 2, 1.0).sum(axis=-1))

    agreed = np.argsort(sum(map(disagreement, epoch.values())))
    tried = [epoch.by_positions.theta, *_AHEAD_OR_TURNING[agreed[:_UNFOLDINGS]]]
    return max(map(unfolded, tried))
