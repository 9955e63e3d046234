"""What it costs to take a target's azimuth error in position and Doppler for two errors."""

from dataclasses import dataclass

import numpy as np

from d2d import PointSet, RegistrationCost, credibility, propagate_covariance, register, rigid
from d2d._checks import Array
from d2d.credibility import Credibility
from d2d.measurement import LinearMeasurement
from d2d.radar import Mounting, doppler_velocity
from d2d.radar.scan import doppler_gradients

INTERVAL = 0.1  # s
COVARIANCES = ("inverse Hessian", "propagated, errors apart", "propagated, error shared")


@dataclass(frozen=True, eq=False)
class SharedAzimuth:
    """Errors (n, 3) of [v_x, v_y, omega] and their covariances (n, 3, 3) by each of `COVARIANCES`.

    ``weight`` is the root mean square, over the targets, of the Doppler velocity's error from the
    azimuth over its own standard deviation.
    """

    weight: float
    errors: Array
    covariances: dict[str, Array]

    def credibility(self, name: str) -> Credibility:
        """Of one of the covariances."""
        return credibility(self.errors, self.covariances[name])

    def variance_ratios(self, name: str) -> Array:
        """Actual over reported variance along the two matrices' common axes, ascending (3,)."""
        root = np.linalg.cholesky(self.covariances[name].mean(axis=0))
        whitened = np.linalg.solve(root, self.errors.T)
        return np.asarray(np.linalg.eigvalsh(np.cov(whitened)))


def shared_azimuth(
    rng: np.random.Generator,
    theta: Array,
    mounting: Mounting,
    *,
    sigmas: tuple[float, float, float] = (0.15, np.deg2rad(1.0), 0.06),
    targets: int = 30,
    runs: int = 1000,
) -> SharedAzimuth:
    """Register noisy scan pairs of one static scene, each azimuth error in position and Doppler.

    The targets are spread evenly over the area within 46 degrees and 5 to 50 m; ``theta`` (3,) is
    the velocity in m/s, m/s, rad/s, ``sigmas`` are those of range, azimuth and Doppler in m, rad,
    m/s.  Without an outlier component, which has an effect of its own.
    """
    distance = 50.0 * np.sqrt(rng.uniform(0.01, 1.0, targets))
    azimuth = rng.uniform(-0.8, 0.8, targets)
    local = np.stack([distance * np.cos(azimuth), distance * np.sin(azimuth)], axis=-1)
    motion = rigid.exponential(INTERVAL * theta)
    before = rigid.compose(rigid.inverse(mounting.pose), rigid.compose(motion, mounting.pose))

    def observe(points: Array) -> tuple[Array, Array]:
        noise = rng.standard_normal((2, runs, targets))
        return (
            np.hypot(*points.T) + sigmas[0] * noise[0],
            np.arctan2(points[:, 1], points[:, 0]) + sigmas[1] * noise[1],
        )

    def points(ranges: Array, azimuths: Array) -> PointSet:
        return PointSet.from_polar(ranges, azimuths, *sigmas[:2]).transformed(mounting.pose)

    fixed = points(*observe(rigid.transform_means(before, local)))
    ranges, azimuths = observe(local)
    moving = points(ranges, azimuths)
    doppler = doppler_velocity(theta, azimuth[np.newaxis], mounting)[0]
    gain, slope = doppler_gradients(azimuths, mounting)
    measurement = LinearMeasurement(
        doppler + sigmas[2] * rng.standard_normal((runs, targets)),
        sigmas[2],
        sigmas[1],
        gain / INTERVAL,
        slope / INTERVAL,
        of_twist=True,
    )
    cost = RegistrationCost()
    estimate = register(fixed, moving, cost, motion, measurement=measurement)
    bearing = azimuths + mounting.yaw
    across = ranges[..., np.newaxis] * np.stack([-np.sin(bearing), np.cos(bearing)], axis=-1)
    apart, shared = (
        propagate_covariance(
            estimate, fixed, moving, cost, measurement=measurement, position_slope=position_slope
        )
        for position_slope in (None, across)
    )
    jacobian = rigid.logarithm_jacobian(estimate.theta) / INTERVAL
    good = estimate.converged
    _, true_slope = doppler_gradients(azimuth, mounting)
    return SharedAzimuth(
        float(np.sqrt(np.mean((sigmas[1] * (true_slope @ theta) / sigmas[2]) ** 2))),
        (rigid.logarithm(estimate.theta) / INTERVAL - theta)[good],
        {
            name: (jacobian @ covariance @ np.swapaxes(jacobian, -1, -2))[good]
            for name, covariance in zip(
                COVARIANCES, (estimate.covariance, apart, shared), strict=True
            )
        },
    )
