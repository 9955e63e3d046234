"""How single sensors move by their Doppler velocities: mountings, clocks and distortions."""

import itertools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from d2d._types import Array
from d2d.radar.evaluation.calibration_model import scan_velocities
from d2d.radar.evaluation.faults import wrapped
from d2d.radar.evaluation.sandwich import covariance_of_sum
from d2d.radar.scans.scan import Mounting, RadarScan
from d2d.radar.tracks.track import Track

_SEEN = 5  # targets of a scan, and scans, that show a velocity
_KNOWN = 6.0  # standard deviations of a speed that has a direction
_LEVER = 0.3, 0.5  # m, and of the sensor's distance from the origin: a lever arm that is not known
_UNKNOWN = np.deg2rad(0.5)  # least error of a heading in bends whose yaw rate is not known
_AGREED = 0.1, 0.3  # relative and in m/s: a speed that a supported track and its sensor share

_FEW, _WAITED = 10, (1.0, 0.3)  # targets, s until a later scan of few targets, and of more
_DRIFT, _CHANGED = 0.05, 5.0  # rad that targets ahead move aside until then; m/s^2

_LAG_STEP, _LAGS = 0.05, 20.0  # s, of the lags between two clocks, and the longest
_SMOOTHED = 5  # scans, whose median leaves out those that follow traffic
_LASTING = 1.0  # s, for which the errors of a sensor's velocity are about the same
_USED, _OVERLAP = 200, 30  # scans of a sensor for its clock; within the times of another
_EXPLAINED = 0.8  # of a sensor's changing velocity, by that of another at the right lag

_BINS, _IN_BIN = 16, 60  # azimuths of about as many targets, and how many at least
_NEAR = 0.5, 0.05  # m/s, and of the speed: how far static targets' residuals reach
_ALIKE = 5.0  # targets whose errors are about the same


class SensorMotion(NamedTuple):
    """Velocities of a sensor at the times of scans that show one, by their Doppler velocities."""

    times: Array  # (n,)
    velocity: Array  # (n, 2), m/s, along the vehicle's axes
    covariance: Array  # (n, 2, 2)
    tracked: Array  # (n, 3), of the vehicle by a track; nan where it has none
    mounting: Mounting
    scans: list[RadarScan]
    share: float  # of the targets of all scans that agree on these velocities

    @classmethod
    def of(cls, scans: Sequence[RadarScan], mounting: Mounting, driven: Track) -> "SensorMotion":
        """The velocities of all scans with five targets and more that determine one."""
        seen = [scan for scan in scans if scan.size >= _SEEN]
        if not seen:
            empty = np.empty((0, 2))
            return cls(empty[:, 0], empty, np.empty((0, 2, 2)), np.empty((0, 3)), mounting, [], 1.0)
        shown = scan_velocities([(seen, mounting)])
        good = (np.linalg.cond(shown.information) < 1e4) & (shown.targets >= _SEEN)
        times, covariance = shown.time[good], np.linalg.inv(shown.information[good])
        velocity = np.einsum("kij,kj->ki", covariance, shown.projection[good])
        kept = [scan for scan, use in zip(seen, good, strict=True) if use]
        share = float(shown.targets[good].sum() / sum(scan.size for scan in seen))
        usable = len(driven.segments) == 1 and driven.support.enough
        tracked = driven.at(times).theta if usable else np.full((len(times), 3), np.nan)
        return cls(times, velocity, covariance, tracked, mounting, kept, share)

    @property
    def sigma(self) -> Array:
        """Standard deviations (n,) of the velocity, of both components together."""
        return np.asarray(np.sqrt(np.trace(self.covariance, axis1=1, axis2=2)))

    @property
    def origin(self) -> Array:
        """Velocities (n, 2) of the vehicle's origin; the sensor's own where nothing is tracked."""
        lever = np.array([self.mounting.y, -self.mounting.x])
        return np.asarray(self.velocity + np.nan_to_num(self.tracked[:, 2:]) * lever)

    @property
    def heading(self) -> tuple[float, float]:
        """The direction in which the vehicle's origin drives, and its standard deviation, in rad.

        Seen from an origin on the rear axle it is zero if the mounting is right.  A lever arm c
        along x that is not known adds c omega / v in bends.
        """
        origin, omega = self.origin, np.nan_to_num(self.tracked[:, 2])
        speed = np.hypot(*origin.T)
        fast, guessed = speed > _KNOWN * self.sigma, np.isnan(self.tracked).all()
        if not guessed:  # what follows traffic shows another speed
            known = np.hypot(*self.tracked[:, :2].T)
            fast &= np.abs(speed - known) < _AGREED[0] * known + _AGREED[1]
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
        share = weight[near] / weight[near].max() / spread**2
        lever = np.hypot(_LEVER[0], _LEVER[1] * np.hypot(self.mounting.x, self.mounting.y))
        inverse = np.linalg.inv(columns.T @ (share[:, None] * columns) + np.diag([0.0, lever**-2]))
        best = inverse @ columns.T @ (share * off[near])
        scores = (share * (off[near] - columns @ best))[:, None] * columns
        covariance = inverse @ covariance_of_sum(scores)[0] @ inverse
        # the lever arm is known from the prior alone, which the scores do not show
        covariance += np.outer(inverse[:, 1], inverse[:, 1]) * lever**-2
        # of several bends, to both sides, half of the usual deviation is left
        bends = max(_UNKNOWN, 0.5 * float(np.median(np.abs(off - center)))) if guessed else 0.0
        sigma = np.hypot(np.sqrt(covariance[0, 0]), bends)
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
    lags = {
        pair: _lag(motions[pair[0]], motions[pair[1]])
        for pair in itertools.combinations(motions, 2)
    }
    lags |= {(b, a): (-lag, nats) for (a, b), (lag, nats) in lags.items()}
    found = []
    for name in motions:
        beside = [each for (own, _), each in lags.items() if own == name]
        # beside a late one the others seem early, but not beside each other
        nats = sorted(more for _, more in beside)[(len(beside) - 1) // 2]
        found.append((name, float(np.median([lag for lag, more in beside if more >= nats])), nats))
    return max(found, key=lambda each: each[2])


def _lag(own: SensorMotion, other: SensorMotion) -> tuple[float, float]:
    """The most likely lag of a sensor beside another in s, and the nats that it gains.

    At the right lag, both show one velocity of the vehicle's origin, but for the angle of a
    mounting that may be wrong.
    """
    if min(len(own.times), len(other.times)) < _OVERLAP:
        return 0.0, 0.0
    rows = np.unique(np.linspace(0, len(own.times) - 1, _USED).astype(int))
    count = int(min(_LAGS, np.ptp(own.times), np.ptp(other.times)) / _LAG_STEP)
    lags = _LAG_STEP * np.arange(-count, count + 1)
    at = own.times[rows] - lags[:, None]
    mine, theirs = (median_filter(each.origin, (_SMOOTHED, 1)) @ [1, 1j] for each in (own, other))
    mine, shown = mine[rows], np.interp(at, other.times, theirs)
    inside = (at >= other.times[0]) & (at <= other.times[-1])
    stated = inside & inside[count]  # the same scans, at the clocks as they are
    stated[stated.sum(axis=1) < _OVERLAP] = inside[count]
    noise = own.sigma[rows] ** 2 + np.interp(own.times[rows], other.times, other.sigma**2)

    def left(shown: Array, used: NDArray[np.bool_]) -> Array:
        """The mean squares of what is left, at least those of the noise."""
        squares = np.where(used, np.abs(mine) ** 2 + np.abs(shown) ** 2, 0.0).sum(axis=1)
        alike = np.abs(np.where(used, mine * np.conj(shown), 0.0).sum(axis=1))
        least = np.where(used, noise, 0.0).sum(axis=1)
        return np.asarray(
            np.maximum(squares - 2.0 * alike, least) / np.maximum(used.sum(axis=1), 1)
        )

    rest, sizes = left(shown, inside), inside.sum(axis=1)
    middle = np.where(inside, mine, 0.0).sum(axis=1) / np.maximum(sizes, 1)
    changes = np.where(inside, np.abs(mine - middle[:, None]) ** 2, 0.0).sum(axis=1)
    usable = (sizes >= _OVERLAP) & (rest * sizes < (1.0 - _EXPLAINED) * changes)
    if not (usable.any() and inside[count].any()):
        return 0.0, 0.0
    independent = sizes * min(float(np.median(np.diff(own.times[rows]))) / _LASTING, 1.0)
    rest[~usable] = np.inf
    gains = independent * np.log(np.maximum(left(shown[count], stated) / rest, 1.0))
    best = int(gains.argmax())
    return float(lags[best]), float(gains[best])


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
