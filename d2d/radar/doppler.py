"""Velocity from the Doppler profile of a single scan (Kellner et al. 2013)."""

import numpy as np

from d2d._checks import Array
from d2d.radar.scan import Mounting, RadarScan

_PAIRS = 200
_GATE = 3.0  # standard deviations within which a target agrees with a hypothesis


def sensor_velocity(scan: RadarScan, mounting: Mounting) -> Array:
    """Velocity (2,) of the sensor in the directions of the vehicle's axes, in m/s.

    Static targets lie on v = -(u_x cos phi + u_y sin phi).  The pair of targets whose line most
    targets agree with is refined by weighted least squares over those, after Kellner et al. (2013),
    but over a fixed set of pairs instead of a random one.  Without targets, with a single one or a
    single direction, the component that is not seen is zero.  A scan on which no two targets agree
    is fitted as a whole.
    """
    if not scan.size:
        return np.zeros(2)
    angle = scan.azimuth + mounting.yaw
    directions = -np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    inliers = np.ones(scan.size, dtype=bool)
    if scan.size > 2:
        first, second = _pairs(scan.size)
        hypotheses = (
            np.linalg.pinv(np.stack([directions[first], directions[second]], axis=-2), rcond=1e-3)
            @ np.stack([scan.doppler[first], scan.doppler[second]], axis=-1)[..., None]
        )
        residuals = scan.doppler - (directions @ hypotheses)[..., 0]
        slope = np.stack([-directions[:, 1], directions[:, 0]], axis=-1) @ hypotheses
        sigma = np.hypot(scan.sigma_doppler, scan.sigma_azimuth * slope[..., 0])
        agree = np.abs(residuals) < _GATE * sigma
        best = agree[np.argmax(agree.sum(axis=-1))]
        inliers = best if best.any() else inliers
    # targets that lie as close together as their azimuths are uncertain show one direction only
    spread = max(1e-6, _GATE * float(np.median(scan.sigma_azimuth)))
    weights = 1.0 / scan.sigma_doppler[inliers, None]
    return np.asarray(
        np.linalg.lstsq(
            directions[inliers] * weights, scan.doppler[inliers] * weights[:, 0], rcond=spread
        )[0]
    )


def doppler_starts(scan: RadarScan, mounting: Mounting) -> Array:
    """Starts (S, 3) [v_x, v_y, omega] of a registration that the Doppler velocities are near to.

    They fix the sensor's velocity; what of it is rotation they do not tell.  One start has none,
    the other has no side slip instead, for a sensor ahead of or behind the vehicle's origin.
    """
    along, across = sensor_velocity(scan, mounting)
    starts = [[along, across, 0.0]]
    if mounting.x != 0.0:
        turn = across / mounting.x
        starts.append([along + turn * mounting.y, 0.0, turn])
    return np.array(starts)


def _pairs(size: int) -> tuple[Array, Array]:
    """Index pairs spread evenly over all pairs of ``size`` targets, the same at every call."""
    first, second = np.triu_indices(size, 1)
    chosen = np.linspace(0, len(first) - 1, min(_PAIRS, len(first))).astype(int)
    return first[chosen], second[chosen]
