"""Motion of single sensors by their Doppler velocities: mountings, clocks and distortions."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy

from d2d._types import Array
from d2d.bootstrap import covariance_of_sum
from d2d.radar.evaluation.calibration_model import scan_velocities
from d2d.radar.scans.scan import Mounting, RadarScan, doppler_velocity, level
from d2d.radar.tracks.rounds import SensorScans
from d2d.radar.tracks.track import Track

SEEN = 5  # targets of a scan, and scans, that show a velocity
_KNOWN = 6.0  # standard deviations of a speed that has a direction
_LEVER = 0.3, 0.5  # m, and of the sensor's distance from the origin: a lever arm that is not known
_UNKNOWN = np.deg2rad(0.5)  # least error of a heading in bends whose yaw rate is not known
_AGREED = 0.1, 0.3  # relative and in m/s: a speed that a supported track and its sensor share

_WAITED = 1.0  # s until a later scan: traffic ahead is slow beside its radar
_DRIFT, _CHANGED = 0.05, 5.0  # rad that targets ahead move aside until then; m/s^2

_LAG_STEP, _LAGS = 0.05, 20.0  # s, of the lags between two clocks, and the longest
_SMOOTHED = 5  # scans, whose median leaves out those that follow traffic
_LASTING = 1.0  # s, for which the errors of a sensor's velocity are about the same
_OVERLAP, _LONGEST = 3.0, 600.0  # s that two sensors have in common, and of these that are used
_EXPLAINED = 0.8  # of a sensor's changing velocity, by that of another at the right lag

_BINS, _IN_BIN = 16, 60  # azimuths of about as many targets, and how many at least
_NEAR = 0.5, 0.05  # m/s, and of the speed: how far static targets' residuals reach
_ALIKE = 5.0  # targets whose errors are about the same


class SensorMotion(NamedTuple):
    """Velocities of a sensor at the times of scans that show one, by their Doppler velocities."""

    times: Array  # (n,)
    velocity: Array  # (n, 2), m/s, along the vehicle's axes
    sigma: Array  # (n,), of both components together
    tracked: Array  # (n, 3), of the vehicle by a track; nan where it has none
    mounting: Mounting
    share: float  # of the targets of all scans that agree on these velocities

    @classmethod
    def of(cls, scans: Sequence[RadarScan], mounting: Mounting, driven: Track) -> "SensorMotion":
        """The velocities of all scans with five targets and more that determine one."""
        seen = [scan for scan in scans if scan.size >= SEEN]
        shown = scan_velocities([(seen, mounting)])
        good = (np.linalg.cond(shown.triangle[:, :2, :2]) < 1e2) & (shown.targets >= SEEN)
        times, triangle = shown.time[good], shown.triangle[good]
        root = np.linalg.inv(triangle[:, :2, :2])
        velocity = np.einsum("kij,kj->ki", root, triangle[:, :2, 2])
        share = float(shown.targets[good].sum() / sum(scan.size for scan in seen))
        usable = len(driven.segments) == 1 and driven.support.enough
        tracked = driven.at(times).theta if usable else np.full((len(times), 3), np.nan)
        return cls(times, velocity, np.linalg.norm(root, axis=(1, 2)), tracked, mounting, share)

    @property
    def origin(self) -> Array:
        """Velocities (n, 2) of the vehicle's origin; the sensor's own where nothing is tracked."""
        lever = np.array([self.mounting.y, -self.mounting.x])
        return np.asarray(self.velocity + np.nan_to_num(self.tracked[:, 2:]) * lever)

    @property
    def heading(self) -> tuple[float, float]:
        """The direction in which the vehicle's origin drives, and its standard deviation (rad)."""
        origin, speed = self.origin, np.hypot(*self.origin.T)
        fast, guessed = speed > _KNOWN * self.sigma, bool(np.isnan(self.tracked).all())
        if not guessed:  # what follows traffic shows another speed
            known = np.hypot(*self.tracked[:, :2].T)
            fast &= np.abs(speed - known) < _AGREED[0] * known + _AGREED[1]
        if fast.sum() < SEEN:
            return np.nan, np.nan
        lever = np.hypot(_LEVER[0], _LEVER[1] * np.hypot(self.mounting.x, self.mounting.y))
        # a lever arm c that is not known adds c omega / v in bends
        by_lever = lever * np.nan_to_num(self.tracked[fast, 2]) / speed[fast]
        sigma = np.hypot(self.sigma[fast] / speed[fast], by_lever)
        angle = np.arctan2(origin[fast, 1], origin[fast, 0])
        middle = float(np.angle(np.sum(np.exp(1j * angle) / sigma**2)))
        off = wrapped(angle - middle)
        aside = np.abs(off - np.median(off))
        usual = float(np.median(aside))
        near = aside < 5.0 * max(1.4826 * usual, np.deg2rad(0.1))
        weight = 1.0 / sigma[near] ** 2 / np.sum(1.0 / sigma[near] ** 2)
        best = float(weight @ off[near])
        ((variance,),), _ = covariance_of_sum((weight * (off[near] - best))[:, None])
        # of several bends, to both sides, half of the usual deviation is left
        bends = max(_UNKNOWN, 0.5 * usual) if guessed else float(weight @ by_lever[near])
        return float(wrapped(middle + best)), float(np.hypot(np.sqrt(variance), bends))


def wrapped(angle: Any) -> Any:
    """Angles in rad from -pi to pi."""
    return np.arctan2(np.sin(angle), np.cos(angle))


def range_rates_agree(scans: Sequence[RadarScan]) -> float:
    """The share of targets whose ranges change as their Doppler velocities say; nan if too few."""
    times = np.array([scan.time for scan in scans])
    usual = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    apart = max(1, round(_WAITED / max(usual, 1e-3)))
    agreed = []
    for first, second in zip(scans, scans[apart:], strict=False):
        passed = second.time - first.time
        if not (first.size and second.size and 0.0 < passed < 2.0 * apart * usual):
            continue
        sigma = np.sqrt(2.0) * first.sigma_range
        speed = 0.5 * (first.doppler[:, None] + second.doppler)
        off = np.abs(second.range - first.range[:, None] - passed * speed) / sigma[:, None]
        beside = np.abs(second.azimuth - first.azimuth[:, None])
        reach = 3.0 * first.sigma_azimuth[:, None] + _DRIFT
        alike = np.abs(second.doppler - first.doppler[:, None]) < _CHANGED * passed
        matched = ((off < 2.0) & (beside < reach) & alike).any(axis=1)
        # of those that have moved farther than the noise of their ranges
        agreed.append(matched[np.abs(first.doppler) * passed > 3.0 * sigma])
    every = np.concatenate([[], *agreed])
    return float(every.mean()) if len(every) > 2 * _IN_BIN else np.nan


def latest(motions: Mapping[str, SensorMotion]) -> tuple[str, float, float]:
    """The sensor whose clock most surely is late beside the others', by how much (s), and nats."""
    pairs = itertools.combinations(motions, 2)
    lags = {(a, b): _lag(motions[a], motions[b]) for a, b in pairs}
    lags |= {(b, a): (-lag, nats) for (a, b), (lag, nats) in lags.items()}
    found = []
    for name in motions:
        beside = [each for (own, _), each in lags.items() if own == name]
        # beside a late one the others seem early, but not beside each other
        nats = sorted(more for _, more in beside)[(len(beside) - 1) // 2]
        found.append((name, float(np.median([lag for lag, more in beside if more >= nats])), nats))
    return max(found, key=lambda each: each[2])


def _lag(own: SensorMotion, other: SensorMotion) -> tuple[float, float]:
    """The most likely lag of a sensor beside another in s, and the nats that it gains."""
    if min(len(own.times), len(other.times)) < SEEN:
        return 0.0, 0.0
    begin = max(own.times[0], other.times[0]) - _LAGS
    end = min(own.times[-1], other.times[-1], begin + _LONGEST) + _LAGS
    times = np.arange(begin, end, _LAG_STEP)
    count = int(min(_LAGS, np.ptp(own.times), np.ptp(other.times)) / _LAG_STEP)
    if len(times) <= count:
        return 0.0, 0.0
    rows = []
    for each in (own, other):
        smooth = scipy.ndimage.median_filter(each.origin, (_SMOOTHED, 1)) @ [1, 1j]
        rows.append(np.interp(times, each.times, smooth, np.nan, np.nan))
    (a, b), (seen, seen_there) = np.nan_to_num(rows), np.isfinite(rows).astype(float)
    lags = _LAG_STEP * np.arange(-count, count + 1)
    pairs = [(seen, seen_there), (np.abs(a) ** 2, seen_there), (seen, np.abs(b) ** 2)]
    pairs += [(a, b), (a, seen_there)]  # zero where one is not known
    there = slice(len(times) - 1 - count, len(times) + count)
    shared, *sums = (scipy.signal.correlate(*pair)[there] for pair in pairs)
    shared = np.round(shared)
    of_own, of_other, product, middle = sums / np.maximum(shared, 1.0)
    # at the right lag both show one velocity, but for the angle of a mounting
    left = (of_own + of_other).real - 2.0 * np.abs(product)
    explained = left < (1.0 - _EXPLAINED) * (of_own.real - np.abs(middle) ** 2)
    known = (_LAG_STEP * shared >= _OVERLAP) & (explained | (lags == 0.0))
    if not known[count]:
        return 0.0, 0.0
    noise = float(np.mean(own.sigma**2) + np.mean(other.sigma**2))
    rest = np.maximum(np.where(known, left, left[count]), noise)
    gains = _LAG_STEP * shared / _LASTING * np.log(rest[count] / rest)
    best = int(gains.argmax())
    elsewhere = gains[np.abs(lags - lags[best]) > _LASTING].max(initial=0.0)  # if it is periodic
    return float(lags[best]), float(gains[best] - elsewhere)


def residuals_of(sensor: SensorScans, driven: Track) -> tuple[Array, Array]:
    """Azimuth (rad) and Doppler residual (m/s), each (n,), of the targets that stand still."""
    scans, mounting = sensor
    found = [np.empty((2, 0))]
    for part in driven.segments:
        own = [s for s in scans if s.size and part.times[0] <= s.time <= part.times[-1]]
        for scan, theta in zip(own, part.at([s.time for s in own]).theta, strict=True):
            flat, place = level(scan, mounting)
            if np.isfinite(theta).all():
                residual = flat.doppler - doppler_velocity(theta, flat.azimuth, place)
                still = np.abs(residual) < _NEAR[0] + _NEAR[1] * np.abs(theta[0])
                found.append(np.stack([flat.azimuth, residual])[:, still])
    azimuth, residual = np.concatenate(found, axis=1)
    return azimuth, residual


def distortion(sensor: SensorScans, driven: Track) -> tuple[float, float, float] | None:
    """Azimuths (rad) between which residuals are small, and the largest (m/s); None if all are."""
    azimuth, residual = residuals_of(sensor, driven)
    bins = min(_BINS, len(azimuth) // _IN_BIN)
    if bins < 6:
        return None
    parts = np.array_split(np.argsort(azimuth), bins)
    middle = np.array([np.median(azimuth[part]) for part in parts])
    offset = np.array([np.median(residual[part]) for part in parts])
    spread = np.array([residual[part].std() / np.sqrt(len(part) / _ALIKE) for part in parts])
    columns = np.column_stack([np.cos(middle), np.sin(middle)])
    noise = float(np.median(np.concatenate([scan.sigma_doppler for scan in sensor[0]])))
    limit, weight = np.maximum(5.0 * spread, noise), 1.0 / (spread + 1e-6)
    for used in range(bins, bins // 2 - 1, -1):
        for first in range(bins - used + 1):
            part = slice(first, first + used)
            of_part = columns[part] * weight[part, None], offset[part] * weight[part]
            rest = offset - columns @ np.linalg.lstsq(*of_part)[0]
            if (np.abs(rest[part]) < limit[part]).all():
                if used == bins:
                    return None
                low = azimuth[parts[first]].min() if first else -np.pi
                high = azimuth[parts[first + used - 1]].max() if first + used < bins else np.pi
                return float(low), float(high), float(rest[np.abs(rest).argmax()])
    return None
