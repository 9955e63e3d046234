"""Whether the Doppler velocities of a sensor are those of another time than its stamps say."""

import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from statistics import median

import numpy as np

from d2d._types import Array
from d2d.radar.motion.pairs import ScanPair
from d2d.radar.scans.scan import Mounting, RadarScan, doppler_gradients
from d2d.radar.tracks.finding import Finding, warn_of

_SEEN = 5  # targets of a scan that show the velocity of its sensor
_WITHIN = (3.0, 0.5)  # m/s from the joint estimate, then from the sensor's own: may stand still
_APART = 1e-3  # least squared sine between the directions in which they lie
# Estimates, s and standard deviations that are needed.  On RadarScenes 105, whose radars have one
# clock, the largest lag found is 0.058 s, and 0.044 s at a horizon of 0.3 s.
_ROUNDS, _LATE, _SURE = 50, 0.07, 5.0
_USELESS = 0.2  # s, beyond which a sensor only disturbs the others
_BEHIND = 0.5  # s, over which an acceleration is measured
_ROUNDING = 1e-9  # relative
_ALIKE = 5.0  # estimates whose errors are about the same, as traffic lasts for some of them


class Lateness:
    """Compares each sensor's Doppler velocities with those of the others while the speed changes.

    A sensor that is late by L shows a forward velocity that is L times the acceleration too small.
    Running sums give L by linear regression, beside what a wrong mounting does: it grows with the
    speed and the yaw rate.  Where these change as the acceleration does, L stays uncertain.
    """

    def __init__(self, names: Mapping[Mounting, str]) -> None:
        self._names = names
        self._sums = {mounting: np.zeros((5, 5)) for mounting in names}
        self._driven: deque[tuple[float, Array]] = deque()
        self._count, self._told = 0, False

    def add(self, time: float, theta: Array, pairs: Sequence[ScanPair]) -> None:
        """Take the velocity (3,) at the time of a round of pairs, and warn if enough is known."""
        self._driven.append((time, theta))
        while len(self._driven) > 2 and time - self._driven[1][0] >= _BEHIND:
            self._driven.popleft()
        start, before = self._driven[0]
        if len(pairs) < 2 or start == time:
            return
        acceleration = (theta - before) / (time - start)
        found = {}
        for pair in pairs:
            own = theta + (pair.current.time - time) * acceleration
            excess = _excess(pair.current, pair.mounting, own)
            if math.isfinite(excess):
                found[pair.mounting] = excess
        seen = [1.0, float(theta[0]), float(theta[2]), float(acceleration[0])]
        for mounting, excess in found.items():
            others = [value for other, value in found.items() if other != mounting]
            if others and mounting in self._sums:
                row = np.array([*seen, excess - median(others)])
                self._sums[mounting] += row[:, None] * row
        self._count += 1
        if self._count % (2 * _ROUNDS) == 0:  # one that misses some rounds has been seen enough
            self.warn()

    def warn(self) -> None:
        """Warn once of the sensor that is surely late or early, the worst if there are several."""
        sure = [each for each in self.lags() if abs(each[1]) > max(_LATE, _SURE * each[2])]
        if sure and not self._told:
            self._told = True
            # beside a late sensor, the others seem early by half as much
            name, lag, _ = max(sure, key=lambda each: abs(each[1]))
            told = f"{abs(lag):.2f} s {'late' if lag > 0.0 else 'early'}"
            warn_of(
                Finding("the clock of a sensor is off", name, lag, "s", abs(lag) > _USELESS, told),
                f"{name} seems to be {told}: when the vehicle accelerates, its Doppler velocities "
                "are those that the other sensors have at another time",
            )

    def lags(self) -> Iterable[tuple[str, float, float]]:
        """Name, lag in s and its standard deviation, of the sensors that have been seen enough."""
        for mounting, sums in self._sums.items():
            left = _without_first(sums, 3)
            spread, slope = float(left[3, 3]), float(left[3, 4] / (left[3, 3] or 1.0))
            if sums[0, 0] >= _ROUNDS and spread > _ROUNDING * sums[3, 3]:
                rest = max(float(left[4, 4]) - slope**2 * spread, 0.0) / float(sums[0, 0])
                yield self._names[mounting], -slope, math.sqrt(_ALIKE * rest / spread)


def _without_first(sums: Array, count: int) -> Array:
    """Sums of products without what the first columns explain of the others."""
    left = sums
    for k in range(count):
        if left[k, k] > _ROUNDING * sums[k, k]:
            left = left - left[:, [k]] * left[k] / left[k, k]
    return left


def _excess(scan: RadarScan, mounting: Mounting, theta: Array) -> float:
    """How much larger v_x, in m/s, is by a scan's static targets; nan if it shows none.

    Least squares of the excess of both components: a turned mounting changes v_y, and hardly v_x.
    """
    gain, _ = doppler_gradients(scan.azimuth, mounting)
    sight, rest = gain[:, :2], scan.doppler - gain @ theta
    found, left = np.zeros(2), rest
    for within in _WITHIN:
        near = np.abs(left) < within
        if near.sum() < _SEEN:
            return math.nan
        seen = sight[near]
        (xx, xy), (_, yy) = (seen.T @ seen).tolist()
        x, y = (seen.T @ rest[near]).tolist()
        determinant = xx * yy - xy * xy
        if determinant < _APART * xx * yy:
            return math.nan
        found = np.array([yy * x - xy * y, xx * y - xy * x]) / determinant
        left = rest - sight @ found
    return float(found[0])
