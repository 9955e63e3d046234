"""Velocity from Doppler profiles alone: one sensor (Kellner et al. 2013), several (2014)."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from d2d._checks import Array, flag, instance, rows
from d2d.radar.scan import Mounting, RadarScan, doppler_gradients

_PAIRS = 200
_GATE = 3.0  # standard deviations within which a target agrees with a hypothesis
_ROUNDS = 20  # of fit, weights and selection
_STILL = 1e-6  # m/s, m/s, rad/s: less is no change
_WORST = 1e-3  # a direction is seen if its singular value is this share of the largest


def sensor_velocity(scan: RadarScan, mounting: Mounting) -> Array:
    """Velocity (2,) of the sensor in the directions of the vehicle's axes, in m/s.

    Static targets lie on v = -(u_x cos phi + u_y sin phi).  The pair of targets whose line most
    targets agree with is refined by weighted least squares over those, after Kellner et al. (2013),
    but over a fixed set of pairs instead of a random one.  Without targets, with a single one or a
    single direction, the component that is not seen is zero.  A scan on which no two targets agree
    is fitted as a whole.

    Raises ``ValueError`` if ``scan`` is no `RadarScan` or ``mounting`` no `Mounting`.
    """
    instance("scan", scan, RadarScan)
    instance("mounting", mounting, Mounting)
    if not scan.size:
        return np.zeros(2)
    directions = _directions(scan, mounting)
    inliers = _agreeing(scan, directions)
    # targets that lie as close together as their azimuths are uncertain show one direction only
    spread = max(1e-6, _GATE * float(np.median(scan.sigma_azimuth)))
    weights = 1.0 / scan.sigma_doppler[inliers, None]
    return np.asarray(
        np.linalg.lstsq(
            directions[inliers] * weights, scan.doppler[inliers] * weights[:, 0], rcond=spread
        )[0]
    )


class DopplerMotion(NamedTuple):
    """The vehicle's velocity from the Doppler velocities of one instant.

    Attributes
    ----------
    theta : (3,) array
        [v_x, v_y, omega] in m/s, m/s, rad/s; zero along what the targets do not show.
    covariance : (3, 3) array
        Of the weighted least squares; nan unless all components were seen.
    inliers : tuple of (K,) arrays of bool
        Which targets of each scan were taken for static.
    """

    theta: Array
    covariance: Array
    inliers: tuple[NDArray[np.bool_], ...]


def doppler_ego_motion(
    views: Iterable[tuple[RadarScan, Mounting]], *, slips: bool = True
) -> DopplerMotion:
    """The vehicle's velocity from the Doppler velocities of one or several sensors.

    The static targets of each scan are found as by `sensor_velocity`; a weighted least squares
    over all of them, V_k = h_k' theta with the variance sigma_v^2 + sigma_phi^2 (dV/dphi)^2, is
    repeated with the weights that it gives and the targets within three standard deviations of
    it, until nothing changes.
    Sensors at different places make the yaw rate observable (Kellner et al. 2014).

    Parameters
    ----------
    views : iterable of (RadarScan, Mounting)
        At (nearly) the same time; scans may be empty.
    slips : bool
        Whether v_y is estimated.  Without, it is zero, and a single sensor ahead of or behind the
        origin is enough (Kellner et al. 2013).

    Raises
    ------
    ValueError
        Without a view, or with something else in its place; if ``slips`` is no bool.
    """
    views = rows("views", views, RadarScan, Mounting)
    if not views:
        raise ValueError("views must hold at least one scan with its mounting, but is empty")
    edges = np.cumsum([scan.size for scan, _ in views])[:-1]
    inliers = np.concatenate([_agreeing(scan, _directions(scan, at)) for scan, at in views])
    gains, slopes = (
        np.concatenate(parts)
        for parts in zip(*(doppler_gradients(scan.azimuth, at) for scan, at in views), strict=True)
    )
    doppler, sigma_doppler, sigma_azimuth = (
        np.concatenate([getattr(scan, name) for scan, _ in views])
        for name in ("doppler", "sigma_doppler", "sigma_azimuth")
    )
    free = np.array([True, flag("slips", slips), True])
    theta, covariance = np.zeros(3), np.full((3, 3), np.nan)
    sigma = sigma_doppler
    for _ in range(_ROUNDS if inliers.any() else 0):
        weights = 1.0 / sigma[inliers]
        system = gains[inliers][:, free] * weights[:, None]
        scale = np.linalg.norm(system, axis=0) + 1e-300
        solution, _, rank, _ = np.linalg.lstsq(
            system / scale, doppler[inliers] * weights, rcond=_WORST
        )
        moved = np.abs(theta[free] - solution / scale).max()
        theta[free] = solution / scale
        covariance = np.full((3, 3), np.nan)
        if rank == free.sum():
            covariance = np.zeros((3, 3))
            covariance[np.ix_(free, free)] = np.linalg.inv(system.T @ system)
        sigma = np.hypot(sigma_doppler, sigma_azimuth * (slopes @ theta))
        agree = np.abs(doppler - gains @ theta) < _GATE * sigma
        if not agree.any() or (moved < _STILL and (agree == inliers).all()):
            break
        inliers = agree
    return DopplerMotion(theta, covariance, tuple(np.split(inliers, edges)))


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


def _directions(scan: RadarScan, mounting: Mounting) -> Array:
    """Derivatives (K, 2) of the Doppler velocities in the sensor's velocity."""
    angle = scan.azimuth + mounting.yaw
    return -np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _agreeing(scan: RadarScan, directions: Array) -> NDArray[np.bool_]:
    """Which targets (K,) agree with the hypothesis that most agree with; all if none do."""
    everything = np.ones(scan.size, dtype=np.bool_)
    if scan.size <= 2:
        return everything
    first, second = _pairs(scan.size)
    hypotheses = (
        np.linalg.pinv(np.stack([directions[first], directions[second]], axis=-2), rcond=1e-3)
        @ np.stack([scan.doppler[first], scan.doppler[second]], axis=-1)[..., None]
    )
    residuals = scan.doppler - (directions @ hypotheses)[..., 0]
    slope = np.stack([-directions[:, 1], directions[:, 0]], axis=-1) @ hypotheses
    sigma = np.hypot(scan.sigma_doppler, scan.sigma_azimuth * slope[..., 0])
    agree = np.abs(residuals) < _GATE * sigma
    best: NDArray[np.bool_] = agree[np.argmax(agree.sum(axis=-1))]
    return best if best.any() else everything


def _pairs(size: int) -> tuple[Array, Array]:
    """Index pairs spread evenly over all pairs of ``size`` targets, the same at every call."""
    first, second = np.triu_indices(size, 1)
    chosen = np.linspace(0, len(first) - 1, min(_PAIRS, len(first))).astype(int)
    return first[chosen], second[chosen]
