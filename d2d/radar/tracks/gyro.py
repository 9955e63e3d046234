"""The yaw rates of a gyro beside the radars."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from d2d._checks import Bounded, Bounds, check_finite, check_shape, number
from d2d._frozen import Frozen
from d2d._types import Array

RATE = Bounds(most=2.0 * np.pi, unit="in rad/s, ", hint="; are these degrees per second?")
_LONGEST = 0.3  # s before a round, of which the mean yaw rate is used


@dataclass(frozen=True, eq=False)
class Gyro(Frozen, Bounded):
    """A gyro's yaw rates: the vehicle's, with white noise and a bias that stays.

    Raises a ``ValueError`` if times do not increase, shapes differ or a number is out of bounds.

    Attributes
    ----------
    sigma : float, rad/s
        Standard deviation of the noise of a single yaw rate.
    bias : float, rad/s
        Standard deviation of the bias, which the track learns.
    times : (n,) array, s
        By the clock of the radars; empty for a `Tracker` that gets them by `Tracker.add_gyro`.
    yaw_rates : (n,) array, rad/s
        Counter-clockwise as seen from above.
    """

    sigma: float = number(float(np.deg2rad(0.1)), Bounds(least=1e-9, most=1e3))
    bias: float = number(float(np.deg2rad(1.0)), Bounds(least=0.0, most=1e3))
    times: ArrayLike = field(default_factory=lambda: np.empty(0))
    yaw_rates: ArrayLike = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        super().__post_init__()
        checked = check_rates(self.times, self.yaw_rates)
        for name, array in zip(("times", "yaw_rates"), checked, strict=True):
            self._keep(name, array)


def check_rates(times: ArrayLike, yaw_rates: ArrayLike) -> tuple[Array, Array]:
    """The yaw rates of a gyro at their times (n,), checked."""
    known = check_finite("times", times, "(n,)")
    rates = RATE.array("yaw_rates", yaw_rates)
    check_shape("yaw_rates", rates, f"({len(known)},)", like="times")
    if not (np.diff(known) > 0.0).all():
        raise ValueError("times of the gyro must be strictly increasing, but are not")
    return known, rates


class MeanRate(NamedTuple):
    """The mean of some yaw rates before a time."""

    value: float  # rad/s
    delay: float  # s, from the time to the mean of theirs: negative
    variance: float  # of the mean's noise


class GyroRates:
    """The yaw rates of a gyro that rounds to come may need."""

    def __init__(self, gyro: Gyro) -> None:
        self.gyro, self.used = gyro, 0  # rounds that had yaw rates
        self._times, self._rates = check_rates(gyro.times, gyro.yaw_rates)

    def add(self, times: ArrayLike, yaw_rates: ArrayLike) -> None:
        """Take the next yaw rates (n,), which are later than those before."""
        known, rates = check_rates(times, yaw_rates)
        both = np.append(self._times, known), np.append(self._rates, rates)
        self._times, self._rates = check_rates(*both)

    def before(self, time: float) -> MeanRate | None:
        """The mean of those shortly before a time in s, or at it; all until then are dropped."""
        until = int(np.searchsorted(self._times, time, side="right"))
        used = slice(int(np.searchsorted(self._times, time - _LONGEST)), until)
        times, rates = self._times[used], self._rates[used]
        self._times, self._rates = self._times[until:], self._rates[until:]
        if not len(times):
            return None
        self.used += 1
        variance = self.gyro.sigma**2 / len(times)
        return MeanRate(float(rates.mean()), float(times.mean()) - time, variance)
