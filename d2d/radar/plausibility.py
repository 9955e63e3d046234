"""What a vehicle can do, and what it cannot."""

from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np

from d2d._checks import check_positive, check_scalar
from d2d._types import Array

_SIGMAS = 3.0  # standard deviations that an estimate may lie beyond a limit


class State(NamedTuple):
    """A velocity [v_x, v_y, omega] at its time, with its covariance."""

    time: float  # s
    theta: Array  # (3,)
    covariance: Array  # (3, 3)

    @property
    def sigmas(self) -> Array:
        """Standard deviations (3,)."""
        return np.sqrt(np.diagonal(self.covariance))

    @property
    def yaw_rate_of_slip(self) -> float:
        """How far omega would move, in rad/s, if v_y were known to be zero."""
        return float(self.theta[1] * self.covariance[1, 2] / self.covariance[1, 1])


@dataclass(frozen=True)
class VehicleLimits:
    """How fast a vehicle moves, and how fast its velocity changes.

    The defaults are far beyond what a road vehicle does.  An estimate that exceeds a
    limit by more than three of its own standard deviations is not accepted: radar alone sometimes
    finds an optimum that no vehicle could follow, and its inlier probability does not tell.

    Attributes
    ----------
    speed : float, m/s
        Of the vehicle frame's origin.
    yaw_rate : float, rad/s
    acceleration : float, m/s^2
        Of v_x and of v_y, from one accepted estimate to the next.
    yaw_acceleration : float, rad/s^2
    uncertainty : float, rad/s
        Of the standard deviation of omega, beyond which an estimate tells nothing.
    slip : float, rad/s
        By how much the yaw rate may move if v_y is taken as zero, whatever its standard deviation.
        A single sensor ahead of the axle knows its own lateral velocity well and the yaw rate
        badly: an error of the yaw rate then shows as side slip.  The default is for an origin near
        the rear axle; where it is far from the axle, or the wheels turn all ways, take a larger
        one.

    Raises
    ------
    ValueError
        If a limit is not positive; the message names it.  ``math.inf`` switches one off.
    """

    speed: float = 100.0
    yaw_rate: float = 3.0
    acceleration: float = 40.0
    yaw_acceleration: float = 5.0
    uncertainty: float = 0.12
    slip: float = 0.15

    def __post_init__(self) -> None:
        for field in fields(self):
            limit = getattr(self, field.name)
            if not (np.isscalar(limit) and limit == np.inf):
                check_positive(field.name, check_scalar(field.name, limit))
            object.__setattr__(self, field.name, float(limit))

    def for_doppler(self, doppler: bool) -> "VehicleLimits":
        """The limits of an estimate with or without Doppler velocities.

        Without them no sensor knows its lateral velocity, so that a side slip says nothing about
        omega; and what is known at all is known badly.
        """
        return self if doppler else replace(self, slip=np.inf, uncertainty=np.inf)

    def exceeded(self, state: State, last: State | None) -> str:
        """What the state exceeds, in words; empty if it is plausible after the last one."""
        spread = _SIGMAS * state.sigmas
        speed, turn = float(np.hypot(*state.theta[:2])), abs(float(state.theta[2]))
        if speed > self.speed + float(np.hypot(*spread[:2])):
            return f"a speed of {speed:.1f} m/s"
        if turn > self.yaw_rate + spread[2]:
            return f"a yaw rate of {np.rad2deg(turn):.1f} deg/s"
        if state.sigmas[2] > self.uncertainty:
            return f"a yaw rate with a sigma of {np.rad2deg(state.sigmas[2]):.1f} deg/s"
        if abs(state.yaw_rate_of_slip) > self.slip:
            return f"a side slip of {state.theta[1]:.2f} m/s"
        if last is None:
            return ""
        interval = state.time - last.time
        change = np.abs(state.theta - last.theta)
        allowed = interval * np.array([self.acceleration, self.acceleration, self.yaw_acceleration])
        beyond = change > allowed + _SIGMAS * np.hypot(state.sigmas, last.sigmas)
        if not beyond.any():
            return ""
        which = int(np.argmax(beyond))
        rate = change[which] / interval
        if which == 2:
            return f"a yaw acceleration of {rate:.1f} rad/s^2"
        return f"an acceleration of {rate:.1f} m/s^2 along {'xy'[which]}"
