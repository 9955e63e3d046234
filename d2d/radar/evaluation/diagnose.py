"""Common mistakes with a log: units, signs, mountings and clocks.

A mistake is a row of a table with the transformation that undoes it.  It is found if the log is
clearly more likely with the transformation than without.  The other thresholds lie between what 4
RadarScenes radars on two drives and 5 nuScenes radars on five scenes show as they are, and what
they show with the mistake put in.
"""

import itertools
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from d2d._checks import check_instance
from d2d._types import Array
from d2d.radar.motion.doppler import doppler_ego_motion, doppler_starts, sensor_velocity
from d2d.radar.motion.estimate import estimate_velocity, inlier_probabilities
from d2d.radar.motion.model import EgoMotionModel
from d2d.radar.motion.pairs import ScanPair, problem_of
from d2d.radar.scans.scan import Mounting, RadarScan, doppler_velocity
from d2d.radar.tracks.rounds import Sensors, SensorScans, named_sensors, rounds_of
from d2d.radar.tracks.track import Track
from d2d.registration import ANNEALED

_NARROW = 3.5  # deg, beyond which some radar sees: azimuths in rad reach 1 or more
_FAR = 500.0  # m, beyond which hardly a radar sees; real logs have a median range below 50 m
# Automotive radars state 0.1 to 1 degree; 0.5 degree are 0.009 rad, and 0.5 rad are 29 degrees.
_PRECISE, _COARSE = 0.03, 10.0  # deg
_TOO_SMALL = "standard deviation of the azimuth too small"
_MOVING = 3.0  # m/s, below which a heading is uncertain
_SEEN = 5  # targets of a scan, and scans, that show a velocity
# Of the largest Doppler velocity: by how much neighbours along the azimuth differ where it folds
# between them, and by how much those beside them at most.  So it is in 5 to 96 % of the scans of
# most radars whose limit is below the speed, and in none of the real logs.
_JUMP, _STEADY, _FOLDED = 1.6, 0.2, 0.05

_INTERVALS = 20  # that are tried with each transformation
_FIRST = 4  # of them, every which is tried first
_APART = 0.3  # s, between the scans of such an interval
_TELLING = 3.0  # nats by which an interval must be more likely without the mistake, in the median
_ASKEW = 2.0 * _TELLING  # nats that speak against a vehicle that does not drive ahead
_SPEEDS = np.array([0.0, 5.0, 10.0, 20.0, 30.0])  # m/s, at which positions are first compared

# Of the heading that a sensor's Doppler velocities show: real mountings deviate by at most 0.7
# degrees from straight ahead, and by 0.75 from each other; 3 degrees too many show as 1.8 or more.
_TURNED, _GROSS, _BACKWARDS = np.deg2rad([1.5, 15.0, 165.0])
_SURE = 4.0  # standard deviations of a heading
_LEVER = 1.5  # m, standard deviation of a lever arm that is not known
_UNKNOWN = np.deg2rad(1.0)  # error of a heading in a bend whose yaw rate is not known
_ALIKE_SCANS = 10.0  # scans whose errors are about the same

# Median inlier shares of real logs: 0.47 to 0.62 over all sensors; in feet 0.16 to 0.26.  Single
# nuScenes radars that look aside have 0.09 to 0.54, sensors that are swapped 0.01 at most.
_FEW, _HARDLY_ANY = 0.4, 0.05
_GAP, _CYCLES = 1.0, 5.0  # s, and times the usual interval, that a gap is longer than
_ASIDE = np.deg2rad([50.0, 130.0])  # boresights to the side
_SLIPPING = 0.05  # m/s, standard deviation of v_y, below which a slip law holds it

_LAGS = np.linspace(-1.0, 1.0, 101)  # s, between the clocks of two sensors
# Scans, s and nats that show a lag, and scans whose errors are about the same, as traffic lasts for
# some of them.  On RadarScenes 105, whose radars have one clock, the largest lag is 0.058 s.
_SCANS, _LATE, _LIKELIER, _LASTING = 50, 0.07, 12.5, 5.0
_USELESS = 0.2  # s, beyond which a sensor only disturbs the others
_WITHIN = 3.0  # m/s between two sensors, of which one sees traffic if they differ by more

Epoch = dict[str, ScanPair]  # an interval of each sensor at about one time


class Finding(NamedTuple):
    """A likely mistake with a log, and the number that shows it."""

    symptom: str  # its row in the page "When a path looks wrong"
    sensor: str  # its name; empty if it is about all
    number: float
    unit: str
    sure: bool  # whether the estimates are surely of no use
    about: str  # the same in words, with what to look at

    def __str__(self) -> str:
        whose = f"{self.sensor}: " if self.sensor else ""
        return f"{whose}{self.symptom} ({self.about})"


class _Mistake(NamedTuple):
    """A mistake, and how to undo it in the scans and mountings of an interval."""

    symptom: str
    sensor: str
    undo: Callable[[Epoch], Epoch]
    volume: float = 0.0  # nats per target: log of the factor between the units of densities


def diagnose(sensors: Sensors, driven: Track) -> tuple[Finding, ...]:
    """Return likely mistakes with a log: units, signs, mountings and clocks.

    ``driven`` is what `track` returned for these sensors.  Each finding has a ``symptom``, a row of
    the page *When a path looks wrong*, the ``sensor`` it is about (empty if it is about all), the
    ``number`` that shows it and its ``unit``, and says whether the estimates are ``sure`` to be of
    no use.

    Not everything can be told from the log: if the azimuths of a single radar that looks straight
    ahead count clockwise, it is a drive through a mirrored world.  Raises a ``ValueError`` if an
    argument is invalid.

    Examples
    --------
    >>> import numpy as np
    >>> from d2d.radar import Mounting, diagnose, simulate_drive, track
    >>> drive = simulate_drive(np.random.default_rng(0), duration=10.0)
    >>> place = drive.mounting
    >>> turned = drive.scans, Mounting(place.x, place.y, place.yaw + np.deg2rad(5.0))
    >>> [found.symptom for found in diagnose(turned, track(turned))]
    ['a mounting is turned']
    """
    check_instance("driven", driven, Track)
    parts = named_sensors(sensors, sys.float_info.max).values()
    given: Any = sensors
    names = map(str, given if isinstance(given, Mapping) else range(1, len(parts) + 1))
    log = dict(zip(names, parts, strict=True))
    inliers = np.empty(0) if driven.inliers is None else driven.inliers[driven.converged]
    share = float(np.median(inliers)) if len(inliers) else np.nan
    found = [each for name, (scans, _) in log.items() for each in _of_targets(name, scans)]
    if share < _FEW:
        found = [each._replace(sure=each.sure or each.symptom == _TOO_SMALL) for each in found]
    # scans whose order is not known have no intervals, and wrong targets explain the rest
    epochs = _epochs(log) if len(driven.segments) == 1 else []
    if epochs and not any(each.sure for each in found):
        found += _of_motion(log, driven, epochs)
    return (*found, *_of_track(log, driven, share, epochs))


# ---- Targets without any estimate


def _of_targets(name: str, scans: Sequence[RadarScan]) -> Iterator[Finding]:
    """Findings from the values of a sensor's targets."""
    azimuth = np.concatenate([scan.azimuth for scan in scans])
    if len(azimuth) < 10 * _SEEN:
        return
    widest = np.rad2deg(float(np.abs(azimuth).max()))
    if widest < _NARROW:
        about = f"all azimuths are within {widest:.2f} deg of the boresight"
        yield Finding("azimuths in radians, read as degrees", name, widest, "deg", True, about)
    distance = float(np.median(np.concatenate([scan.range for scan in scans])))
    if distance > _FAR:
        about = f"half of them are beyond {distance:.0f} m"
        yield Finding("ranges in cm", name, distance, "m", True, about)
    alone = float(np.mean([scan.size <= 1 for scan in scans]))
    if alone > 0.9:
        about = f"{alone:.0%} of its scans have one target; all of a scan need the same time"
        yield Finding("one time stamp for each target", name, alone, "share", True, about)
    limit, share = _folded(scans)
    if limit > _MOVING and share > _FOLDED:
        about = f"neighbours differ by nearly twice {limit:.1f} m/s in {share:.0%} of the scans"
        yield Finding("Doppler velocities are folded", name, limit, "m/s", True, about)
    degrees = np.rad2deg(float(np.median(np.concatenate([scan.sigma_azimuth for scan in scans]))))
    if degrees < _PRECISE:
        about = f"{degrees:.2g} deg is stated; is this rad?"
        yield Finding(_TOO_SMALL, name, degrees, "deg", False, about)
    elif degrees > _COARSE:
        about = f"{degrees:.0f} deg is stated; are these degrees?"
        symptom = "standard deviation of the azimuth too large"
        yield Finding(symptom, name, degrees, "deg", False, about)


def _folded(scans: Sequence[RadarScan]) -> tuple[float, float]:
    """The largest Doppler velocity, and the share of scans in which it is folded.

    Along the azimuth, Doppler velocities of static targets change steadily.  Folded ones jump from
    one limit to the other.
    """
    seen = [scan for scan in scans if scan.size >= _SEEN]
    limit = max((float(np.abs(scan.doppler).max()) for scan in seen), default=0.0)
    folded = []
    for scan in seen:
        step = np.abs(np.diff(scan.doppler[np.argsort(scan.azimuth)]))
        steady = step < _STEADY * limit
        folded.append(((step[1:-1] > _JUMP * limit) & steady[:-2] & steady[2:]).any())
    return limit, float(np.mean(folded)) if folded else 0.0


# ---- Mistakes that a transformation undoes


def _of_motion(
    log: Mapping[str, SensorScans], driven: Track, epochs: Sequence[Epoch]
) -> list[Finding]:
    """The mistakes without which the log is clearly more likely, or else turned mountings."""
    motions = {name: _Motion.of(scans, at, driven) for name, (scans, at) in log.items()}
    headings = {name: motion.heading for name, motion in motions.items()}
    stated = [max(map(_log_likelihood, (epoch, _compensated(epoch)))) for epoch in epochs]

    def gain(mistake: _Mistake, step: int = 1) -> float:
        """Nats that a typical interval gains without the mistake, by every ``step``-th one."""
        gains = [
            _log_likelihood(mistake.undo(epoch))
            + mistake.volume * sum(pair.current.size for pair in epoch.values())
            - before
            for epoch, before in zip(epochs[::step], stated[::step], strict=True)
        ]
        return float(np.median(gains)) if gains else -math.inf

    likelier = [
        (gain(mistake), mistake) for mistake in _mistakes(log) if gain(mistake, _FIRST) > 0.0
    ]
    best = max((value for value, _ in likelier), default=0.0)
    if best > _TELLING:
        off = {name: heading for name, (heading, _) in headings.items() if abs(heading) > _TURNED}
        aligned = _Mistake("a mounting is turned", "", partial(_turned, angles=off))
        if best > gain(aligned) - _TELLING:
            about = f"intervals are {best:.0f} nats more likely without it"
            return [
                Finding(mistake.symptom, mistake.sensor, value, "nats", True, about)
                for value, mistake in likelier
                if value > best - _TELLING
            ]
    return [*_of_headings(headings), *_of_clocks(motions)]


def _mistakes(log: Mapping[str, SensorScans]) -> Iterator[_Mistake]:
    """The table of mistakes, with all sensors and with each."""
    yield _multiplied("the path runs backwards", "", doppler=-1.0)
    yield _multiplied("Doppler velocities in km/h", "", doppler=1.0 / 3.6)
    yield _multiplied("ranges in feet", "", range=0.3048)
    yield _multiplied("ranges in dm", "", range=0.1)
    yield _multiplied("azimuths count clockwise", "", azimuth=-1.0)
    yield _Mistake("the vehicle hardly moves", "", _measured)
    yaw = {name: mounting.yaw for name, (_, mounting) in log.items()}
    if max(map(abs, yaw.values())) < np.deg2rad(2.0 * np.pi):
        excess = {name: angle - float(np.rad2deg(angle)) for name, angle in yaw.items()}
        yield _Mistake("yaw of the mountings in radians", "", partial(_turned, angles=excess))
    for name in log if len(log) > 1 else ():
        yield _multiplied("azimuths count clockwise", name, azimuth=-1.0)
    for first, second in itertools.combinations(log, 2):
        exchanged = {first: log[second][1], second: log[first][1]}
        both = f"{first} and {second}"
        yield _Mistake("sensors are swapped", both, partial(_mounted, mountings=exchanged))


def _multiplied(symptom: str, sensor: str, **factors: float) -> _Mistake:
    """The mistake that is undone by factors on what a sensor measures, or on that of all."""

    def scaled(scan: RadarScan) -> RadarScan:
        changes: Any = {name: factor * getattr(scan, name) for name, factor in factors.items()}
        return replace(scan, **changes)

    def undo(epoch: Epoch) -> Epoch:
        return {
            name: ScanPair(scaled(pair.previous), scaled(pair.current), pair.mounting)
            if sensor in ("", name)
            else pair
            for name, pair in epoch.items()
        }

    powers = {"range": 2.0}  # positions have a density per area
    volume = sum(powers.get(name, 1.0) * math.log(abs(by)) for name, by in factors.items())
    return _Mistake(symptom, sensor, undo, volume)


def _mounted(epoch: Epoch, mountings: Mapping[str, Mounting]) -> Epoch:
    """The interval with other mountings of some sensors."""
    return {
        name: pair._replace(mounting=mountings.get(name, pair.mounting))
        for name, pair in epoch.items()
    }


def _turned(epoch: Epoch, angles: Mapping[str, float]) -> Epoch:
    """The interval with angles in rad taken off the mountings of some sensors."""
    mountings = {}
    for name, angle in angles.items():
        if name in epoch:
            place = epoch[name].mounting
            mountings[name] = replace(place, yaw=float(_wrapped(place.yaw - angle)))
    return _mounted(epoch, mountings)


def _measured(epoch: Epoch) -> Epoch:
    """The interval with the motion that the positions show put back into the Doppler velocities."""
    starts = np.column_stack([_SPEEDS, 0.0 * _SPEEDS, 0.0 * _SPEEDS])
    problem = problem_of([*epoch.values()], EgoMotionModel(doppler=False))
    return _with_velocity(epoch, estimate_velocity(problem, starts, ANNEALED).theta)


def _compensated(epoch: Epoch) -> Epoch:
    """The interval without the motion that the Doppler velocities show.

    It is the more likely one where positions travel with the vehicle, as those of a guardrail.
    """
    return _with_velocity(epoch, -doppler_ego_motion(_views(epoch)).theta)


def _with_velocity(epoch: Epoch, velocity: Array) -> Epoch:
    """The interval with Doppler velocities of static targets at a velocity (3,) added."""
    moved = {}
    for name, pair in epoch.items():
        scan = pair.current
        gained = doppler_velocity(velocity, scan.azimuth, pair.mounting)
        moved[name] = pair._replace(current=replace(scan, doppler=scan.doppler + gained))
    return moved


def _views(epoch: Epoch) -> list[tuple[RadarScan, Mounting]]:
    return [(pair.current, pair.mounting) for pair in epoch.values()]


def _log_likelihood(epoch: Epoch) -> float:
    """Log-likelihood of an interval at its best velocity, with a prior that it drives ahead."""
    problem = problem_of([*epoch.values()], EgoMotionModel())
    best = estimate_velocity(problem, doppler_starts(_views(epoch)), (1.0,))
    speed = math.hypot(*best.theta[:2])
    askew = speed > _MOVING and best.theta[0] < math.cos(_GROSS) * speed
    return -float(best.value) - (_ASKEW if askew else 0.0)


def _epochs(log: Mapping[str, SensorScans]) -> list[Epoch]:
    """Intervals of all sensors, spread evenly over the log."""
    names = [*log]
    rounds = [each for each in rounds_of([*log.values()], horizon=_APART) if each.pairs]
    return [
        {names[s]: pair for s, pair in zip(each.sensors, each.pairs, strict=True)}
        for each in rounds[:: max(1, len(rounds) // _INTERVALS)]
    ]


# ---- Velocities of single sensors


class _Motion(NamedTuple):
    """The velocities of the vehicle's origin by the Doppler velocities of one sensor."""

    times: Array  # (n,)
    velocity: Array  # (n, 2), m/s, along the vehicle's axes
    omega: Array  # (n,), rad/s, of the track; zero if that is not known
    heading: tuple[float, float]  # rad, and its standard deviation

    @classmethod
    def of(cls, scans: Sequence[RadarScan], mounting: Mounting, driven: Track) -> "_Motion":
        """Velocities of the scans that show one, at yaw rates of the track."""
        seen = [scan for scan in scans if scan.size >= _SEEN]
        times = np.array([scan.time for scan in seen])
        omega = driven.at(times).theta[:, 2]
        velocity = np.array([sensor_velocity(scan, mounting) for scan in seen]).reshape(-1, 2)
        known = np.isfinite(omega)
        if known.sum() >= _SEEN:
            times, velocity, omega = times[known], velocity[known], omega[known]
        else:
            omega = np.zeros(len(seen))
        velocity += omega[:, None] * [mounting.y, -mounting.x]
        return cls(times, velocity, omega, _heading(velocity, omega))


def _heading(velocity: Array, omega: Array) -> tuple[float, float]:
    """Heading of the vehicle's origin by one sensor, and its standard deviation, in rad.

    Seen from an origin on the rear axle it is zero if the mounting is right.  A lever arm c along x
    that is not known adds c omega / v in bends.
    """
    speed = np.hypot(*velocity.T)
    fast = speed > _MOVING
    if fast.sum() < _SEEN:
        return np.nan, np.nan
    unit = velocity[fast] / speed[fast, None]
    middle = np.arctan2(*np.median(unit, axis=0)[::-1])
    off = _wrapped(np.arctan2(unit[:, 1], unit[:, 0]) - middle)
    spread = max(1.4826 * float(np.median(np.abs(off - np.median(off)))), np.deg2rad(0.1))
    near = np.abs(off - np.median(off)) < 5.0 * spread
    columns = np.column_stack([np.ones(near.sum()), (omega[fast] / speed[fast])[near]])
    weight = 1.0 / (_ALIKE_SCANS * spread**2)
    information = weight * columns.T @ columns + np.diag([0.0, _LEVER**-2])
    covariance = np.linalg.inv(information)
    best = covariance @ (weight * columns.T @ off[near])
    guessed = 0.0 if omega.any() else _UNKNOWN
    return float(_wrapped(middle + best[0])), float(np.hypot(np.sqrt(covariance[0, 0]), guessed))


def _wrapped(angle: Any) -> Any:
    """Angles in rad from -pi to pi."""
    return np.arctan2(np.sin(angle), np.cos(angle))


def _of_headings(headings: Mapping[str, tuple[float, float]]) -> Iterator[Finding]:
    """Mountings that are turned, by the headings of their sensors."""
    off = {
        name: heading
        for name, (heading, sigma) in headings.items()
        if abs(heading) > max(_TURNED, _SURE * sigma)
    }
    known = [heading for heading, _ in headings.values() if np.isfinite(heading)]
    if len(off) == len(known) > 1 and np.ptp(known) < _TURNED:
        off = {"": float(np.mean(known))}  # all by the same angle
    for name, heading in off.items():
        degrees = float(np.rad2deg(heading))
        about = f"Doppler velocities show a drive at {degrees:+.1f} deg from straight ahead"
        if abs(heading) > _BACKWARDS:  # a vehicle may reverse
            yield Finding("the vehicle drives backwards", name, degrees, "deg", False, about)
        else:
            gross = bool(abs(heading) > _GROSS)
            yield Finding("a mounting is turned", name, degrees, "deg", gross, about)


def _of_clocks(motions: Mapping[str, _Motion]) -> Iterator[Finding]:
    """The sensor whose Doppler velocities are those of the others at another time, if there is one.

    Of several, as the others seem early beside a late one, it is the one that is most surely off.
    """
    lags = [
        (*_lag(own, [other for other in motions.values() if other is not own]), name)
        for name, own in motions.items()
    ]
    likelier, lag, name = max(lags)
    if likelier > _LIKELIER and abs(lag) > _LATE:
        about = f"{abs(lag):.2f} s {'late' if lag > 0.0 else 'early'}"
        sure = abs(lag) > _USELESS
        yield Finding("the clock of a sensor is off", name, lag, "s", sure, about)


def _lag(own: _Motion, others: Sequence[_Motion]) -> tuple[float, float]:
    """The most likely lag of a sensor in s, after how much more likely than none it is, in nats.

    The forward velocity is regressed on that of the others a lag before, beside what a wrong
    mounting does: it adds a constant, and parts of the speed and of the yaw rate.
    """
    forward = own.velocity[:, 0]
    squares = np.full((len(_LAGS), len(forward)), np.nan)
    for row, lag in zip(squares, _LAGS, strict=True):
        shown = [
            np.interp(own.times - lag, each.times, each.velocity[:, 0], np.nan, np.nan)
            for each in others
            if len(each.times)
        ]
        theirs = np.median(shown or [np.full(len(forward), np.nan)], axis=0)
        good = np.abs(forward - theirs) < _WITHIN
        columns = np.column_stack([np.ones(good.sum()), theirs[good], own.omega[good]])
        weights = np.linalg.lstsq(columns, forward[good])[0]
        row[good] = (forward[good] - columns @ weights) ** 2
    common = np.isfinite(squares).all(axis=0)
    if common.sum() < _SCANS:
        return 0.0, 0.0
    means = squares[:, common].mean(axis=1) + 1e-12
    none = means[len(_LAGS) // 2]
    likelier = 0.5 * common.sum() / _LASTING * np.log(none / means.min())
    return float(likelier), float(_LAGS[means.argmin()])


# ---- The track


def _of_track(
    log: Mapping[str, SensorScans], driven: Track, share: float, epochs: Sequence[Epoch]
) -> Iterator[Finding]:
    """Findings from inlier shares, times and covariances."""
    if share < _FEW:
        about = f"{share:.0%} of the targets fit; units, signs, standard deviations, clocks"
        yield Finding("few targets fit", "", share, "share", False, about)
    else:
        for name, own in _shares(driven, epochs).items() if len(log) > 1 else ():
            if own < _HARDLY_ANY:
                about = f"{own:.0%} of its targets fit the motion that the others show"
                yield Finding("few targets fit", name, own, "share", False, about)
    intervals = np.nan_to_num(driven.intervals)  # not known where the clock steps back
    for end, begin in itertools.pairwise(driven.segments):
        about = f"back to {begin.times[0]:.3f} s after {end.times[-1]:.3f} s"
        step = float(begin.times[0] - end.times[-1])
        yield Finding("the clock jumps", "", step, "s", False, about)
    longest = float(intervals.max(initial=0.0))
    if longest > max(_GAP, _CYCLES * float(np.median(intervals))):
        at = float(driven.times[intervals.argmax()])
        about = f"{longest:.1f} s before {at:.3f} s; the path goes on with the last velocity"
        yield Finding("a gap", "", longest, "s", False, about)
    sigmas = np.sqrt(driven.covariance[driven.converged, 1, 1])
    if len(log) == 1 and len(sigmas) and np.median(sigmas) > _SLIPPING:
        ((name, (_, mounting)),) = log.items()
        yaw = abs(float(_wrapped(mounting.yaw)))
        if _ASIDE[0] < yaw < _ASIDE[1]:
            about = f"it looks {np.rad2deg(yaw):.0f} deg aside; --side-slip, or more sensors"
            yield Finding("one radar to the side", name, np.rad2deg(yaw), "deg", False, about)


def _shares(driven: Track, epochs: Sequence[Epoch]) -> dict[str, float]:
    """Each sensor's median, over the intervals, of the mean inlier probability of its targets."""
    shares: dict[str, list[float]] = {}
    for epoch in epochs:
        for name, pair in epoch.items():
            velocity = driven.at([pair.current.time]).theta[0]
            if np.isfinite(velocity).all():
                fitting = inlier_probabilities(velocity, *pair)
                shares.setdefault(name, []).append(float(fitting.mean()))
    return {name: float(np.median(own)) for name, own in shares.items()}
