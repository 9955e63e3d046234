"""Errors of the radars of nuScenes in turns, and of their stated mounting angles.

A static target of a sensor that turns with omega moves across its line of sight with omega r.
Extrapolated along the direction of its motion for a time t, it would be farther away and recede by
omega^2 r t.  The Doppler velocities of these radars contain this, and each mounting angle that is
wrong by beta makes the sensor seem to move sideways with beta v_x.  Both are fitted to the Doppler
velocities of all targets that agree with the reference.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from d2d._types import Array
from d2d.radar.scans.scan import doppler_gradients
from d2d.study.road.drive import Drive, Source

SCENES = ("scene-0061", "scene-0916", "scene-1077")  # of one vehicle; the first is fitted to
_AGREES = 1.0  # m/s: a target that is farther off moves
_TRIMMED = 0.3  # m/s, of the residuals of the fit
_ITERATIONS = 15


def load_stated(source: Source) -> Drive:
    """Load a scene with what the radars report and the mounting angles as stated."""
    return source.load(prediction_time=0.0, stated_mounting=True)


def doppler_residuals(drive: Drive) -> pd.DataFrame:
    """By how much Doppler velocities exceed those that the reference predicts for static targets.

    A row for each target that may be static, where the reference is known: the ``excess`` in m/s;
    ``outward``, omega^2 r in m/s^2; ``ahead``, the cosine of the direction in the vehicle frame,
    and ``sideways``, its sine times v_x in m/s; the ``sensor``; the ``time`` in s; ``turning``,
    omega in rad/s; the ``distance`` in m; ``across``, the velocity of the sensor across the line of
    sight in m/s; ``gain_x``, ``gain_y`` and ``gain_w``, the derivatives of the prediction in v_x,
    v_y and omega; ``change``, that in time, in m/s^2.
    """
    tables = []
    for sensor, recording in enumerate(drive.recordings):
        reference = recording.reference
        changes = np.gradient(reference.theta, reference.times, axis=0)
        for scan, theta, change in zip(recording.scans, reference.theta, changes, strict=True):
            if not scan.size or not np.isfinite([theta, change]).all():
                continue
            gain, slope = doppler_gradients(scan.azimuth, recording.mounting)
            direction = scan.azimuth + recording.mounting.yaw
            excess = scan.doppler - gain @ theta
            columns = {
                "excess": excess,
                "outward": theta[2] ** 2 * scan.range,
                "ahead": np.cos(direction),
                "sideways": theta[0] * np.sin(direction),
                "sensor": sensor,
                "time": scan.time,
                "turning": theta[2],
                "distance": scan.range,
                "across": -slope @ theta,
                **dict(zip(("gain_x", "gain_y", "gain_w"), gain.T, strict=True)),
                "change": gain @ change,
            }
            tables.append(pd.DataFrame(columns)[np.abs(excess) < _AGREES])
    return pd.concat(tables, ignore_index=True)


def per_sensor(residuals: pd.DataFrame, column: str) -> Array:
    """A column (n, S) for each of S sensors, zero for the targets of the others."""
    own = residuals["sensor"].to_numpy()[:, None] == np.arange(residuals["sensor"].max() + 1)
    return np.asarray(own * residuals[column].to_numpy()[:, None])


def mounting_errors(residuals: pd.DataFrame) -> Array:
    """Effects (n, 2 S) of errors of the mounting angle and of the speed of each of S sensors."""
    return np.column_stack([per_sensor(residuals, name) for name in ("sideways", "ahead")])


def trimmed_fit(design: Array, excess: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Least-squares parameters (P,) of a design (n, P), and which of the n are not cut off."""
    keep: NDArray[np.bool_] = np.ones(len(design), dtype=np.bool_)
    for _ in range(_ITERATIONS):
        fitted = np.linalg.lstsq(design[keep], excess[keep], rcond=None)[0]
        keep = np.abs(excess - design @ fitted) < _TRIMMED
    return np.asarray(fitted), keep


def fit_turning(residuals: pd.DataFrame) -> tuple[float, Array]:
    """Prediction time in s, and corrections (S,) of the stated mounting angles in rad.

    A least-squares fit after the largest residuals are cut off.  Each sensor also has its own
    speed, so that an error of the reference's speed does not count.
    """
    design = np.column_stack([residuals["outward"], mounting_errors(residuals)])
    fitted, _ = trimmed_fit(design, residuals["excess"].to_numpy())
    return float(fitted[0]), np.split(fitted[1:], 2)[0]


def fit_scenes(sources: Mapping[str, Source]) -> dict[str, Any]:
    """Prediction time (s) and corrections of the mounting angles (deg), scene by scene."""
    found = {}
    for scene in SCENES:
        time, angles = fit_turning(doppler_residuals(load_stated(sources[scene])))
        found[scene] = {
            "prediction_time": time,
            "mounting_errors": np.rad2deg(angles).tolist(),
        }
    return found
