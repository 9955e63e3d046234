"""Clock, side slip, mountings and noise of a recording, from its residuals.

RadarScenes states no time offset, side slip or standard deviations.  The Doppler velocities of
static targets give the time offset, the side slip and the errors of the mounting angles, as in
`d2d.radar.calibrate`, but with the side slip proportional to v_x omega and without standard
deviations; the residuals after registration give those of the measurements.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray

from d2d import rigid
from d2d._types import Array
from d2d.radar import Recording, Reference, Track, inlier_probabilities
from d2d.radar.evaluation.calibration_model import CalibrationModel, ScanVelocities, fit, fit_at
from d2d.radar.scans.scan import Mounting, RadarScan, doppler_gradients

MAX_OFFSET = 0.25  # s, the largest time offset considered
NORMAL = 1.4826  # standard deviation of a normal variable over its median absolute deviation


class Correction(NamedTuple):
    """The change of the odometry and the mountings that fits the Doppler velocities best."""

    time_offset: float  # s, by which the radar's time stamps are late
    side_slip: float  # s: v_y = side_slip v_x omega
    speed: float  # relative error of the odometry: the radar measures v_x (1 + speed)
    yaw: tuple[float, ...]  # rad, to be added to each sensor's mounting angle
    rms: float  # of the Doppler residuals over their standard deviations


def some_of(velocities: ScanVelocities, chosen: NDArray[np.bool_]) -> ScanVelocities:
    """Velocities of the chosen scans (n,), with their sensors numbered anew from 0."""
    kept = {name: column[chosen] for name, column in velocities._asdict().items()}
    kept["sensor"] = np.unique(kept["sensor"], return_inverse=True)[1]
    return ScanVelocities(**kept)


def residual_rms(velocities: ScanVelocities, odometry: Reference, time_offset: float) -> float:
    """RMS Doppler residual, in standard deviations, of the best correction at a time offset."""
    return float(np.sqrt(fit_at(_model(velocities, odometry), time_offset).mean_square))


def fit_correction(velocities: ScanVelocities, odometry: Reference) -> Correction:
    """The time offset between 0 and 0.25 s, the slip, the speed and the yaws that fit best.

    ``odometry`` must be uncorrected: read with ``time_offset=0``.
    """
    found = fit(_model(velocities, odometry), 0.0, MAX_OFFSET)
    lag, speed, slip, *yaw, _ = map(float, found.parameters)
    return Correction(lag, slip, speed, tuple(yaw), float(np.sqrt(found.mean_square)))


def _model(velocities: ScanVelocities, odometry: Reference) -> CalibrationModel:
    """The model of all sensors with one unbiased odometry, and a slip proportional to v_x omega."""
    model = CalibrationModel.of(velocities, [odometry] * len(np.unique(velocities.sensor)), (1,))
    free = model.free.copy()
    free[-1] = False
    return replace(model, free=free)


def residual_sigmas(
    recording: Recording, track: Track, edges: Sequence[float]
) -> list[dict[str, Any]]:
    """Standard deviations of the measurements, from the residuals after registration.

    Likely inliers, moved by the estimate, are compared with the targets of the previous scan that
    are nearest, mutually.  The median absolute deviations along (m) and across (rad) the line of
    sight are divided by sqrt(2); that of the Doppler velocity (m/s) contains the azimuth's error.
    The true ones are, if anything, larger.  ``track`` has one row for each pair of successive
    scans; ``edges`` (deg) divide ``|azimuth|`` into sectors.
    """
    residuals = [
        _matched_residuals(previous, current, recording.mounting, theta)
        for (previous, current), theta in zip(pairwise(recording.scans), track.theta, strict=True)
        if previous.size and current.size
    ]
    azimuth, *deviations = np.abs(np.concatenate(residuals, axis=1))
    table = pd.DataFrame(dict(zip(("range", "azimuth", "doppler"), deviations, strict=True)))
    groups = table.groupby(pd.cut(np.rad2deg(azimuth), edges, right=False), observed=False)
    sigmas = NORMAL * groups.median() / np.sqrt([2.0, 2.0, 1.0])
    sectors = zip(pairwise(edges), sigmas.to_dict("records"), groups.size(), strict=True)
    return [{"sector": sector, **row, "pairs": int(pairs)} for sector, row, pairs in sectors]


def _matched_residuals(
    previous: RadarScan, current: RadarScan, mounting: Mounting, theta: Array
) -> Array:
    """Azimuths and residuals (along m, across rad, Doppler m/s) of mutually nearest targets."""
    trusted = inlier_probabilities(theta, previous, current, mounting) > 0.5
    motion = rigid.exponential(theta * (current.time - previous.time))
    fixed = previous.point_set(mounting).means
    moved = rigid.transform_means(motion, current.point_set(mounting).means)
    _, nearest_fixed = scipy.spatial.cKDTree(fixed).query(moved)
    _, nearest_moved = scipy.spatial.cKDTree(moved).query(fixed)
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
