"""Estimates as input of a Kalman filter: white noise, and slow errors as states."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from d2d._checks import check_finite
from d2d._types import Array


class FilterInput(NamedTuple):
    """Estimate as input of a Kalman filter: a measurement of its state with white noise.

    With the true velocity v and acceleration a of the vehicle at the estimate's time, in the
    vehicle frame (v' = a), and with the slow errors s of S sensors,

        velocity = v + (delay − lag s_lag) a + slow s + white noise

    The 2 S + 3 slow errors s, each in units of its standard deviation in the budget, are the
    azimuth errors of all sensors in the order of the `Tracker`, then their Doppler errors, the
    scale error, the side slip in units of the prior's (zero columns without one) and s_lag; before
    s_lag come three errors of the velocity itself if the budget states them (`fit_budget`).

    Attributes
    ----------
    velocity : (3,) array
        [v_x, v_y, omega] in m/s, m/s, rad/s, over the interval that the scans cover.
    white : (3, 3) array
        Covariance of what is new in each estimate: R of the filter.  Errors of the targets alone,
        and what the correlation of neighbouring targets adds.
    delay : (3, 3) array, s
        Times the acceleration: how far ``velocity`` is from that at the estimate's time.
    slow : (3, 2 S + 2) array
        Changes of ``velocity`` by one standard deviation of each slow error but the lag.
    lag : float, s
        The budget's standard deviation of the time to which an estimate belongs.
    """

    velocity: Array
    white: Array
    delay: Array
    slow: Array
    lag: float

    @property
    def covariance(self) -> Array:
        """Covariance (3, 3) of ``velocity``, without the lag."""
        return self.white + self.slow @ self.slow.T

    def expected(
        self, velocity: ArrayLike, acceleration: ArrayLike, slow: ArrayLike
    ) -> tuple[Array, Array]:
        """Predicted ``velocity`` for a filter, and its derivatives (3, 6 + 2 S + 3).

        The filter's state is the ``velocity`` (3,) and ``acceleration`` (3,) of the vehicle at the
        estimate's time, along x and y and about z, and the ``slow`` errors (2 S + 3,).  Derivatives
        are in this order.  Raises a ``ValueError`` if a shape does not match.
        """
        v = check_finite("velocity", velocity, "(3,)")
        a = check_finite("acceleration", acceleration, "(3,)")
        s = check_finite("slow", slow, f"({self.slow.shape[1] + 1},)")
        delay = self.delay - self.lag * s[-1] * np.eye(3)
        to = np.column_stack([np.eye(3), delay, self.slow, -self.lag * a])
        return v + delay @ a + self.slow @ s[:-1], to
