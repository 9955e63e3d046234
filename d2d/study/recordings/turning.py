"""What the radars of nuScenes report in turns, and how wrong the stated mounting angles are.

A static target of a sensor that turns with omega moves across its line of sight with omega r.
Extrapolated along the direction of its motion for a time t, it would be farther away and recede by
omega^2 r t.  The Doppler velocities of these radars contain this, and each mounting angle that is
wrong by beta makes the sensor seem to move sideways with beta v_x.  Both are fitted to the Doppler
velocities of all targets that agree with the reference.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from d2d._types import Array
from d2d.radar import Recording, load_nuscenes
from d2d.radar.scans.scan import doppler_gradients

CHANNELS = tuple(
    f"RADAR_{place}" for place in ("FRONT", "FRONT_LEFT", "FRONT_RIGHT", "BACK_LEFT", "BACK_RIGHT")
)
SCENES = ("scene-0061", "scene-0916", "scene-1077")  # of one vehicle; the first is fitted to
_AGREES = 1.0  # m/s: a target that is farther off moves
_TRIMMED = 0.3  # m/s, of the residuals of the fit
_ITERATIONS = 15


class Residuals(NamedTuple):
    """By how much the Doppler velocities of n targets exceed those that the reference predicts."""

    excess: Array  # (n,) m/s
    outward: Array  # (n,) m/s^2, omega^2 r
    ahead: Array  # (n,) cosine of the direction in the vehicle frame
    sideways: Array  # (n,) m/s, its sine times v_x
    sensor: NDArray[np.int64]  # (n,)
    time: Array  # (n,) s
    turning: Array  # (n,) rad/s, omega
    distance: Array  # (n,) m
    across: Array  # (n,) m/s, velocity of the sensor across the line of sight
    gain: Array  # (n, 3), derivatives of the prediction in v_x, v_y and omega
    change: Array  # (n,) m/s^2, of the prediction


def load_stated(root: str | Path, scene: str) -> list[Recording]:
    """All radars of a scene, with what they report and the mounting angles as stated."""
    return [
        load_nuscenes(root, scene, channel, prediction_time=0.0, stated_mounting=True)
        for channel in CHANNELS
    ]


def doppler_residuals(recordings: Sequence[Recording]) -> Residuals:
    """The residuals of all targets that may be static, where the reference is known."""
    columns: list[tuple[Any, ...]] = []
    for sensor, recording in enumerate(recordings):
        reference = recording.reference
        changes = np.gradient(reference.theta, reference.times, axis=0)
        for scan, theta, change in zip(recording.scans, reference.theta, changes, strict=True):
            if not scan.size or not np.isfinite([theta, change]).all():
                continue
            gain, slope = doppler_gradients(scan.azimuth, recording.mounting)
            excess = scan.doppler - gain @ theta
            static = np.abs(excess) < _AGREES
            direction = scan.azimuth[static] + recording.mounting.yaw
            columns.append(
                (
                    excess[static],
                    theta[2] ** 2 * scan.range[static],
                    np.cos(direction),
                    theta[0] * np.sin(direction),
                    np.full(static.sum(), sensor),
                    np.full(static.sum(), scan.time),
                    np.full(static.sum(), theta[2]),
                    scan.range[static],
                    -slope[static] @ theta,
                    gain[static],
                    gain[static] @ change,
                )
            )
    return Residuals(*(np.concatenate(column) for column in zip(*columns, strict=True)))


def own_errors(residuals: Residuals) -> Array:
    """What errors (n, 2 S) of the mounting angle and the speed of each of S sensors would do."""
    own = residuals.sensor[:, None] == np.arange(residuals.sensor.max() + 1)
    return np.column_stack([own * residuals.sideways[:, None], own * residuals.ahead[:, None]])


def trimmed_fit(design: Array, excess: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Least-squares parameters (P,) of a design (n, P), and which of the n are not cut off."""
    keep: NDArray[np.bool_] = np.ones(len(design), dtype=np.bool_)
    for _ in range(_ITERATIONS):
        fitted = np.linalg.lstsq(design[keep], excess[keep], rcond=None)[0]
        keep = np.abs(excess - design @ fitted) < _TRIMMED
    return np.asarray(fitted), keep


def fit_turning(residuals: Residuals) -> tuple[float, Array]:
    """Prediction time in s, and what is to be added to the stated angles (S,) in rad.

    A least-squares fit after the largest residuals are cut off.  Each sensor also has its own
    speed, so that an error of the reference's speed does not count.
    """
    design = np.column_stack([residuals.outward, own_errors(residuals)])
    fitted, _ = trimmed_fit(design, residuals.excess)
    return float(fitted[0]), np.split(fitted[1:], 2)[0]


def of_turning(root: str | Path) -> dict[str, Any]:
    """What the page shows, scene by scene."""
    found = {}
    for scene in SCENES:
        time, angles = fit_turning(doppler_residuals(load_stated(root, scene)))
        found[scene] = {
            "prediction_time": time,
            "mounting_errors": np.rad2deg(angles).tolist(),
        }
    return found
