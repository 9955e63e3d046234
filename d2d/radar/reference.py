"""The reference motion of a vehicle: its poses and velocities over time."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from d2d._checks import check_finite
from d2d._types import Array


@dataclass(frozen=True, eq=False)
class Reference:
    """The motion at the time of each scan: the truth of a simulation, or from another sensor.

    Attributes
    ----------
    times : (n,) array, s
    theta : (n, 3) array
        Velocity [v_x, v_y, omega] of the vehicle frame's origin in m/s, m/s, rad/s, along the
        vehicle's axes.
    poses : (n, 3) array
        Pose [x, y, yaw] of the vehicle frame in the world, in m, m, rad; yaw is continuous.
    """

    times: Array
    theta: Array
    poses: Array

    def at(self, times: ArrayLike) -> "Reference":
        """The motion at other times (m,) in s, by linear interpolation; nan outside the time span.

        Raises a ``ValueError`` unless ``times`` is a one-dimensional array of finite numbers.
        """
        wanted = check_finite("times", times)
        if wanted.ndim != 1:
            raise ValueError(f"times must have the shape (m,), but has {wanted.shape}")
        theta, poses = (
            np.column_stack(
                [np.interp(wanted, self.times, c, left=np.nan, right=np.nan) for c in array.T]
            )
            for array in (self.theta, self.poses)
        )
        return Reference(wanted, theta, poses)
