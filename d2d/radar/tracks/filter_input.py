"""Estimates as input of a Kalman filter: white noise, and slow errors as states."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from d2d._checks import check_finite
from d2d._types import Array


class FilterInput(NamedTuple):
    """Estimate as input of a Kalman filter: a measurement of its state with white noise.

    `VelocityEstimate.theta` is filtered: a filter that takes its errors as white believes that they
    average out.  Here nothing is filtered yet, and the slow errors are further states (state
    augmentation: Bar-Shalom, Li & Kirubarajan 2001) or, better on the road, considered without
    being learnt, as `Tracker` does.  With the true velocity v and acceleration a of the vehicle at
    the estimate's time, in the vehicle frame (v' = a), and with the slow errors s of S sensors,

        velocity = v + (delay - lag s_lag) a + slow s + white noise

    The 2 S + 3 slow errors s, each in units of its standard deviation in the budget, are the
    azimuth errors of all sensors in the order of the `Tracker`, then their Doppler errors, the
    scale error, the side slip in units of the prior's (zero columns without one) and s_lag; before
    s_lag come three errors of the velocity itself if the budget states them (`fit_budget`).  Begin
    with zero and the unit matrix as their covariance.  On the road they stay for about 15 s:
    multiply them by k = exp(-interval / 15) in each step, and add 1 - k^2 to their variances.

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

    Examples
    --------
    A filter of v, a and s, which has the covariance ``p``, before its usual update:

    >>> import numpy as np
    >>> from d2d.radar import ErrorBudget, Tracker, simulate_drive
    >>> drive = simulate_drive(np.random.default_rng(0), duration=1.0)
    >>> tracker = Tracker({"front": drive.mounting}, budget=ErrorBudget(azimuth=0.01, lag=0.02))
    >>> estimates = [each for scan in drive.scans for each in tracker.add("front", scan)]
    >>> seen = estimates[-1].filter_input
    >>> v, a, s = np.array([3.0, 0.0, 0.0]), np.zeros(3), np.zeros(5)
    >>> p = np.eye(11)
    >>> expected, to = seen.expected(v, a, s)
    >>> innovation, spread = seen.velocity - expected, to @ p @ to.T + seen.white
    >>> innovation.shape, to.shape, spread.shape
    ((3,), (3, 11), (3, 3))
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
