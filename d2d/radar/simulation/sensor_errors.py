"""Errors of a simulated radar, apart from the noise of its single targets."""

from dataclasses import dataclass

import numpy as np

from d2d._checks import ANGLE, NOT_NEGATIVE, POSITIVE, Bounded, Bounds, number
from d2d._types import Array

_RIDGE = 1e-9  # relative variance that keeps points at the same place from a singular covariance


@dataclass(frozen=True)
class SensorErrors(Bounded):
    """Errors that the targets of a simulated scan share, and scatter of the reflection points.

    All are off by default and constant over a drive; `d2d.radar.ErrorBudget` holds the standard
    deviations of those of the same names.

    To all azimuths, ``azimuth`` (rad) is added, because the sensor is turned by this angle from its
    stated mounting, and to all Doppler velocities ``doppler`` (m/s), after their relative error
    ``scale``, above -1.  A scan shows the world as it was ``lag`` (s) before its time stamp.

    An object is seen at a distance from its reflection point that is drawn anew in each scan, with
    the standard deviation ``extent`` (m) along each axis; see `d2d.radar.RadarScan`.  Over the
    length ``neighbours`` (m), these distances are correlated as exp(-distance / length); with zero,
    each point moves on its own.

    The steps of the reported range, azimuth and Doppler velocity are ``rounding`` times the
    sensor's own; this has no effect on a sensor that is not quantised.

    Examples
    --------
    To a sensor that is turned by a degree and a half, the vehicle seems to slip to the left:

    >>> import numpy as np
    >>> from d2d.radar import SensorErrors, simulate_drive, track
    >>> turned = SensorErrors(azimuth=np.deg2rad(1.5))
    >>> drive = simulate_drive(np.random.default_rng(0), 5.0, errors=turned)
    >>> driven = track(drive)
    >>> float((driven.theta - drive.truth.theta[1:]).mean(axis=0)[1].round(1))  # m/s
    0.1
    """

    azimuth: float = number(0.0, ANGLE)
    doppler: float = number(0.0)
    scale: float = number(0.0, Bounds(above=-1.0))
    lag: float = number(0.0)
    extent: float = number(0.0, NOT_NEGATIVE)
    neighbours: float = number(0.0, NOT_NEGATIVE)
    rounding: float = number(1.0, POSITIVE)

    def moved(self, rng: np.random.Generator, points: Array) -> Array:
        """The places (n, 2) in m at which points (n, 2) are seen in one scan."""
        shift = rng.standard_normal(points.shape)
        if self.neighbours:
            distance = np.linalg.norm(points[:, None] - points, axis=-1)
            correlation = np.exp(-distance / self.neighbours)
            shift = np.linalg.cholesky(correlation + _RIDGE * np.eye(len(points))) @ shift
        return points + self.extent * shift

    def measured(self, values: Array) -> Array:
        """Range, azimuth and Doppler velocity (3, n) as this sensor measures them."""
        distance, azimuth, doppler = values
        return np.stack(
            [distance, azimuth + self.azimuth, (1.0 + self.scale) * doppler + self.doppler]
        )
