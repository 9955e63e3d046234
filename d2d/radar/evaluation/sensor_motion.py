"""How single sensors move by their Doppler velocities: mountings, clocks and distortions."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.ndimage import median_filter

from d2d._types import Array
from d2d.radar.evaluation.calibration_model import scan_velocities
from d2d.radar.evaluation.faults import wrapped
from d2d.radar.scans.scan import Mounting, RadarScan
from d2d.radar.tracks.track import Track

_SEEN = 5  # targets of a scan, and scans, that show a velocity
_KNOWN = 6.0  # standard deviations of a speed that has a direction
_LEVER = 1.5  # m, standard deviation of a lever arm that is not known
_UNKNOWN = np.deg2rad(0.5)  # error of a heading in a bend whose yaw rate is not known
_LASTING = 1.0  # s, for which the errors of a sensor's velocity are about the same
_AGREED = 0.1, 0.3  # relative and in m/s: a speed that a supported track and its sensor share

_FEW, _WAITED = 10, (1.0, 0.3)  # targets, s until a later scan of few targets, and of more
_DRIFT, _CHANGED = 0.05, 5.0  # rad that targets ahead move aside until then; m/s^2

_LAG_STEP, _LAGS = 0.05, 20.0  # s, of the lags between two clocks, and the longest
_SMOOTHED = 5  # scans, whose median leaves out those that follow traffic
_OVERLAP = 30  # scans of one sensor within the times of another
_EXPLAINED = 0.8  # of a sensor's changing velocity, by that of another at the right lag

_BINS, _IN_BIN = 16, 60  # azimuths of about as many targets, and how many at least
_NEAR = 0.5, 0.05  # m/s, and of the speed: how far static targets' residuals reach
_ALIKE = 5.0  # targets whose errors are about the same


class SensorMotion(NamedTuple):
    """Velocities of a sensor at the times of scans that show one, by their Doppler velocities."""

    times: Array  # (n,)
    velocity: Array  # (n, 2), m/s, along the vehicle's axes
    covariance: Array  # (n, 2, 2)
    mounting: Mounting
    scans: list[RadarScan]
    share: float  # of the targets of all scans that agree on these velocities

    @classmethod
    def of(cls, scans: Sequence[RadarScan], mounting: Mounting) -> "SensorMotion":
        """The velocities of all scans with five targets and more that determine one."""
        seen = [scan for scan in scans if scan.size >= _SEEN]
        if not seen:
            return cls(np.empty(0), np.empty((0, 2)), np.empty((0, 2, 2)), mounting, [], 1.0)
        shown = scan_velocities([(seen, mounting)])
        good = (np.linalg.cond(shown.information) < 1e4) & (shown.targets >= _SEEN)
        covariance = np.linalg.inv(shown.information[good])
        velocity = np.einsum("kij,kj->ki", covariance, shown.projection[good])
        kept = [scan for scan, use in zip(seen, good, strict=True) if use]
        share = float(shown.targets[good].sum() / sum(scan.size for scan in seen))
        return cls(shown.time[good], velocity, covariance, mounting, kept, share)

    @property
    def sigma(self) -> Array:
        """Standard deviations (n,) of the velocity, of both components together."""
        return np.asarray(np.sqrt(np.trace(self.covariance, axis1=1, axis2=2)))

    def heading(self, driven: Track) -> tuple[float, float]:
        """The direction in which the vehicle's origin drives, and its standard deviation, in rad.

        Seen from an origin on the rear axle it is zero if the mounting is right.  A lever arm c
        along x that is not known adds c omega / v in bends.
        """
        if len(driven.segments) > 1 or not driven.support.enough:
            known = np.full((len(self.times), 3), np.nan)
        else:
            known = driven.at(self.times).theta
        omega, guessed = np.nan_to_num(known[:, 2]), np.isnan(known[:, 2]).all()
        origin = self.velocity + omega[:, None] * [self.mounting.y, -self.mounting.x]
        speed = np.hypot(*origin.T)
        fast = speed > _KNOWN * self.sigma
        if not guessed:
            fast &= np.isfinite(known[:, 2])
            tracked = np.hypot(*known[:, :2].T)
            fast &= np.abs(speed - tracked) < _AGREED[0] * tracked + _AGREED[1]
        if fast.sum() < _SEEN:
            return np.nan, np.nan
        angle = np.arctan2(origin[fast, 1], origin[fast, 0])
        weight = (speed / self.sigma)[fast] ** 2
        middle = float(np.angle(np.sum(weight * np.exp(1j * angle))))
        off = wrapped(angle - middle)
        center = _weighted_median(off, weight)
        spread = max(1.4826 * _weighted_median(np.abs(off - center), weight), np.deg2rad(0.1))
        near = np.abs(off - center) < 5.0 * spread
        columns = np.column_stack([np.ones(near.sum()), (omega[fast] / speed[fast])[near]])
        interval = max(float(np.median(np.diff(self.times))), 1e-3)
        share = weight[near] / weight[near].max() / max(_LASTING / interval, 1.0) / spread**2
        information = columns.T @ (share[:, None] * columns)
        covariance = np.linalg.inv(information + np.diag([0.0, _LEVER**-2]))
        best = covariance @ columns.T @ (share * off[near])
        sigma = np.hypot(np.sqrt(covariance[0, 0]), _UNKNOWN if guessed else 0.0)
        return float(wrapped(middle + best[0])), float(sigma)


def _weighted_median(values: Array, weights: Array) -> float:
    order = np.argsort(values)
    half = np.searchsorted(np.cumsum(weights[order]), 0.5 * weights.sum())
    return float(values[order[min(half, len(values) - 1)]])


def range_rates_agree(scans: Sequence[RadarScan]) -> float:
    """The share of targets whose ranges change as their Doppler velocities say; nan if too few.

    Then ranges, Doppler velocities and times have the right units and signs, whatever moves.  Only
    targets count that move farther than the noise of their ranges until a scan some time later.
    """
    times = np.array([scan.time for scan in scans])
    usual = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    few = np.median([scan.size for scan in scans]) <= _FEW
    apart = max(1, round((_WAITED[0] if few else _WAITED[1]) / max(usual, 1e-3)))
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
        agreed.append(matched[np.abs(first.doppler) * passed > 3.0 * sigma])
    every = np.concatenate([[], *agreed])
    return float(every.mean()) if len(every) > 2 * _IN_BIN else np.nan


# ---- Clocks


def latest(motions: Mapping[str, SensorMotion]) -> tuple[str, float, float]:
    """The sensor whose clock most surely is late beside the others', by how much (s), and nats."""
    found = []
    for name, own in motions.items():
        beside = [_lag(own, other) for other in motions.values() if other is not own]
        # beside a late one the others seem early, but not beside each other
        nats = sorted(more for _, more in beside)[(len(beside) - 1) // 2]
        found.append((name, float(np.median([lag for lag, more in beside if more >= nats])), nats))
    return max(found, key=lambda each: each[2])


def _lag(own: SensorMotion, other: SensorMotion) -> tuple[float, float]:
    """The most likely lag of a sensor beside another in s, and the nats that it gains.

    Both components of the sensor's velocity are regressed on those of the other a lag before, so
    that neither mountings nor lever arms matter.
    """
    if min(len(own.times), len(other.times)) < _OVERLAP:
        return 0.0, 0.0
    mine, theirs = (median_filter(each.velocity, (_SMOOTHED, 1)) for each in (own, other))
    half = 0.5 * min(np.ptp(own.times), np.ptp(other.times))
    count = int(min(_LAGS, half) / _LAG_STEP)
    steps = _LAG_STEP * np.arange(-count, count + 1)
    residuals = np.full(len(steps), np.inf)
    for i, lag in enumerate(steps):
        at = own.times - lag
        inside = (at >= other.times[0]) & (at <= other.times[-1])
        if inside.sum() < _OVERLAP:
            continue
        shown = [np.interp(at[inside], other.times, column) for column in theirs.T]
        columns = np.column_stack([np.ones(inside.sum()), *shown])
        rest = mine[inside] - columns @ np.linalg.lstsq(columns, mine[inside])[0]
        total = ((mine[inside] - mine[inside].mean(axis=0)) ** 2).sum()
        residuals[i] = (rest**2).sum() / max(total, 1e-9) + 1e-6
    best = int(residuals.argmin())
    if not residuals[best] < 1.0 - _EXPLAINED:
        return 0.0, 0.0
    independent = len(own.times) * min(np.median(np.diff(own.times)) / _LASTING, 1.0)
    return float(steps[best]), float(independent * np.log(residuals[count] / residuals[best]))


# ---- Distortion


def distortion(motion: SensorMotion) -> tuple[float, float, float] | None:
    """The azimuths (rad) between which Doppler velocities are those of one motion.

    With the largest deviation (m/s) beyond them.  None where there is none, or too few targets.
    """
    speed = np.hypot(*motion.velocity.T)
    azimuths, residuals = [], []
    moving = np.flatnonzero(speed > _KNOWN * motion.sigma)
    for scan, velocity, fast in ((motion.scans[i], motion.velocity[i], speed[i]) for i in moving):
        angle = scan.azimuth + motion.mounting.yaw
        rest = scan.doppler + np.cos(angle) * velocity[0] + np.sin(angle) * velocity[1]
        near = np.abs(rest) < _NEAR[0] + _NEAR[1] * fast
        azimuths.append(scan.azimuth[near])
        residuals.append(rest[near])
    azimuth, residual = np.concatenate([[], *azimuths]), np.concatenate([[], *residuals])
    bins = min(_BINS, len(azimuth) // _IN_BIN)
    if bins < 6:
        return None
    parts = np.array_split(np.argsort(azimuth), bins)
    middle = np.array([np.median(azimuth[part]) for part in parts])
    offset = np.array([np.median(residual[part]) for part in parts])
    sigma = np.array(
        [1.25 * residual[part].std() / np.sqrt(len(part) / _ALIKE) + 1e-6 for part in parts]
    )
    columns = np.column_stack([np.cos(middle), np.sin(middle)])
    noise = float(np.median(np.concatenate([scan.sigma_doppler for scan in motion.scans])))
    limit = np.maximum(4.0 * sigma, noise)
    for used in range(bins, bins // 2 - 1, -1):
        for first in range(bins - used + 1):
            part = slice(first, first + used)
            fit = np.linalg.lstsq(columns[part] / sigma[part, None], offset[part] / sigma[part])[0]
            rest = offset - columns @ fit
            if (np.abs(rest[part]) < limit[part]).all():
                if used == bins:
                    return None
                low = azimuth[parts[first]].min() if first else -np.pi
                high = azimuth[parts[first + used - 1]].max() if first + used < bins else np.pi
                return float(low), float(high), float(rest[np.abs(rest).argmax()])
    return None
