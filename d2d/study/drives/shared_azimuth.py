"""The effect of treating the azimuth error in a target's position and Doppler as two errors."""

from collections.abc import Iterable

import numpy as np

from d2d import PointSet, RegistrationCost, propagate_covariance, register, rigid
from d2d._types import Array
from d2d.covariance import propagated
from d2d.measurement import LinearMeasurement
from d2d.radar import (
    Drive,
    Mounting,
    Track,
    doppler_velocity,
    estimate_ego_motion,
    propagate_ego_motion,
)
from d2d.radar.scans.scan import doppler_gradients
from d2d.study.plane.scenarios import noisy_polar
from d2d.study.runs import StatedCovariances

INTERVAL = 0.1  # s
TARGETS, RUNS = 30, 1000
COVARIANCES = ("inverse Hessian", "propagated, errors apart", "propagated, error shared")


def shared_azimuth(
    rng: np.random.Generator,
    theta: Array,
    mounting: Mounting,
    *,
    sigmas: tuple[float, float, float] = (0.15, np.deg2rad(1.0), 0.06),
) -> tuple[float, StatedCovariances]:
    """Register noisy scan pairs of a static scene; an azimuth error enters position and Doppler.

    The targets are spread evenly over the area within 46 degrees of the boresight and between 5 and
    50 m.  ``theta`` (3,) is the velocity in m/s, m/s, rad/s; ``sigmas`` are the standard deviations
    of range, azimuth and Doppler in m, rad, m/s.  The cost has no outlier component, which would
    have a separate effect.  The first result is the root mean square of the Doppler errors that the
    azimuth causes, over the Doppler's own standard deviation.
    """
    distance = 50.0 * np.sqrt(rng.uniform(0.01, 1.0, TARGETS))
    azimuth = rng.uniform(-0.8, 0.8, TARGETS)
    local = np.stack([distance * np.cos(azimuth), distance * np.sin(azimuth)], axis=-1)
    motion = rigid.exponential(INTERVAL * theta)
    before = rigid.compose(rigid.inverse(mounting.pose), rigid.compose(motion, mounting.pose))

    def points(ranges: Array, azimuths: Array) -> PointSet:
        return PointSet.from_polar(ranges, azimuths, *sigmas[:2]).transformed(mounting.pose)

    before_points = rigid.transform_means(before, local)
    fixed = points(*noisy_polar(rng, before_points, *sigmas[:2], (RUNS,)))
    ranges, azimuths = noisy_polar(rng, local, *sigmas[:2], (RUNS,))
    moving = points(ranges, azimuths)
    doppler = doppler_velocity(theta, azimuth[np.newaxis], mounting)[0]
    gain, slope = doppler_gradients(azimuths, mounting)
    measurement = LinearMeasurement(
        doppler + sigmas[2] * rng.standard_normal((RUNS, TARGETS)),
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
    apart = propagate_covariance(estimate, fixed, moving, cost, measurement=measurement)
    problem = cost.problem(fixed, moving, measurement)
    cross = problem.cross_derivatives(problem.bind(estimate.theta), 0, RUNS)
    noise = sum(
        np.einsum("bkpi,bkij,bkqj->bpq", by, points.covariances, by)
        for by, points in ((cross.fixed, fixed), (cross.moving, moving))
    )
    # the positions' covariances hold the part that an azimuth error has in them alone
    value, turned = sigmas[2] * cross.measured, np.einsum("bkpi,bki->bkp", cross.moving, across)
    both = cross.input + turned
    for sign, scale, by in ((1, 1.0, value), (1, sigmas[1], both), (-1, sigmas[1], turned)):
        noise += sign * scale**2 * np.einsum("bkp,bkq->bpq", by, by)
    shared = propagated(estimate.covariance, noise)
    jacobian = rigid.logarithm_jacobian(estimate.theta) / INTERVAL
    good = estimate.converged
    _, true_slope = doppler_gradients(azimuth, mounting)
    weight = float(np.sqrt(np.mean((sigmas[1] * (true_slope @ theta) / sigmas[2]) ** 2)))
    return weight, StatedCovariances(
        (rigid.logarithm(estimate.theta) / INTERVAL - theta)[good],
        {
            name: (jacobian @ covariance @ np.swapaxes(jacobian, -1, -2))[good]
            for name, covariance in zip(
                COVARIANCES, (estimate.covariance, apart, shared), strict=True
            )
        },
    )


def on_a_drive(
    drive: Drive, driven: Track, pairs: Iterable[int], *, doppler: bool = True
) -> StatedCovariances:
    """Three covariances on these pairs of scans of a drive, started at its track.

    The truth is the velocity at the second scan.  Pairs without a covariance are left out.
    """
    errors, covariances = [], []
    for i in pairs:
        pair = drive.scans[i], drive.scans[i + 1], drive.mounting
        estimate = estimate_ego_motion(*pair, doppler=doppler, initial=driven.theta[i])
        propagated = [
            propagate_ego_motion(estimate, *pair, doppler=doppler, shared_azimuth=shared)
            for shared in (False, True)
        ]
        errors.append(estimate.theta - drive.truth.theta[i + 1])
        covariances.append([estimate.covariance, *propagated])
    error, covariance = np.array(errors), np.array(covariances)
    good = np.isfinite(covariance).all(axis=(1, 2, 3))
    by_name = zip(COVARIANCES, np.swapaxes(covariance[good], 0, 1), strict=True)
    return StatedCovariances(error[good], dict(by_name))
