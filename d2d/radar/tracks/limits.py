"""Plausibility limits on velocity and acceleration."""

import math
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from d2d._checks import check_positive_scalar
from d2d._types import Array

_HARD = 0.5  # s, for which a vehicle accelerates as hard as it can
_SIGMAS = 3.0  # standard deviations that an estimate may lie beyond a limit


class State(NamedTuple):
    """A velocity [v_x, v_y, omega] at its time, with its covariance."""

    time: float  # s
    theta: Array  # (3,)
    covariance: Array  # (3, 3)


@dataclass(frozen=True)
class VehicleLimits:
    """How fast a vehicle moves, and how fast its velocity changes.

    The defaults are somewhat beyond what a car does; ``math.inf`` switches a limit off.  An
    estimate that exceeds one by more than three of its own standard deviations is not accepted.
    The velocity may have changed since the last accepted estimate by the acceleration times the
    time that has passed; beyond half a second, as nobody brakes or turns in like that for long, by
    that times the square root of the time.  Raises a ``ValueError`` if a limit is not positive.

    Attributes
    ----------
    speed : float, m/s
        Of the vehicle frame's origin.
    yaw_rate : float, rad/s
    acceleration : float, m/s²
        Of v_x and of v_y, from one accepted estimate to the next.  A car brakes by up to some
        10 m/s² and takes a bend at about as much.
    yaw_acceleration : float, rad/s²
    uncertainty : float, rad/s
        Largest useful standard deviation of omega.
    speed_uncertainty : float, m/s
        Largest useful standard deviation of v_x and of v_y.  Where a few targets agree by accident,
        or move along with the vehicle, it is mostly larger.
    yaw_rate_of_slip : float, rad/s
        By how much the yaw rate may move if v_y is taken as zero: of a single sensor ahead of the
        axle, an error of the yaw rate appears as side slip.  The default is for an origin near the
        rear axle; where it is far from it, or all wheels turn, take a larger one.
    """

    speed: float = 100.0
    yaw_rate: float = 3.0
    acceleration: float = 12.0
    yaw_acceleration: float = 1.5
    uncertainty: float = 0.12
    speed_uncertainty: float = 0.4
    yaw_rate_of_slip: float = 0.15

    def __post_init__(self) -> None:
        for field in fields(self):
            limit = getattr(self, field.name)
            if not (np.isscalar(limit) and limit == np.inf):
                check_positive_scalar(field.name, limit)
            object.__setattr__(self, field.name, float(limit))

    def exceeded(self, state: State, last: State | None) -> str:
        """Reason to reject the state, in words; empty if it is plausible after the last one."""
        sigmas, theta = np.sqrt(state.covariance.diagonal()).tolist(), state.theta.tolist()
        speed, turn = math.hypot(theta[0], theta[1]), abs(theta[2])
        if speed > self.speed + _SIGMAS * math.hypot(sigmas[0], sigmas[1]):
            return f"a speed of {speed:.1f} m/s"
        if turn > self.yaw_rate + _SIGMAS * sigmas[2]:
            return f"a yaw rate of {math.degrees(turn):.1f} deg/s"
        if sigmas[2] > self.uncertainty:
            return f"a yaw rate with a sigma of {math.degrees(sigmas[2]):.1f} deg/s"
        if max(sigmas[:2]) > self.speed_uncertainty:
            return f"a velocity with a sigma of {max(sigmas[:2]):.1f} m/s"
        # how far omega would move if v_y were known to be zero
        moved = theta[1] * state.covariance[1, 2] / state.covariance[1, 1]
        if abs(moved) > self.yaw_rate_of_slip:
            return f"a side slip of {theta[1]:.2f} m/s"
        if last is None:
            return ""
        interval = state.time - last.time
        enough = min(interval, math.sqrt(interval * _HARD))
        spread = np.sqrt((state.covariance + last.covariance).diagonal())
        limits = np.array([self.acceleration, self.acceleration, self.yaw_acceleration])
        change = np.abs(state.theta - last.theta)
        units = "m/s^2 along x", "m/s^2 along y", "rad/s^2"
        for i in np.flatnonzero(change > limits * enough + _SIGMAS * spread):
            kind = "a yaw acceleration" if i == 2 else "an acceleration"
            return f"{kind} of {change[i] / interval:.1f} {units[i]}"
        return ""
