"""What a log and its track say about mistakes that were made with them.

A mistake of signs, units or mountings leaves a trace that a correct log does not have.  The
thresholds lie between what 4 RadarScenes radars on two drives and 5 nuScenes radars on five scenes
show as they are, and what they show with the mistake put in.
"""

import itertools
import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np

from d2d._checks import check_instance
from d2d._types import Array
from d2d.radar.motion.doppler import sensor_velocity
from d2d.radar.motion.estimate import inlier_probabilities
from d2d.radar.scans.scan import Mounting, RadarScan
from d2d.radar.tracks.intake import usable
from d2d.radar.tracks.rounds import (
    MAX_INTERVAL,
    Round,
    Sensors,
    SensorScans,
    named_sensors,
    rounds_of,
)
from d2d.radar.tracks.track import Track

_NARROW = 3.5  # deg, beyond which some radar sees: azimuths in rad reach 1 or more
_FAR = 500.0  # m, beyond which hardly a radar sees; real logs have a median range below 50 m
# Automotive radars state 0.1 to 1 degree; 0.5 degree are 0.009 rad, and 0.5 rad are 29 degrees.
_PRECISE, _COARSE = 0.03, 10.0  # deg
_TOO_SMALL = "standard deviation of the azimuth too small"
_TOO_LARGE = "standard deviation of the azimuth too large"
_SAMPLE = 200  # scans of a sensor, or rounds
_MOVING = 3.0  # m/s, below which a heading is uncertain
_SEEN = 5  # targets of a scan, and scans, that show a heading
# Of the heading that a sensor's Doppler velocities show: real mountings deviate by at most 0.7
# degrees from straight ahead, and by 0.75 from each other; 3 degrees too many show as 1.8 or more.
_TURNED, _GROSS, _ALIKE = np.deg2rad([1.5, 15.0, 12.0])
_BACKWARDS, _CLOCKWISE = "the vehicle drives backwards", "azimuths count clockwise"
_SURE = 4.0  # standard deviations of a heading
_LEVER = 1.5  # m, standard deviation of a lever arm that is not known
_UNKNOWN = np.deg2rad(1.0)  # what a heading is off by in a bend whose yaw rate is not known
_ALIKE_SCANS = 10.0  # scans whose errors are about the same
# Median inlier shares of real logs: 0.47 to 0.62 over all sensors; in feet 0.16 to 0.26.  Single
# nuScenes radars that look aside have 0.09 to 0.54, sensors that are swapped 0.01 at most.
_FEW, _HARDLY_ANY = 0.4, 0.05
_GAP, _CYCLES = 1.0, 5.0  # s, and times the usual interval, that a gap is longer than
_ASIDE = np.deg2rad([50.0, 130.0])  # boresights to the side
_SLIPPING = 0.05  # m/s, standard deviation of v_y, below which a slip law holds it
# Of the largest Doppler velocity: by how much neighbours along the azimuth differ where it folds
# between them, and by how much those beside them at most.  So it is in 5 to 96 % of the scans of
# most radars whose limit is below the speed, and in none of the real logs.
_JUMP, _STEADY, _FOLDED = 1.6, 0.2, 0.05

T = TypeVar("T")


class Finding(NamedTuple):
    """What is probably wrong, and the number that shows it."""

    symptom: str  # its row in the page "When a path looks wrong"
    sensor: str  # its name; empty if it is about all
    number: float
    unit: str
    sure: bool  # whether the estimates are surely of no use
    about: str  # the same in words, with what to look at

    def __str__(self) -> str:
        whose = f"{self.sensor}: " if self.sensor else ""
        return f"{whose}{self.symptom} ({self.about})"


class Diagnosis(NamedTuple):
    """What `diagnose` found, and what it looked at, by the names of the sensors."""

    findings: list[Finding]
    inliers: dict[str, float]  # median over the scans of the mean inlier probability
    headings: dict[str, float]  # deg, at which the Doppler velocities show a drive; 0 is ahead


class _Shown(NamedTuple):
    """What one sensor shows beside the joint estimate; nan where it shows nothing."""

    name: str
    mounting: Mounting
    inliers: float
    heading: float  # rad
    sigma: float  # rad


def diagnose(
    sensors: Sensors,
    driven: Track,
    *,
    baseline: int = 1,
    horizon: float | None = None,
    max_interval: float = MAX_INTERVAL,
) -> Diagnosis:
    """What is probably wrong with a log, told by the log itself and its track.

    ``driven`` is what `track` returned for the other arguments.  Each finding has a ``symptom``, a
    row of the page *When a path looks wrong*, the ``sensor`` it is about (empty if it is about
    all), the ``number`` that shows it and its ``unit``, and says whether the estimates are ``sure``
    to be of no use.  What `track` itself warns of is not repeated: such a warning holds its own
    ``finding``.

    Not everything can be told from the log: if the azimuths of a single radar that looks straight
    ahead count clockwise, it is a drive through a mirrored world.  Raises a ``ValueError`` if an
    argument is invalid, or ``driven`` is not the track of these sensors.

    Examples
    --------
    >>> import numpy as np
    >>> from d2d.radar import Mounting, diagnose, simulate_drive, track
    >>> drive = simulate_drive(np.random.default_rng(0), duration=10.0)
    >>> place = drive.mounting
    >>> turned = drive.scans, Mounting(place.x, place.y, place.yaw + np.deg2rad(5.0))
    >>> [found.symptom for found in diagnose(turned, track(turned)).findings]
    ['a mounting is turned']
    """
    check_instance("driven", driven, Track)
    names, drives = _named(sensors, max_interval)
    rounds = rounds_of(drives, baseline, horizon)
    if len(rounds) != len(driven):
        raise ValueError(
            f"driven must be the track of sensors, which have {len(rounds)} estimates, but has "
            f"{len(driven)}"
        )
    shares = _inliers(len(drives), rounds, driven)
    shown = [
        _Shown(name, mounting, share, *_heading(scans, mounting, driven))
        for name, (scans, mounting), share in zip(names, drives, shares, strict=True)
    ]
    found = look_at_targets(sensors, max_interval)
    if _usual_share(shown) < _FEW:
        found = [each._replace(sure=each.sure or each.symptom == _TOO_SMALL) for each in found]
    if not any(each.sure for each in found):  # what is wrong with targets explains the rest
        found += _of_mountings(shown)
    return Diagnosis(
        [*found, *_of_track(shown, driven)],
        dict(zip(names, shares, strict=True)),
        {each.name: float(np.rad2deg(each.heading)) for each in shown},
    )


def look_at_targets(sensors: Sensors, max_interval: float = MAX_INTERVAL) -> list[Finding]:
    """The findings of `diagnose` that need no track."""
    names, drives = _named(sensors, max_interval)
    return [
        each
        for name, (scans, _) in zip(names, drives, strict=True)
        for each in _of_targets(name, scans)
    ]


def _named(sensors: Sensors, max_interval: float) -> tuple[list[str], list[SensorScans]]:
    """Names and scans of the sensors, with times and targets as `track` uses them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # `track` has warned
        drives = list(usable(named_sensors(sensors, max_interval)).values())
    given: Any = sensors
    names = given if isinstance(given, Mapping) else range(1, len(drives) + 1)
    return [str(name) for name in names], drives


def _evenly(members: Sequence[T]) -> Sequence[T]:
    return members[:: max(1, len(members) // _SAMPLE)]


def _inliers(count: int, rounds: Sequence[Round], driven: Track) -> list[float]:
    """Median over accepted rounds of each sensor's mean inlier probability."""
    shares: list[list[float]] = [[] for _ in range(count)]
    for i in _evenly(np.flatnonzero(driven.converged).tolist()):
        for sensor, pair in zip(rounds[i].sensors, rounds[i].pairs, strict=True):
            found = inlier_probabilities(driven.theta[i], *pair)
            shares[sensor].append(float(found.mean()))
    return [float(np.median(each)) if each else np.nan for each in shares]


def _heading(scans: Sequence[RadarScan], mounting: Mounting, driven: Track) -> tuple[float, float]:
    """The direction in rad in which the vehicle seems to drive, and its standard deviation.

    Seen from an origin on the rear axle it is zero if the mounting is right.  A lever arm c along x
    that is not known adds c omega / v in bends.
    """
    seen = [scan for scan in _evenly(scans) if scan.size >= _SEEN]
    if not seen:
        return np.nan, np.nan
    omega = driven.at([scan.time for scan in seen]).theta[:, 2]
    known = np.isfinite(omega)
    if known.sum() >= _SEEN:
        seen, omega = [scan for scan, of in zip(seen, known, strict=True) if of], omega[known]
    else:
        omega = np.zeros(len(seen))
    velocity = np.array([sensor_velocity(scan, mounting) for scan in seen])
    velocity += omega[:, None] * [mounting.y, -mounting.x]
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
    found = covariance @ (weight * columns.T @ off[near])
    guessed = 0.0 if omega.any() else _UNKNOWN
    return float(_wrapped(middle + found[0])), float(np.hypot(np.sqrt(covariance[0, 0]), guessed))


def _wrapped(angle: Any) -> Any:
    """Angles in rad from -pi to pi."""
    return np.arctan2(np.sin(angle), np.cos(angle))


def _of_targets(name: str, scans: Sequence[RadarScan]) -> Iterator[Finding]:
    """What the targets of a sensor tell without any estimate."""
    azimuth = np.concatenate([scan.azimuth for scan in scans])
    if len(azimuth) < 10 * _SEEN:
        return
    widest = np.rad2deg(float(np.abs(azimuth).max()))
    if widest < _NARROW:
        told = f"all azimuths are within {widest:.2f} deg of the boresight"
        yield Finding("azimuths in radians, read as degrees", name, widest, "deg", True, told)
    distance = float(np.median(np.concatenate([scan.range for scan in scans])))
    if distance > _FAR:
        told = f"half of them are beyond {distance:.0f} m"
        yield Finding("ranges in cm", name, distance, "m", True, told)
    alone = float(np.mean([scan.size <= 1 for scan in scans]))
    if alone > 0.9:
        told = f"{alone:.0%} of its scans have one target; all targets of a scan need the same time"
        yield Finding("one time stamp for each target", name, alone, "share", True, told)
    limit, share = _folded(scans)
    if limit > _MOVING and share > _FOLDED:
        told = f"neighbours differ by nearly twice {limit:.1f} m/s in {share:.0%} of the scans"
        yield Finding("Doppler velocities are folded", name, limit, "m/s", True, told)
    degrees = np.rad2deg(float(np.median(np.concatenate([scan.sigma_azimuth for scan in scans]))))
    if degrees < _PRECISE:
        told = f"{degrees:.2g} deg is stated; is this rad?"
        yield Finding(_TOO_SMALL, name, degrees, "deg", False, told)
    elif degrees > _COARSE:
        told = f"{degrees:.0f} deg is stated; are these degrees?"
        yield Finding(_TOO_LARGE, name, degrees, "deg", False, told)


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


def _of_mountings(shown: Sequence[_Shown]) -> Iterator[Finding]:
    """Which mistake with the mountings explains the headings that the sensors show."""
    known = [each for each in shown if np.isfinite(each.heading)]
    heading = np.array([each.heading for each in known])
    if np.abs(heading).max(initial=0.0) > _GROSS:
        worst = float(np.rad2deg(heading[np.abs(heading).argmax()]))
        told = f"Doppler velocities show a drive at {worst:+.0f} deg from straight ahead"
        rest = [
            (float(np.abs(_wrapped(heading - turn)).max()), symptom, sensor)
            for symptom, sensor, turn in _mistakes(known)
        ]
        least = min(misfit for misfit, *_ in rest)
        alike = [each for each in rest if each[0] < least + _TURNED]
        if least < _ALIKE:
            # a vehicle may reverse, but then the positions say the same
            contradicted = _usual_share(shown) < _FEW
            for _, symptom, sensor in alike:
                sure = symptom != _BACKWARDS or contradicted
                yield Finding(symptom, sensor, worst, "deg", sure, told)
            return
    off = [each for each in known if abs(each.heading) > max(_TURNED, _SURE * each.sigma)]
    if len(off) == len(known) > 1 and np.ptp(heading) < _TURNED:
        off = [off[0]._replace(name="", heading=float(np.mean(heading)))]  # all by the same angle
    for each in off:
        degrees, gross = float(np.rad2deg(each.heading)), bool(abs(each.heading) > _GROSS)
        told = f"Doppler velocities show a drive at {degrees:+.1f} deg from straight ahead"
        yield Finding("a mounting is turned", each.name, degrees, "deg", gross, told)


def _mistakes(known: Sequence[_Shown]) -> Iterator[tuple[str, str, Array]]:
    """Mistakes, with the sensors they are about, and the heading in rad that each then shows."""
    names, yaw = [e.name for e in known], np.array([e.mounting.yaw for e in known])
    numbers = range(len(known))
    yield _BACKWARDS, "", np.full(len(yaw), np.pi)
    yield _CLOCKWISE, "", 2.0 * yaw
    if np.abs(yaw).max() < np.deg2rad(2.0 * np.pi):
        yield "yaw of the mountings in radians", "", yaw - np.rad2deg(yaw)
    for i in numbers if len(known) > 1 else ():
        yield _CLOCKWISE, names[i], np.where(np.array(numbers) == i, 2.0 * yaw, 0.0)
    for i, j in itertools.combinations(numbers, 2):
        heading = np.zeros(len(yaw))
        heading[i], heading[j] = yaw[i] - yaw[j], yaw[j] - yaw[i]
        yield "sensors are swapped", f"{names[i]} and {names[j]}", heading


def _usual_share(shown: Sequence[_Shown]) -> float:
    """Median of the sensors' inlier shares; nan if none is known."""
    shares = [each.inliers for each in shown if np.isfinite(each.inliers)]
    return float(np.median(shares)) if shares else np.nan


def _of_track(shown: Sequence[_Shown], driven: Track) -> Iterator[Finding]:
    """What inlier shares, times and covariances tell."""
    share = _usual_share(shown)
    if share < _FEW:
        told = f"{share:.0%} of the targets fit; units, signs, standard deviations, clocks"
        yield Finding("few targets fit", "", share, "share", False, told)
    elif sum(np.isfinite(each.inliers) for each in shown) > 1:
        for each in shown:
            if each.inliers < _HARDLY_ANY:
                told = f"{each.inliers:.0%} of its targets fit the motion that the others show"
                yield Finding("few targets fit", each.name, each.inliers, "share", False, told)
    longest = float(driven.intervals.max(initial=0.0))
    if longest > max(_GAP, _CYCLES * float(np.median(driven.intervals))):
        at = float(driven.times[driven.intervals.argmax()])
        told = f"{longest:.1f} s before {at:.3f} s; the path goes on with the last velocity"
        yield Finding("a gap", "", longest, "s", False, told)
    sigmas = np.sqrt(driven.covariance[driven.converged, 1, 1])
    if len(shown) == 1 and len(sigmas) and np.median(sigmas) > _SLIPPING:
        yaw = abs(float(_wrapped(shown[0].mounting.yaw)))
        if _ASIDE[0] < yaw < _ASIDE[1]:
            told = f"it looks {np.rad2deg(yaw):.0f} deg aside; --side-slip, or more sensors"
            yield Finding(
                "one radar to the side", shown[0].name, np.rad2deg(yaw), "deg", False, told
            )
