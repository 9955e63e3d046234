"""Error budget: shared and systematic errors, which the targets' own sigmas do not contain."""

from dataclasses import dataclass

from d2d._checks import ANGLE, NOT_NEGATIVE, Bounded, number

# Beyond it a covariance, in whatever unit, holds nothing but the budget, or overflows.
_SIGMA = NOT_NEGATIVE._replace(most=1e3)


@dataclass(frozen=True)
class ErrorBudget(Bounded):
    """Standard deviations of the errors that many targets share, or that no target explains.

    They add to the covariance of a track; a part of ``azimuth`` and ``doppler`` also lessens the
    weight of its Doppler velocities.  Raises a ``ValueError`` if one is negative or above 1000.

    Attributes
    ----------
    azimuth : float, rad
        Of an azimuth bias of each sensor, the error of its mounting angle included.
    doppler : float, m/s
        Of an error of all Doppler velocities of a sensor's scan, such as rounding that they share.
    scale : float
        Of a relative error of the Doppler velocities of all sensors, or of a reference's speed.
    lag : float, s
        Of the time to which an estimate belongs; its effect is the vehicle's acceleration times it.
    neighbours : float, m
        Length over which position errors of targets are correlated, as exp(-distance / length).
    source : str
        Where the numbers come from.
    v_x, v_y, omega : float, m/s, m/s, rad/s
        Of slow errors of the velocity itself; with `fit_budget`'s, leave the others at zero.
    sway : float, rad/s
        Of the yaw rate about its mean over a pair of scans; not in a path or a `FilterInput`.
    """

    azimuth: float = number(0.0, ANGLE._replace(least=0.0))
    doppler: float = number(0.0, _SIGMA)
    scale: float = number(0.0, _SIGMA)
    lag: float = number(0.0, _SIGMA)
    neighbours: float = number(0.0, _SIGMA)
    source: str = ""
    v_x: float = number(0.0, _SIGMA)
    v_y: float = number(0.0, _SIGMA)
    omega: float = number(0.0, _SIGMA)
    sway: float = number(0.0, _SIGMA)
