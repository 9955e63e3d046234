"""What a recording reveals about its own clock, side slip, mountings and noise.

RadarScenes states no time offset, side slip or standard deviations.  The Doppler velocities of
static targets give the time offset, the side slip and the errors of the mounting angles; the
residuals after registration give the standard deviations.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.spatial import cKDTree

from d2d import rigid
from d2d._types import Array
from d2d.radar import Recording, Reference, Track, doppler_ego_motion, inlier_probabilities
from d2d.radar.scan import Mounting, RadarScan, doppler_gradients

MAX_OFFSET = 0.25  # s, the largest time offset considered
NORMAL = 1.4826  # standard deviation of a normal variable over its median absolute deviation


@dataclass(frozen=True)
class Correction:
    """The change of the odometry and the mountings that fits the Doppler velocities best.

    Attributes
    ----------
    time_offset : float, s
        The radar's time stamps are late by this much.
    side_slip : float, s
        v_y = side_slip v_x omega.
    speed : float
        Relative error of the odometry's speed: the radar measures v_x (1 + speed).
    yaw : tuple of float, rad
        Angle to be added to each sensor's mounting angle.
    rms : float
        Root mean square of the Doppler residuals over their standard deviations.
    """

    time_offset: float
    side_slip: float
    speed: float
    yaw: tuple[float, ...]
    rms: float


class StaticTargets(NamedTuple):
    """Targets whose Doppler velocities agree with one velocity of their sensor.

    The arrays have n entries, those of ``gain`` and ``slope`` the shape (n, 3).
    """

    sensor: NDArray[np.int64]
    time: Array
    doppler: Array
    sigma: Array
    gain: Array  # derivative of the Doppler velocity with respect to [v_x, v_y, omega]
    slope: Array  # derivative of the gain with respect to the azimuth


def static_targets(recordings: Sequence[Recording]) -> StaticTargets:
    """The static targets of every scan, found from the scan's own Doppler velocities alone."""
    parts = []
    for s, recording in enumerate(recordings):
        for scan in recording.scans:
            motion = doppler_ego_motion([(scan, recording.mounting)])
            chosen = motion.inliers[0]
            gain, slope = doppler_gradients(scan.azimuth[chosen], recording.mounting)
            sigma = np.hypot(
                scan.sigma_doppler[chosen], scan.sigma_azimuth[chosen] * (slope @ motion.theta)
            )
            ones = np.ones(len(sigma))
            parts.append((s * ones, scan.time * ones, scan.doppler[chosen], sigma, gain, slope))
    sensor, *columns = (np.concatenate(column) for column in zip(*parts, strict=True))
    return StaticTargets(sensor.astype(np.int64), *columns)


def residual_rms(
    targets: StaticTargets, odometry: Reference, time_offset: float
) -> tuple[float, Array]:
    """RMS Doppler residual at a time offset, and the other parameters that fit best there.

    The residual is in standard deviations.  The other parameters, [side_slip, speed, yaw of each
    sensor], enter linearly for small angles.
    """
    theta = odometry.at(targets.time - time_offset).theta
    known = np.isfinite(theta).all(axis=1)
    theta, sigma = theta[known], targets.sigma[known]
    v, omega = theta[:, 0], theta[:, 2]
    uncorrected = np.column_stack([v, np.zeros_like(v), omega])
    gain, slope = targets.gain[known], targets.slope[known]
    yaw_gain = np.einsum("kp,kp->k", slope, uncorrected)
    sensors = targets.sensor[known]
    columns = [gain[:, 1] * v * omega, gain[:, 0] * v]
    columns += [yaw_gain * (sensors == s) for s in range(int(targets.sensor.max()) + 1)]
    system = np.column_stack(columns) / sigma[:, None]
    unexplained = (targets.doppler[known] - np.einsum("kp,kp->k", gain, uncorrected)) / sigma
    best = np.linalg.lstsq(system, unexplained, rcond=None)[0]
    return float(np.sqrt(np.mean((unexplained - system @ best) ** 2))), best


def fit_correction(targets: StaticTargets, odometry: Reference) -> Correction:
    """The time offset between 0 and 0.25 s, the slip, the speed and the yaws that fit best.

    ``odometry`` must be uncorrected: read with ``time_offset=0`` and ``side_slip=0``.
    """
    minimum = minimize_scalar(
        lambda offset: residual_rms(targets, odometry, offset)[0],
        bounds=(0.0, MAX_OFFSET),
        method="bounded",
        options={"xatol": 1e-5},
    )
    rms, (slip, speed, *yaw) = residual_rms(targets, odometry, float(minimum.x))
    return Correction(float(minimum.x), float(slip), float(speed), tuple(map(float, yaw)), rms)


def during(recording: Recording, first: float, last: float) -> Recording:
    """The scans from ``first`` to before ``last``, in s after the recording's first scan."""
    start = recording.scans[0].time
    scans = [scan for scan in recording.scans if first <= scan.time - start < last]
    return Recording(
        scans, recording.mounting, recording.reference.at([scan.time for scan in scans])
    )


def turned(recording: Recording, yaw: float) -> Recording:
    """The recording with ``yaw`` (rad) added to the mounting angle."""
    mounting = recording.mounting
    return replace(recording, mounting=Mounting(mounting.x, mounting.y, mounting.yaw + yaw))


class Sigmas(NamedTuple):
    """Standard deviations in one sector of azimuth, from residuals."""

    sector: tuple[float, float]  # |azimuth|, deg
    range: float  # m
    azimuth: float  # rad, across the line of sight
    doppler: float  # m/s, including the effect of the azimuth error
    pairs: int


def residual_sigmas(recording: Recording, track: Track, edges: Sequence[float]) -> list[Sigmas]:
    """Standard deviations of the measurements, from the residuals after registration.

    Each target with an inlier probability above one half is moved by the estimate and compared with
    the nearest target of the previous scan, if each is the other's nearest.  The deviations along
    and across the line of sight are divided by sqrt(2), because both targets err.  They are median
    absolute deviations, so that wrong matches count little.  The nearest target tends to be a
    little too near, so the true standard deviations are, if anything, larger.

    Parameters
    ----------
    recording, track
        A recording and its track, which has one row for each pair of successive scans.
    edges : sequence of float, deg
        Edges of the sectors of ``|azimuth|``.
    """
    residuals = []
    for (previous, current), theta in zip(pairwise(recording.scans), track.theta, strict=True):
        if previous.size and current.size:
            residuals.append(_matched_residuals(previous, current, recording.mounting, theta))
    azimuth, along, across, doppler = np.concatenate(residuals, axis=1)
    degrees = np.rad2deg(np.abs(azimuth))
    sigmas = []
    for low, high in pairwise(edges):
        inside = (degrees >= low) & (degrees < high)
        deviations = [
            NORMAL * float(np.median(np.abs(values[inside]))) for values in (along, across, doppler)
        ]
        sigmas.append(
            Sigmas(
                (low, high),
                deviations[0] / np.sqrt(2.0),
                deviations[1] / np.sqrt(2.0),
                deviations[2],
                int(inside.sum()),
            )
        )
    return sigmas


def _matched_residuals(
    previous: RadarScan, current: RadarScan, mounting: Mounting, theta: Array
) -> Array:
    """Azimuth and residuals (4, matches) of the targets that are each other's nearest.

    The residuals are those along (m) and across (rad) the line of sight and of the Doppler velocity
    (m/s).
    """
    trusted = inlier_probabilities(theta, previous, current, mounting) > 0.5
    motion = rigid.exponential(theta * (current.time - previous.time))
    fixed = previous.point_set(mounting).means
    moved = rigid.transform_means(motion, current.point_set(mounting).means)
    _, nearest_fixed = cKDTree(fixed).query(moved)
    _, nearest_moved = cKDTree(moved).query(fixed)
    mutual = trusted & (nearest_moved[nearest_fixed] == np.arange(len(moved)))
    sight = moved[mutual] - mounting.pose[:2]
    distance = np.linalg.norm(sight, axis=1)
    difference = moved[mutual] - fixed[nearest_fixed[mutual]]
    along = np.einsum("ki,ki->k", difference, sight) / distance
    across = (sight[:, 0] * difference[:, 1] - sight[:, 1] * difference[:, 0]) / distance**2
    gain, _ = doppler_gradients(current.azimuth[mutual], mounting)
    return np.stack(
        [current.azimuth[mutual], along, across, current.doppler[mutual] - gain @ theta]
    )
