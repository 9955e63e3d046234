"""Common mistakes with a log: units, signs, mountings and clocks."""

import itertools
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from d2d._checks import check_instance, check_mapping
from d2d.radar.evaluation.compare import compare_tracks
from d2d.radar.evaluation.faults import likelier_without
from d2d.radar.evaluation.sensor_motion import (
    SEEN,
    SensorMotion,
    distortion,
    latest,
    range_rates_agree,
    wrapped,
)
from d2d.radar.scans.scan import Mounting, RadarScan
from d2d.radar.tracks.rounds import Sensors, SensorScans, named_sensors
from d2d.radar.tracks.track import Track

_NARROW = 3.5  # deg, beyond which some radar sees: azimuths in rad reach 1 or more
_FAR = 500.0  # m, beyond which hardly a radar sees; real logs have a median range below 50 m
# Automotive radars state 0.1 to 1 degree; 0.5 degree are 0.009 rad, and 0.5 rad are 29 degrees.
_PRECISE, _COARSE = 0.03, 10.0  # deg
_SEEN = 50  # targets of a sensor, and a fifth as many scans, that show something
_FASTEST, _SLOWEST = 0.003, 3.0  # s: radars take a scan less and at least as often
_UNITS = {"ms": 1e3, "us": 1e6, "ns": 1e9}
_CROWDED = 300  # targets, of scans that rounded times have merged
_SELDOM = 0.5  # s, at which no radar takes scans by the second hand
_SPLIT = 0.01, 0.2  # s, and of a usual interval: times within a scan
_STEPS, _COARSELY = (10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1, 0.05, 0.02), 0.2  # s, of rounded times
# Real mountings deviate by at most 0.7 degrees from straight ahead, and by 0.75 from each other.
_TURNED, _GROSS, _BACKWARDS = np.deg2rad([1.5, 15.0, 165.0])
_SURE = 4.0  # standard deviations of a heading
_SQUARE = np.deg2rad(8.0)  # from a right angle
_LATE, _LIKELIER, _USELESS = 0.07, 12.5, 0.2  # s, nats, s between clocks
_AGREED, _TRAFFIC = 0.6, 0.6  # shares: range rates that are right, targets of one motion
_CONTRARY, _APART = 10.0, 1000.0  # ANEES; right sensors have 3, turned by 4 deg 200, late 5000
_LOST = 0.25  # of the variation of the yaw rate; a right gyro loses up to a tenth
_SHOWN = 3  # stretches without estimates


class Finding(NamedTuple):
    """A likely mistake with a log, and the number that shows it."""

    symptom: str  # a row of the page *When a path looks wrong*
    sensor: str  # its name; empty if it is about all
    number: float
    unit: str
    sure: bool  # whether the estimates are surely of no use
    about: str  # the same in words, with what to state instead

    def __str__(self) -> str:
        whose = f"{self.sensor}: " if self.sensor else ""
        return f"{whose}{self.symptom} ({self.about})"


def diagnose(
    sensors: Sensors, driven: Track, alone: Mapping[str, Track] | None = None
) -> tuple[Finding, ...]:
    """Return likely mistakes with a log: units, signs, mountings and clocks.

    ``driven`` is what `track` returned for these sensors, and ``alone`` what it returned for single
    ones, by their names.  Not everything can be told: if the azimuths of a single radar that looks
    straight ahead count clockwise, it is a drive through a mirrored world.  Raises a ``ValueError``
    if an argument is invalid.

    Examples
    --------
    >>> import numpy as np
    >>> from d2d.radar import Mounting, diagnose, simulate_drive, track
    >>> drive = simulate_drive(np.random.default_rng(0), duration=10.0)
    >>> at = drive.mounting
    >>> turned = drive.scans, Mounting(at.x, at.y, at.yaw + np.deg2rad(5.0))
    >>> [found.symptom for found in diagnose(turned, track(turned))]
    ['a mounting is turned']
    """
    check_instance("driven", driven, Track)
    each_alone = check_mapping("alone", {} if alone is None else alone, Track)
    parts = named_sensors(sensors, sys.float_info.max).values()
    given: Any = sensors
    names = map(str, given if isinstance(given, Mapping) else range(1, len(parts) + 1))
    log = dict(zip(names, parts, strict=True))
    found = [each for name, (scans, _) in log.items() for each in _of_targets(name, scans)]
    found += _of_steps(driven)
    # scans whose order is not known have no intervals, and wrong targets explain the rest
    if len(driven.segments) == 1 and not any(each.sure for each in found):
        found += _of_motion(log, driven)
    return (*found, *_of_track(driven, each_alone))


# ---- Targets and times, without any estimate


def _of_targets(name: str, scans: Sequence[RadarScan]) -> Iterator[Finding]:
    """Findings from the values and the times of a sensor's targets."""
    fields = ("azimuth", "range", "sigma_azimuth")
    values = [np.concatenate([[], *(getattr(scan, field) for scan in scans)]) for field in fields]
    if len(values[0]) < _SEEN:
        return
    yield from _of_times(name, scans)
    widest = np.rad2deg(float(np.abs(values[0]).max()))
    distance, degrees = float(np.median(values[1])), np.rad2deg(float(np.median(values[2])))
    if widest < _NARROW:
        about = f"all azimuths are within {widest:.2f} deg of the boresight; leave --degrees out"
        yield Finding("azimuths in radians, read as degrees", name, widest, "deg", True, about)
    if distance > _FAR:
        about = f"half of them are beyond {distance:.0f} m"
        yield Finding("ranges in cm", name, distance, "m", True, about)
    small = degrees < _PRECISE
    if small or degrees > _COARSE:
        symptom = f"standard deviation of the azimuth too {'small' if small else 'large'}"
        about = f"{degrees:.2g} deg is stated; {'is this rad' if small else 'are these degrees'}?"
        yield Finding(symptom, name, degrees, "deg", small, about)


def _of_times(name: str, scans: Sequence[RadarScan]) -> Iterator[Finding]:
    """Findings from the time stamps of a sensor's scans."""
    times = np.array([scan.time for scan in scans])
    intervals = np.diff(times)
    intervals = intervals[intervals > 0.0]
    if not len(intervals):
        return
    usual, size = float(np.median(intervals)), float(np.median([scan.size for scan in scans]))
    if usual > _SLOWEST and size > _CROWDED:
        about = f"{size:.0f} targets every {usual:g} s; write more digits"
        yield Finding("times are rounded", name, usual, "s", True, about)
    elif usual > _SLOWEST:
        unit, factor = min(_UNITS.items(), key=lambda item: abs(np.log(usual / item[1] / 0.07)))
        about = f"a scan every {usual:g} s; in {unit} it is {factor / usual:.0f} scans a second"
        yield Finding("times in another unit than s", name, usual, "s", True, about)
    if len(times) < _SEEN // 5:
        return
    alone = float(np.mean([scan.size <= 1 for scan in scans]))
    apart = intervals[intervals > _SPLIT[1] * np.quantile(intervals, 0.95)]
    within = 1.0 - len(apart) / len(intervals)
    short = float(np.quantile(intervals, 0.25))
    if short < _SPLIT[0] and (alone > 0.9 or (within > 0.45 and len(apart) > 5)):
        share = max(within, alone)
        about = f"{share:.0%} of the scans are {1e3 * short:.2g} ms after another; --scan-gap 0.01"
        yield Finding("several time stamps in a scan", name, within, "share", True, about)
        return
    if usual < _FASTEST:
        about = f"a scan every {usual:.2g} s; in minutes it is {1 / 60 / usual:.0f} scans a second"
        yield Finding("times in another unit than s", name, usual, "s", True, about)
    step = next((s for s in _STEPS if np.abs(times / s - np.round(times / s)).max() < 1e-4), 0.0)
    counts = np.bincount(np.round(intervals / step).astype(int)) if step else np.zeros(1)
    uneven = np.sort(counts)[:-1].sum() > 0.2 * counts.sum()
    if step > _COARSELY * usual and (uneven or usual >= _SELDOM):
        about = f"all are multiples of {step:g} s, at intervals of {usual:g} s; write more digits"
        yield Finding("times are rounded", name, step, "s", usual >= _SELDOM, about)


def _of_steps(driven: Track) -> Iterator[Finding]:
    """A clock that wraps round, starts again or steps back, by the segments of the track."""
    segments = driven.segments
    steps = [float(b.times[0] - a.times[-1]) for a, b in itertools.pairwise(segments)]
    if not steps:
        return
    first, second = segments[:2]
    about = f"back to {second.times[0]:.3f} s after {first.times[-1]:.3f} s"
    usual = float(np.nanmedian(driven.intervals))
    if len(steps) > 1:
        even = np.ptp(steps[:-1]) < 3.0 * usual
        about += f", and {len(steps) - 1} times more"
        period = 2.0 * usual - steps[0]  # a segment's first estimate is at its second scan
        about += f": it wraps round every {period:.3f} s" if even else ": several logs"
    yield Finding("the clock jumps", "", steps[0], "s", False, about)


# ---- Motion


def _of_motion(log: Mapping[str, SensorScans], driven: Track) -> Iterator[Finding]:
    """Clocks that are apart, or else faults that a transformation undoes and turned mountings."""
    motions = {
        name: SensorMotion.of(*sensor, driven)
        for name, sensor in log.items()
        if any(scan.size >= SEEN for scan in sensor[0])
    }
    late, lag, likelier = latest(motions) if len(motions) > 1 else ("", 0.0, 0.0)
    if likelier > _LIKELIER and abs(lag) > _LATE:
        about = f"{abs(lag):.2f} s {'late' if lag > 0.0 else 'early'} beside the others; "
        about += f"subtract {lag:+.2f} s"
        yield Finding("the clock of a sensor is off", late, lag, "s", abs(lag) > _USELESS, about)
        if abs(lag) > _USELESS:
            return
    # what few targets agree on is an accident
    headings = {name: each.heading for name, each in motions.items() if each.share > _TRAFFIC}
    off = {
        name: _aligned(log[name][1], heading)
        for name, (heading, _) in headings.items()
        if abs(heading) > _TURNED
    }
    scaled = all(range_rates_agree(scans) > _AGREED for scans, _ in log.values())
    faults = likelier_without(log, off, scaled=scaled)
    for fault, nats in faults:
        about = f"scans fit together better without it: log-likelihood {nats:+.1f} per interval"
        yield Finding(fault.symptom, fault.sensor, nats, "nats", True, about)
    if faults:
        return
    share = min((motion.share for motion in motions.values()), default=1.0)
    if scaled and share < _TRAFFIC and not driven.support.enough:
        about = f"ranges change as Doppler velocities say, but {share:.0%} agree on one motion"
        yield Finding("most targets move", "", share, "share", True, about)
        return
    distorted = list(_of_distortion(log, driven))
    told = {each.sensor for each in distorted}  # what is distorted seems turned
    turned = _of_headings(headings, log)
    yield from (each for each in turned if each.sure or each.sensor not in told)
    yield from distorted


def _aligned(mounting: Mounting, heading: float) -> Mounting:
    """The mounting with which its sensor shows a drive straight ahead."""
    return replace(mounting, yaw=float(wrapped(mounting.yaw - heading)))


def _of_headings(
    headings: Mapping[str, tuple[float, float]], log: Mapping[str, SensorScans]
) -> Iterator[Finding]:
    """Mountings that are turned, by the headings of their sensors."""
    off = {
        name: heading
        for name, (heading, sigma) in headings.items()
        if abs(heading) > max(_TURNED, _SURE * sigma)
    }
    known = [heading for heading, _ in headings.values() if np.isfinite(heading)]
    whole = len(off) == len(known) > 1 and np.ptp(known) < _TURNED
    for name, heading in ({"": float(np.mean(known))} if whole else off).items():
        degrees = float(np.rad2deg(heading))
        about = f"Doppler velocities show a drive at {degrees:+.1f} deg from straight ahead"
        if abs(heading) > _BACKWARDS:  # a vehicle may reverse
            yield Finding("the vehicle drives backwards", name, degrees, "deg", False, about)
            continue
        stated = ", ".join(
            f"--mounting {sensor} {at.x:g} {at.y:g} {np.rad2deg(_aligned(at, heading).yaw):.1f}"
            for sensor, (_, at) in log.items()
            if name in ("", sensor)
        )
        about += f"; state {stated}"
        if abs(abs(heading) - 0.5 * np.pi) < _SQUARE:
            about += ", or are x and y swapped?"
        gross = bool(abs(heading) > _GROSS)
        yield Finding("a mounting is turned", name, degrees, "deg", gross, about)


def _of_distortion(log: Mapping[str, SensorScans], driven: Track) -> Iterator[Finding]:
    """Azimuths at which Doppler velocities contradict the motion that all others show."""
    for name, sensor in log.items():
        found = distortion(sensor, driven)
        if found is None:
            continue
        low, high, worst = found
        sides = [f"below {np.rad2deg(low):.1f}"] * (low > -np.pi)
        sides += [f"above {np.rad2deg(high):.1f}"] * (high < np.pi)
        about = f"by up to {worst:+.2f} m/s; leave out azimuths {' and '.join(sides)} deg"
        symptom = "Doppler velocities are distorted at some azimuths"
        yield Finding(symptom, name, worst, "m/s", False, about)


# ---- The track


def _of_track(driven: Track, alone: Mapping[str, Track]) -> Iterator[Finding]:
    """Findings from the track and those of single sensors."""
    for (first, one), (second, other) in itertools.combinations(alone.items(), 2):
        anees = agreement(one, other)
        if anees > _CONTRARY:
            about = f"the ANEES of their differences is {anees:.0f}, ideally 1; mountings, clocks"
            both = f"{first} and {second}"
            yield Finding("sensors contradict each other", both, anees, "", anees > _APART, about)
    guessed = driven.support.guessed
    if guessed:
        longest = sorted(guessed, key=lambda span: span[0] - span[1])[:_SHOWN]
        spans = ", ".join(f"from {begin:.1f} to {end:.1f} s" for begin, end in sorted(longest))
        more = len(guessed) - len(longest)
        about = f"no estimate {spans}{f' and {more} times more' if more else ''}"
        about += "; the path is guessed there"
        lasting = longest[0][1] - longest[0][0]
        yield Finding("a stretch without estimates", "", lasting, "s", False, about)


def of_gyro(driven: Track, without: Track) -> Iterator[Finding]:
    """A gyro whose yaw rates are not those that the radars show ``without`` it."""
    known = without.converged
    own, off = without.theta[known, 2], (driven.theta - without.theta)[known, 2]
    anees = float(np.sum(off**2 / without.covariance[known, 2, 2])) / max(1, len(own))
    if anees > _CONTRARY:
        about = f"squared differences are {anees:.0f} times the variance of the radars' yaw rate; "
        about += "see the gyro's sign, axis, unit and clock"
        sure = bool(np.sum(off**2) > _LOST * np.sum((own - own.mean()) ** 2))
        yield Finding("the gyro contradicts the radars", "", anees, "", sure, about)


def agreement(first: Track, second: Track) -> float:
    """The ANEES of the differences between two tracks; nan if they cannot be compared."""
    try:
        return float(compare_tracks(first, second).credibility.anees)
    except ValueError:
        return np.nan
