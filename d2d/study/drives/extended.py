"""Objects that are larger than a point: the effect on errors and covariances."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from d2d import rigid
from d2d._types import Array
from d2d.radar import (
    ExtentEstimate,
    Mounting,
    RadarScan,
    doppler_velocity,
    estimate_ego_motion,
    estimate_extent,
    propagate_ego_motion,
)
from d2d.radar.readers.radarscenes import azimuth_sigma
from d2d.study.drives.errors import IN_UNITS
from d2d.study.runs import StatedCovariances

THETA = np.array([15.0, 0.0, 0.05])  # m/s, m/s, rad/s
MOUNTING = Mounting(3.7, 0.0, 0.0)
INTERVAL = 0.07  # s
SIGMA_RANGE, SIGMA_DOPPLER = 0.15, 0.06  # m, m/s; with `azimuth_sigma`, as for RadarScenes
NEAREST, FARTHEST, WIDEST = 5.0, 50.0, np.deg2rad(60.0)  # m, m, rad: what the sensor sees
OBJECTS = 40  # in view on average
MOST = 8  # points of an object that reflect
COUNT = 100  # scans

COVARIANCES = ("inverse Hessian", "propagated")
MODELS = ("no extent", "likeliest extent", "true extent")


def extended_drive(
    rng: np.random.Generator,
    half_width: float,
    *,
    redrawn: bool = True,
) -> list[RadarScan]:
    """Scans (`COUNT`) of objects with several targets each, from a vehicle of velocity `THETA`.

    An object has 1 to `MOST` points that reflect, uniformly within ``half_width`` (m) of its
    middle along both axes; their standard deviation along each is ``half_width / sqrt(3)``.  They
    are drawn anew for every scan if ``redrawn``, and otherwise stay where they are.  About 40
    objects are in view.
    """
    middles = _middles(rng, COUNT * INTERVAL)
    numbers = rng.integers(1, MOST + 1, len(middles))
    owners = np.repeat(middles, numbers, axis=0)

    def drawn() -> Array:
        return owners + rng.uniform(-half_width, half_width, owners.shape)

    points, scans = drawn(), []
    for i in range(COUNT):
        points = drawn() if redrawn else points
        pose = rigid.exponential(i * INTERVAL * THETA)
        to_sensor = rigid.inverse(rigid.compose(pose, MOUNTING.pose))
        x, y = rigid.transform_means(to_sensor, points).T
        distance, azimuth = np.hypot(x, y), np.arctan2(y, x)
        in_view = (distance > NEAREST) & (distance < FARTHEST) & (np.abs(azimuth) < WIDEST)
        distance, azimuth = distance[in_view], azimuth[in_view]
        doppler = doppler_velocity(THETA, azimuth, MOUNTING)
        sigmas = SIGMA_RANGE, azimuth_sigma(azimuth), SIGMA_DOPPLER
        noise = rng.standard_normal((3, len(distance)))
        scans.append(
            RadarScan(
                i * INTERVAL,
                distance + sigmas[0] * noise[0],
                azimuth + sigmas[1] * noise[1],
                doppler + sigmas[2] * noise[2],
                *sigmas,
            )
        )
    return scans


def _middles(rng: np.random.Generator, duration: float) -> Array:
    """Middles of objects (M, 2), spread evenly over all that is seen during the drive."""
    ends = rigid.exponential(np.linspace(0.0, duration, 20)[:, None] * THETA)[:, :2]
    low, high = ends.min(axis=0) - FARTHEST, ends.max(axis=0) + FARTHEST
    in_view = WIDEST * (FARTHEST**2 - NEAREST**2)  # m^2
    number = round(OBJECTS * float(np.prod(high - low)) / in_view)
    return rng.uniform(low, high, (number, 2))


class ExtendedStudy(NamedTuple):
    """Errors of the estimates between successive scans, and their covariances."""

    half_width: float  # m, of the objects
    redrawn: bool  # whether each scan shows other points of them
    estimate: ExtentEstimate  # the extent at which the scans are most likely
    judged: dict[str, StatedCovariances]  # in m/s, m/s, rad/s, `COVARIANCES` of each of `MODELS`

    def rmse(self, model: str) -> Array:
        """Root mean square errors (3,) in m/s, m/s, deg/s."""
        return np.asarray(np.sqrt(np.mean(self.judged[model].errors ** 2, axis=0)) * IN_UNITS)


def extended_study(
    rng: np.random.Generator, half_width: float, *, redrawn: bool = True
) -> ExtendedStudy:
    """Estimate a drive among extended objects without an extent, and with two.

    See `extended_drive` for the arguments.  Every estimate starts at the true velocity.
    """
    scans = extended_drive(rng, half_width, redrawn=redrawn)
    estimate = estimate_extent(scans, MOUNTING, max_pairs=25)
    true = half_width / math.sqrt(3.0) if redrawn else 0.0
    judged = {
        model: _estimates([scan.with_extent(extent) for scan in scans])
        for model, extent in zip(MODELS, (0.0, estimate.extent, true), strict=True)
    }
    return ExtendedStudy(half_width, redrawn, estimate, judged)


def _estimates(scans: Sequence[RadarScan]) -> StatedCovariances:
    errors, covariances = [], []
    for pair in pairwise(scans):
        estimate = estimate_ego_motion(*pair, MOUNTING, initial=THETA)
        if estimate.converged:
            errors.append(estimate.theta - THETA)
            propagated = propagate_ego_motion(estimate, *pair, MOUNTING)
            covariances.append((estimate.covariance, propagated))
    both = np.swapaxes(covariances, 0, 1)
    return StatedCovariances(np.array(errors), dict(zip(COVARIANCES, both, strict=True)))
