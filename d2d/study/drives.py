"""How well a drive was estimated."""

from dataclasses import dataclass

import numpy as np

from d2d._checks import Array
from d2d.credibility import Credibility, credibility
from d2d.radar import Reference, Track

NAMES = ("v_x", "v_y", "omega")
UNITS = ("m/s", "m/s", "deg/s")
IN_UNITS = np.array([1.0, 1.0, np.rad2deg(1.0)])


@dataclass(frozen=True, eq=False)
class DriveErrors:
    """Estimate minus reference of a track, where it converged and the reference is known.

    Attributes
    ----------
    times : (n,) array, s
    errors : (n, 3) array
        Of [v_x, v_y, omega] in m/s, m/s, rad/s.
    covariances : (n, 3, 3) array
        Estimated, in these units.
    share : float
        Of the track's pairs that are left: converged, and known.
    """

    times: Array
    errors: Array
    covariances: Array
    share: float

    @classmethod
    def of(cls, track: Track, reference: Reference) -> "DriveErrors":
        """Compare with a reference that is given at the times of all scans."""
        return cls.from_errors(track, track.theta - reference.theta[1:])

    @classmethod
    def from_errors(cls, track: Track, errors: Array) -> "DriveErrors":
        """Errors (n, 3) of all pairs; those without a reference are nan."""
        good = track.converged & np.isfinite(errors).all(axis=-1)
        return cls(track.times[good], errors[good], track.covariance[good], float(good.mean()))

    @property
    def rmse(self) -> Array:
        """Root mean square error (3,) in m/s, m/s and deg/s."""
        return np.asarray(np.sqrt(np.mean(self.errors**2, axis=0)) * IN_UNITS)

    @property
    def sigmas(self) -> Array:
        """Estimated standard deviations (n, 3) in m/s, m/s and deg/s."""
        return np.asarray(np.sqrt(np.diagonal(self.covariances, axis1=-2, axis2=-1)) * IN_UNITS)

    @property
    def credibility(self) -> Credibility:
        """Of the errors under their covariances."""
        return credibility(self.errors, self.covariances)

    def summary(self) -> str:
        """One line: RMSE, share converged, ANEES with its region, NCI and I^2."""
        judged = self.credibility
        rmse = "  ".join(
            f"{name} {value:.3f} {unit}"
            for name, value, unit in zip(NAMES, self.rmse, UNITS, strict=True)
        )
        return (
            f"RMSE {rmse}; usable {self.share:.1%}; ANEES {judged.anees:.2f} "
            f"[{judged.bounds[0]:.2f}, {judged.bounds[1]:.2f}], NCI {judged.nci:.1f} dB, "
            f"I2 {judged.inclination:+.1f} dB"
        )
