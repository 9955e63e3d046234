"""What a recording says of its own clock, slip, mountings and noise.

RadarScenes states neither a time offset nor side slip nor standard deviations.  The Doppler
velocities of static targets tell the first three, the residuals after registration the last.
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
from d2d._checks import Array
from d2d.radar import Recording, Reference, Track, doppler_ego_motion, inlier_probabilities
from d2d.radar.scan import Mounting, RadarScan, doppler_gradients

LATEST = 0.25  # s, the largest time offset looked for
NORMAL = 1.4826  # standard deviation of a normal variable over its median absolute deviation


@dataclass(frozen=True)
class Correction:
    """How the odometry and the mountings must be changed to suit the Doppler velocities best.

    Attributes
    ----------
    time_offset : float, s
        The radar's time stamps are late by this much.
    side_slip : float, s
        v_y = side_slip v_x omega.
    speed : float
        Relative: the radar sees v_x (1 + speed).
    yaw : tuple of float, rad
        To be added to each sensor's mounting angle.
    rms : float
        Of the Doppler residuals in their standard deviations.
    """

    time_offset: float
    side_slip: float
    speed: float
    yaw: tuple[float, ...]
    rms: float


class StaticTargets(NamedTuple):
    """Targets that agree with one velocity of their sensor, (n,) each and (n, 3)."""

    sensor: NDArray[np.int64]
    time: Array
    doppler: Array
    sigma: Array
    gain: Array  # of the Doppler velocity in [v_x, v_y, omega]
    slope: Array  # its derivative in the azimuth, in the same


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
            same = np.ones(len(sigma))
            parts.append((s * same, scan.time * same, scan.doppler[chosen], sigma, gain, slope))
    sensor, *columns = (np.concatenate(column) for column in zip(*parts, strict=True))
    return StaticTargets(sensor.astype(np.int64), *columns)


def residual_rms(
    targets: StaticTargets, odometry: Reference, time_offset: float
) -> tuple[float, Array]:
    """RMS Doppler residual in standard deviations at a time offset, and what else fits best then.

    The rest, [side_slip, speed, yaw of each sensor], enters linearly for small angles.
    """
    theta = odometry.at(targets.time - time_offset).theta
    known = np.isfinite(theta).all(axis=1)
    theta, sigma = theta[known], targets.sigma[known]
    v, omega = theta[:, 0], theta[:, 2]
    plain = np.column_stack([v, np.zeros_like(v), omega])
    gain, slope = targets.gain[known], targets.slope[known]
    turned = np.einsum("kp,kp->k", slope, plain)
    sensors = targets.sensor[known]
    columns = [gain[:, 1] * v * omega, gain[:, 0] * v]
    columns += [turned * (sensors == s) for s in range(int(targets.sensor.max()) + 1)]
    system = np.column_stack(columns) / sigma[:, None]
    missing = (targets.doppler[known] - np.einsum("kp,kp->k", gain, plain)) / sigma
    best = np.linalg.lstsq(system, missing, rcond=None)[0]
    return float(np.sqrt(np.mean((missing - system @ best) ** 2))), best


def fit_correction(targets: StaticTargets, odometry: Reference) -> Correction:
    """The time offset within 0 to 0.25 s, the slip, the speed and the yaws that fit best.

    ``odometry`` must be uncorrected: read with ``time_offset=0`` and ``side_slip=0``.
    """
    found = minimize_scalar(
        lambda offset: residual_rms(targets, odometry, offset)[0],
        bounds=(0.0, LATEST),
        method="bounded",
        options={"xatol": 1e-5},
    )
    rms, (slip, speed, *yaw) = residual_rms(targets, odometry, float(found.x))
    return Correction(float(found.x), float(slip), float(speed), tuple(map(float, yaw)), rms)


def during(recording: Recording, first: float, last: float) -> Recording:
    """The scans within [first, last) seconds of the recording's first."""
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
    doppler: float  # m/s, with the azimuth's share in it
    pairs: int


def residual_sigmas(recording: Recording, track: Track, edges: Sequence[float]) -> list[Sigmas]:
    """Standard deviations of the measurements from what the registration leaves.

    Each target of probability over one half is compared with the nearest one of the scan before,
    moved by the estimate, if each is the other's nearest: along and across the line of sight, over
    sqrt(2) because both err.  Median absolute deviations, so that wrong matches count little; the
    nearest target is a little too near, so that the true deviations are not smaller.

    Parameters
    ----------
    recording, track
        The track of this recording, one row for each successive pair.
    edges : sequence of float, deg
        Of the sectors of |azimuth|.
    """
    rows = []
    for (previous, current), theta in zip(pairwise(recording.scans), track.theta, strict=True):
        if previous.size and current.size:
            rows.append(_left(previous, current, recording.mounting, theta))
    azimuth, along, across, doppler = np.concatenate(rows, axis=1)
    off = np.rad2deg(np.abs(azimuth))
    found = []
    for low, high in pairwise(edges):
        inside = (off >= low) & (off < high)
        deviations = [
            NORMAL * float(np.median(np.abs(values[inside]))) for values in (along, across, doppler)
        ]
        found.append(
            Sigmas(
                (low, high),
                deviations[0] / np.sqrt(2.0),
                deviations[1] / np.sqrt(2.0),
                deviations[2],
                int(inside.sum()),
            )
        )
    return found


def _left(previous: RadarScan, current: RadarScan, mounting: Mounting, theta: Array) -> Array:
    """Azimuth, residuals along (m) and across (rad) and of Doppler (m/s), (4, matches)."""
    trusted = inlier_probabilities(theta, previous, current, mounting) > 0.5
    motion = rigid.exponential(theta * (current.time - previous.time))
    fixed = previous.point_set(mounting).means
    moved = rigid.transform_means(motion, current.point_set(mounting).means)
    _, there = cKDTree(fixed).query(moved)
    _, back = cKDTree(moved).query(fixed)
    mutual = trusted & (back[there] == np.arange(len(moved)))
    sight = moved[mutual] - mounting.pose[:2]
    distance = np.linalg.norm(sight, axis=1)
    off = moved[mutual] - fixed[there[mutual]]
    along = np.einsum("ki,ki->k", off, sight) / distance
    across = (sight[:, 0] * off[:, 1] - sight[:, 1] * off[:, 0]) / distance**2
    gain, _ = doppler_gradients(current.azimuth[mutual], mounting)
    return np.stack(
        [current.azimuth[mutual], along, across, current.doppler[mutual] - gain @ theta]
    )
