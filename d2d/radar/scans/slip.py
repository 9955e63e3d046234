"""The lateral velocity of a vehicle whose rear axle slips in bends."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from d2d._checks import broadcast_batches, check_real, check_scalar
from d2d._types import Array


@dataclass(frozen=True)
class SlipLaw:
    """The lateral velocity in a steady bend, v_y = (ahead - compliance v_x^2) omega.

    In a bend, the lateral acceleration v_x omega needs a lateral force of the rear tyres, and so a
    slip angle -compliance v_x omega of the rear axle (linear single-track model: Riekert & Schunck
    1940).  A point ahead of the axle also moves sideways because of the rotation.

    Parameters
    ----------
    ahead : float, m
        How far the vehicle frame's origin lies ahead of the rear axle.
    compliance : float, s^2/m
        Slip angle of the rear axle (rad) over the lateral acceleration (m/s^2).

    Raises
    ------
    ValueError
        If a parameter is not a finite number; the message names it.
    """

    ahead: float = 0.0
    compliance: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = check_scalar(field.name, getattr(self, field.name))
            object.__setattr__(self, field.name, float(value))

    def lateral(self, forward: ArrayLike, yaw_rate: ArrayLike) -> Array:
        """v_y (...) in m/s of v_x (...) in m/s and omega (...) in rad/s; nan stays nan.

        Raises a ``ValueError`` that names the argument that is not an array of real numbers, or
        both if they do not broadcast.
        """
        v_x, omega = check_real("forward", forward), check_real("yaw_rate", yaw_rate)
        broadcast_batches("forward and yaw_rate", v_x.shape, omega.shape)
        return np.asarray((self.ahead - self.compliance * v_x**2) * omega)
