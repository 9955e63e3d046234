"""Reader of the radars of the nuScenes data set (Caesar et al. 2020) in its official layout.

The data set is licensed CC BY-NC-SA 4.0 and is not part of this package.
"""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from d2d._checks import check_count, check_flag, check_path, check_positive_scalar, check_seconds
from d2d._types import Array
from d2d.radar.files import existing, read_json, strongest_targets
from d2d.radar.readers.pcd import read_pcd
from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.scans.recording import LONGEST_OFFSET, Recording
from d2d.radar.scans.reference import Reference
from d2d.radar.scans.scan import MAX_RANGE, Mounting, RadarScan

MICROSECOND = 1e-6
GRID = 0.2  # m, to which x and y are rounded
STEP = 0.25  # m/s, to which vx and vy are rounded

# What the data sheet of the ARS 408 calls valid, and the state "no ambiguity of the velocity".
_VALID = (0, 4, 8, 9, 10, 11, 12, 15, 16, 17)
_UNAMBIGUOUS = 3
_FIELDS = ("x", "y", "vx", "vy", "rcs", "invalid_state", "ambig_state")

# Fitted to the errors of all five radars together in scenes 0061 and 0103, by maximum likelihood,
# baseline 2, and then widened by a factor of 1.6: two scenes are two draws of what differs from
# scene to scene.  As fitted, two other scenes had an ANEES of 2.4 (0916, in tight turns) and 1.0
# (1077).
NUSCENES_BUDGET = ErrorBudget(
    azimuth=float(np.deg2rad(0.55)),
    doppler=0.055,
    scale=0.0026,
    lag=0.03,
    neighbours=1.0,
    source="nuScenes, five radars, fitted to scenes 0061 and 0103, then widened",
)

# The speed on the CAN bus is that much later than the poses there (fitted as below).
_SPEED_DELAY = 0.1  # s
_LONGEST_PREDICTION = 1.0  # s; the radar's cycle is 75 ms
WHEELBASE = 2.588  # m, of the Renault Zoe

# What is to be added to the mounting angles (deg), by channel and by the angle that the tables
# state: one vehicle has them from scene 0061, the other from scene 0103
# (d2d.study.recordings.turning).
MOUNTING_ERRORS: dict[str, dict[float, float]] = {
    "RADAR_FRONT": {0.2: -0.74, -0.26: 0.24},
    "RADAR_FRONT_LEFT": {88.36: 0.99, 90.68: -0.02},
    "RADAR_FRONT_RIGHT": {-90.98: 1.11, -89.74: -0.21},
    "RADAR_BACK_LEFT": {174.41: 0.51, 174.74: 0.07},
    "RADAR_BACK_RIGHT": {-176.11: 0.24, -175.0: -0.08},
}

Table = list[dict[str, Any]]


def azimuth_sigma(azimuth: Array) -> Array:
    """Standard deviation of the azimuth, rad: 0.3 deg ahead, rising to 0.6 deg at 60 deg.

    It fits the residuals of targets that are registered from one scan to the next, in scenes 0061
    and 0103, beyond 30 m: 0.30, 0.38, 0.42 and 0.47 deg in the four sectors of 15 deg.
    """
    return np.asarray(np.deg2rad(0.3 + 0.005 * np.abs(np.rad2deg(azimuth))))


def load_nuscenes(
    root: str | os.PathLike[str],
    scene: str,
    channel: str,
    *,
    version: str | None = None,
    strongest: int | None = None,
    time_offset: float = -0.03,
    speed_factor: float | None = 1.0125,
    prediction_time: float = 0.037,
    stated_mounting: bool = False,
    half_width: float = 0.2,
    sigma_range: float = 0.15,
    sigma_azimuth: float | Callable[[Array], ArrayLike] = azimuth_sigma,
    sigma_doppler: float = 0.06,
    extent: float = 0.1,
) -> Recording:
    """Read one radar's scans of one scene.

    Parameters
    ----------
    root : path
        The folder that contains ``v1.0-*/`` with the tables, ``samples/``, ``sweeps/`` and, if
        present, ``can_bus/``; a leading ``~`` is replaced by the home folder.
    scene : str
        Name, such as "scene-0061".
    channel : str
        Name of the radar, such as "RADAR_FRONT".
    version : str, optional
        Name of the folder with the tables, such as "v1.0-mini"; needed only if there are several.
    strongest : int, optional
        Keep only this many targets of each scan, those of largest radar cross-section.
    time_offset : float, s
        Delay of the radar's time stamps: a scan at t shows the motion that the poses give for
        t - time_offset.
    speed_factor : float or None
        The speed on the CAN bus, which is too low and 0.1 s later than the poses, times this factor
        is taken as the speed of the front axle, and v_x as that of the rear axle.  With None, or
        without a CAN bus, v_x is the derivative of the poses too.
    prediction_time : float, s
        In a turn the radar reports the velocity of a static target at range r as larger by omega^2
        r times this.  The excess is removed with the yaw rate of the reference; 0 leaves the
        velocities unchanged.
    stated_mounting : bool
        Whether the mounting angle is the one that the tables state, without `MOUNTING_ERRORS`.
    half_width : float, s
        Poses within this time are smoothed and differentiated; see `Reference.from_poses`.
    sigma_range, sigma_doppler : float, m and m/s
        Standard deviations.  The rounding of positions to 0.2 m and of velocities to 0.25 m/s is
        added to them.
    sigma_azimuth : float or function of the azimuths (K,), rad
        Standard deviation, or a function that returns those of the azimuths; rounding is added.
    extent : float, m
        Scatter of the points at which objects are seen; see `RadarScan`.

    Returns
    -------
    Recording
        With the budget `NUSCENES_BUDGET`.  Times in s, in the frame whose origin is the middle of
        the rear axle.  Targets are kept if the radar calls them valid and their velocity
        unambiguous, if position and velocity are finite, and within 10 km.  The radar's velocity is
        projected onto the line of sight.  The reference's v_y and omega are the derivatives of the
        poses on the CAN bus, or else of those in ``ego_pose.json``.

    Raises
    ------
    FileNotFoundError
        If a file or folder is missing; the message gives its path and what should be there.
    ValueError
        If a file is not one of nuScenes, the scene or channel is not in the tables, or an argument
        is out of range.

    Notes
    -----
    The defaults come from scenes 0061 and 0103.  The Doppler velocities of the five radars fit the
    derivative of the positions best at an offset of -0.03 s, the speed of the CAN bus at -0.13 s
    and a factor of 1.012; what remains in v_x is 0.065 and 0.031 m/s: the positions of the
    localisation jitter, the speed does not.  Residuals of single targets, with the rounding: 0.15 m
    in range, 0.09 to 0.10 m/s in Doppler velocity.  If a target is extrapolated along a straight
    line for a time t, with its velocity in the frame of the turning sensor, it recedes by omega^2 r
    t; the radar seems to do this over half of its cycle of 75 ms.  In bends the speed on the CAN
    bus exceeds that of the rear axle as the speed of the front axle does.  The data sheet's codes
    ``x_rms`` and ``vx_rms`` in the files (0.6 to 1.3 m, 0.29 to 0.37 m/s) are several times the
    residuals, and are not used.
    """
    if strongest is not None:
        check_count("strongest", strongest)
    offset = check_seconds("time_offset", time_offset, LONGEST_OFFSET)
    check_flag("stated_mounting", stated_mounting)
    prediction = check_seconds("prediction_time", prediction_time, _LONGEST_PREDICTION)
    for name, sigma in (("sigma_range", sigma_range), ("sigma_doppler", sigma_doppler)):
        check_positive_scalar(name, sigma)
    if speed_factor is not None:
        check_positive_scalar("speed_factor", speed_factor)
    folder = check_path("root", root)
    tables = _tables(folder, version)
    drive = _drive(tables, scene, channel)
    motion = _motion(folder, tables, scene, drive)

    times = np.array([time for time, _ in drive.files])
    moved = Reference.from_poses(motion.times, motion.poses, times - offset, half_width=half_width)
    theta = moved.theta
    if speed_factor is not None and motion.speed is not None:
        late = times - offset + _SPEED_DELAY
        speed = np.interp(late, motion.times, motion.speed, left=np.nan, right=np.nan)
        theta[:, 0] = _of_rear_axle(speed_factor * speed, theta[:, 2])
    reference = Reference(times, theta, moved.poses)

    scans = []
    excesses = prediction * _filled(theta[:, 2]) ** 2
    for (time, file), excess in zip(drive.files, excesses, strict=True):
        path = existing(folder, file, f"a scan of {channel}")
        targets = _valid(read_pcd(path, _FIELDS), strongest)
        x, y = targets["x"], targets["y"]
        azimuth = np.arctan2(y, x)
        velocity = np.stack([targets["vx"] - excess * x, targets["vy"] - excess * y], axis=-1)
        scans.append(
            RadarScan.from_cartesian(
                time,
                x,
                y,
                velocity=velocity,
                grid=GRID,
                step=STEP,
                sigma_range=sigma_range,
                sigma_azimuth=sigma_azimuth(azimuth) if callable(sigma_azimuth) else sigma_azimuth,
                sigma_doppler=sigma_doppler,
            ).with_extent(extent)
        )
    mounting = drive.mounting if stated_mounting else _corrected(drive.mounting, channel)
    return Recording(scans, mounting, reference, NUSCENES_BUDGET)


def _of_rear_axle(speed: Array, omega: Array) -> Array:
    """Speed (n,) of the rear axle, from that of the front axle and the yaw rate."""
    return np.sign(speed) * np.sqrt(np.maximum(speed**2 - (WHEELBASE * omega) ** 2, 0.0))


def _filled(values: Array) -> Array:
    """Values (n,), with unknown ones replaced by the nearest known ones, or by zero."""
    known = np.flatnonzero(np.isfinite(values))
    if not len(known):
        return np.zeros_like(values)
    return np.interp(np.arange(len(values)), known, values[known])


def _corrected(mounting: Mounting, channel: str) -> Mounting:
    """The mounting with the error of its angle removed, if the error is known."""
    stated = float(np.rad2deg(mounting.yaw))
    for angle, error in MOUNTING_ERRORS.get(channel, {}).items():
        if abs(stated - angle) < 0.01:
            return replace(mounting, yaw=mounting.yaw + float(np.deg2rad(error)))
    return mounting


def _tables(root: Path, version: Any) -> Path:
    """The folder with the tables."""
    if version is not None:
        if not isinstance(version, str):
            raise ValueError(f"version must be a name like v1.0-mini, but is {version!r}")
        return existing(root, version, "the folder of the tables of that version")
    found = sorted(path.name for path in root.glob("v1.0-*") if path.is_dir())
    if not found:
        raise FileNotFoundError(
            f"{root / 'v1.0-*'} does not exist; it should be the folder of the tables of nuScenes"
        )
    if len(found) > 1:
        raise ValueError(f"version must be given, because there are several: {', '.join(found)}")
    return root / found[0]


def _table(folder: Path, name: str, texts: tuple[str, ...], others: tuple[str, ...] = ()) -> Table:
    """The rows of a table, each checked to have these entries."""
    path = existing(folder, f"{name}.json", f"the table {name!r} of nuScenes")
    rows = read_json(path)
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise ValueError(f"{path} is not a table of nuScenes: it is not a list of objects")
    for key in texts:
        if not all(isinstance(row.get(key), str) for row in rows):
            raise ValueError(f"{path} is not a table of nuScenes: a row has no text {key!r}")
    for key in others:
        if not all(key in row for row in rows):
            raise ValueError(f"{path} is not a table of nuScenes: a row has no {key!r}")
    return rows


class _Drive(NamedTuple):
    """What the tables say of one radar in one scene."""

    files: list[tuple[float, str]]  # time in s and name, in time order
    mounting: Mounting
    poses: set[str]  # tokens of the ego poses of all sensors


def _drive(folder: Path, scene: str, channel: str) -> _Drive:
    scenes = {row["name"]: row["token"] for row in _table(folder, "scene", ("name", "token"))}
    _choose("scene", scene, scenes)
    sensors = {
        row["channel"]: row["token"]
        for row in _table(folder, "sensor", ("channel", "token", "modality"))
        if row["modality"] == "radar"
    }
    _choose("channel", channel, sensors)
    mountings = {
        row["token"]: row
        for row in _table(folder, "calibrated_sensor", ("token", "sensor_token"))
        if row["sensor_token"] == sensors[channel]
    }
    samples = {
        row["token"]
        for row in _table(folder, "sample", ("token", "scene_token"))
        if row["scene_token"] == scenes[scene]
    }
    texts = ("sample_token", "calibrated_sensor_token", "ego_pose_token", "filename")
    data = [
        row
        for row in _table(folder, "sample_data", texts, ("timestamp",))
        if row["sample_token"] in samples
    ]
    path = folder / "sample_data.json"
    own = [row for row in data if row["calibrated_sensor_token"] in mountings]
    used = {row["calibrated_sensor_token"] for row in own}
    if len(used) != 1:
        found = f"{len(used)} mountings" if used else "no scan"
        raise ValueError(f"{path} has {found} of {channel} in {scene}")
    times = _stamps(path, [row["timestamp"] for row in own])
    files = sorted(zip(times.tolist(), (row["filename"] for row in own), strict=True))
    mounting = _mounting(folder / "calibrated_sensor.json", mountings[used.pop()])
    return _Drive(files, mounting, {row["ego_pose_token"] for row in data})


def _choose(name: str, value: Any, choices: dict[str, str]) -> None:
    if not isinstance(value, str) or value not in choices:
        raise ValueError(f"{name} must be one of {', '.join(sorted(choices))}, but is {value!r}")


def _mounting(path: Path, row: dict[str, Any]) -> Mounting:
    try:
        x, y, _ = row["translation"]
        (yaw,) = _yaws([row["rotation"]])
        return Mounting(x, y, float(yaw))
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(
            f"{path} is not a table of nuScenes: a row has no translation and rotation ({error!r})"
        ) from None


class _Motion(NamedTuple):
    """What is known of the vehicle's motion."""

    times: Array  # (n,) s
    poses: Array  # (n, 3) [x, y, yaw] in the map
    speed: Array | None  # (n,) m/s, if there is a CAN bus


def _motion(root: Path, tables: Path, scene: str, drive: _Drive) -> _Motion:
    path = root / "can_bus" / f"{scene}_pose.json"
    on_bus = path.exists()
    if on_bus:
        rows, (stamp, position, orientation) = read_json(path), ("utime", "pos", "orientation")
    else:
        path = tables / "ego_pose.json"
        rows = [r for r in _table(tables, "ego_pose", ("token",)) if r["token"] in drive.poses]
        stamp, position, orientation = "timestamp", "translation", "rotation"
    try:
        times = _stamps(path, [row[stamp] for row in rows])
        x, y = np.array([row[position][:2] for row in rows], dtype=np.float64).reshape(-1, 2).T
        yaw = _yaws([row[orientation] for row in rows])
        speed = np.array([row["vel"][0] if on_bus else 0.0 for row in rows], dtype=np.float64)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise ValueError(f"{path} holds no poses of the vehicle ({error!r})") from None
    columns = np.column_stack([x, y, yaw, speed])
    if not len(columns) or not np.isfinite(columns).all():
        wrong = "one is not finite" if len(columns) else "it is empty"
        raise ValueError(f"{path} holds no poses of the vehicle: {wrong}")
    times, first = np.unique(times, return_index=True)  # each sensor has a pose, some at one time
    columns = columns[first]
    return _Motion(times, columns[:, :3], columns[:, 3] if on_bus else None)


def _stamps(path: Path, microseconds: list[Any]) -> Array:
    """Times in s."""
    if not all(isinstance(stamp, int | float) for stamp in microseconds):
        raise ValueError(f"{path}: a time stamp is not a number")
    times = np.array(microseconds, dtype=np.float64) * MICROSECOND
    if not np.isfinite(times).all():
        raise ValueError(f"{path}: a time stamp is not finite")
    return times


def _yaws(quaternions: list[Any]) -> Array:
    """Directions (n,) of the x axis in the plane, of quaternions [w, x, y, z]."""
    w, x, y, z = np.array(quaternions, dtype=np.float64).reshape(-1, 4).T
    return np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)


def _valid(targets: dict[str, NDArray[Any]], strongest: int | None) -> dict[str, Array]:
    """The targets that are used; an empty scan holds one that is not a number."""
    columns = {name: column.astype(np.float64) for name, column in targets.items()}
    good = np.isin(columns["invalid_state"], _VALID) & (columns["ambig_state"] == _UNAMBIGUOUS)
    distance = np.hypot(columns["x"], columns["y"])
    good &= (distance > 0) & (distance <= MAX_RANGE)
    for name in _FIELDS:
        good &= np.isfinite(columns[name])
    keep = np.flatnonzero(good)
    keep = keep[strongest_targets(columns["rcs"][keep], strongest)]
    return {name: column[keep] for name, column in columns.items()}
