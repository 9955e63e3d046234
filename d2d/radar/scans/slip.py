"""The lateral velocity of a vehicle whose rear axle slips in bends."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from d2d._checks import Bounded, number
from d2d._types import Array


@dataclass(frozen=True)
class SlipLaw(Bounded):
    """The lateral velocity in a steady bend, v_y = (ahead - compliance v_x^2) omega.

    In a bend, the lateral acceleration v_x omega needs a lateral force of the rear tyres, and so a
    slip angle -compliance v_x omega of the rear axle (linear single-track model: Riekert & Schunck
    1940), with ``compliance`` in s^2/m.  The vehicle frame's origin, ``ahead`` metres ahead of the
    axle, also moves sideways because of the rotation.
    """

    ahead: float = number(0.0)
    compliance: float = number(0.0)

    def lateral(self, forward: ArrayLike, yaw_rate: ArrayLike) -> Array:
        """v_y (...) in m/s of v_x (...) in m/s and omega (...) in rad/s."""
        v_x, omega = np.asarray(forward), np.asarray(yaw_rate)
        return np.asarray((self.ahead - self.compliance * v_x**2) * omega)
