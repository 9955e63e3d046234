"""Where the vehicle was and how it moved, as far as it is known."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from d2d._checks import Array, finite


@dataclass(frozen=True, eq=False)
class Reference:
    """The motion at the time of each scan: the truth of a simulation or another sensor's word.

    Attributes
    ----------
    times : (n,) array, s
    theta : (n, 3) array
        [v_x, v_y, omega] of the vehicle frame's origin, in its own axes, m/s, m/s, rad/s.
    poses : (n, 3) array
        [x, y, yaw] of the vehicle frame in the world, m, m, rad; yaw is continuous.
    """

    times: Array
    theta: Array
    poses: Array

    def at(self, times: ArrayLike) -> "Reference":
        """The motion at other times (m,) in s, interpolated; nan outside.

        Raises ``ValueError`` naming ``times`` unless they are finite numbers in a row.
        """
        wanted = finite("times", times)
        if wanted.ndim != 1:
            raise ValueError(f"times must have the shape (m,), but has {wanted.shape}")
        theta, poses = (
            np.column_stack(
                [np.interp(wanted, self.times, c, left=np.nan, right=np.nan) for c in array.T]
            )
            for array in (self.theta, self.poses)
        )
        return Reference(wanted, theta, poses)
