"""The acceleration of a track."""

import numpy as np

from d2d._types import Array

# s to either side, over which an acceleration is fitted; a little more than half a second, so that
# the rounding of times does not decide which estimates of a radar with steps of 0.1 s count
_SLOPE_SPAN = 0.5 + 1e-6


def accelerations(times: Array, theta: Array) -> Array:
    """Slope (n, 3) of velocities (n, 3), by least squares within half a second to either side."""
    place = np.arange(len(times))
    first = np.searchsorted(times, times - _SLOPE_SPAN, side="left") - place
    last = np.searchsorted(times, times + _SLOPE_SPAN, side="right") - place
    sums = np.zeros((len(times), 9))
    # relative to each estimate: sums over the whole drive lose the digits that a slope needs
    for shift in range(int(first.min(initial=0)), int(last.max(initial=0))):
        near = np.flatnonzero((first <= shift) & (shift < last))
        t = (times[near + shift] - times[near])[:, None]
        value = theta[near + shift] - theta[near]
        sums[near] += np.hstack([np.ones_like(t), t, t**2, value, t * value])
    count, time, square, value, product = np.split(sums, [1, 2, 3, 6], axis=1)
    spread = square - time**2 / count
    enough = count > 1.0  # a single estimate has no slope
    return np.where(enough, (product - time * value / count) / np.where(enough, spread, 1.0), 0.0)
