"""Reader of the radars of nuScenes (Caesar et al. 2020; CC BY-NC-SA 4.0) in its own layout."""

import os
import re
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from d2d._checks import SECONDS, check_path, check_positive_scalar
from d2d._types import Array
from d2d.radar.files import brief, reading
from d2d.radar.readers import shared
from d2d.radar.readers.reader import data_set
from d2d.radar.readers.shared import MICROSECOND, existing, yaw_of
from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.scans.reference import Recording, Reference
from d2d.radar.scans.scan import BOUNDS, Mounting, RadarScan

GRID = 0.2  # m, to which x and y are rounded
STEP = 0.25  # m/s, to which vx and vy are rounded

# What the data sheet of the ARS 408 calls valid, and the state "no ambiguity of the velocity".
_VALID = (0, 4, 8, 9, 10, 11, 12, 15, 16, 17)
_UNAMBIGUOUS = 3
_FIELDS = ("x", "y", "vx", "vy", "rcs", "invalid_state", "ambig_state")
# The end of a PCD file's header, which has lines "KEY value ..."; the rows follow.
_END = re.compile(rb"^DATA[ \t]+(\w+)[ \t]*\r?\n", re.MULTILINE)
# How many numbers an entry of a table has.
_NUMBERS = {"translation": 3, "rotation": 4, "pos": 3, "orientation": 4, "vel": 3}

# Fitted to the errors of all five radars in scenes 0061 and 0103, by maximum likelihood, baseline
# 2, and then widened by 1.6: two scenes are two draws of what differs from scene to scene.
NUSCENES_BUDGET = ErrorBudget(
    azimuth=float(np.deg2rad(0.55)),
    doppler=0.055,
    scale=0.0026,
    lag=0.03,
    sway=float(np.deg2rad(0.1)),
    neighbours=1.0,
    source="nuScenes, five radars, fitted to scenes 0061 and 0103, then widened",
)

# The speed on the CAN bus is that much later than the poses there (fitted as below).
_SPEED_DELAY = 0.1  # s
_PREDICTION = SECONDS._replace(most=1.0)  # s; the radar's cycle is 75 ms
_WHEELBASE = 2.588  # m, of the Renault Zoe

# What is to be added to the mounting angles (deg), by channel and by the angle that the tables
# state: one vehicle has them from scene 0061, the other from scene 0103
# (d2d.study.road.extrapolation).
MOUNTING_ERRORS: dict[str, dict[float, float]] = {
    "RADAR_FRONT": {0.2: -0.74, -0.26: 0.24},
    "RADAR_FRONT_LEFT": {88.36: 0.99, 90.68: -0.02},
    "RADAR_FRONT_RIGHT": {-90.98: 1.11, -89.74: -0.21},
    "RADAR_BACK_LEFT": {174.41: 0.51, 174.74: 0.07},
    "RADAR_BACK_RIGHT": {-176.11: 0.24, -175.0: -0.08},
}


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
    version: str = "v1.0-*",
    strongest: int | None = None,
    time_offset: float = -0.03,
    speed_factor: float | None = 1.0125,
    prediction_time: float = 0.037,
    stated_mounting: bool = False,
    **errors: Any,
) -> Recording:
    """Read one radar's scans of one scene, such as "scene-0061" and "RADAR_FRONT".

    The recording has the budget `NUSCENES_BUDGET`, and its origin is the middle of the rear axle.
    Targets are kept if the radar calls them valid and their velocity unambiguous; the velocity is
    projected onto the line of sight.  The reference's v_y and omega are the derivatives of the
    poses on the CAN bus, or else of those in ``ego_pose.json``.  The defaults are explained under
    "What the readers of data sets correct".  Raises the errors of `load_radarscenes`.

    Parameters
    ----------
    root : path
        The folder of ``v1.0-*/`` with the tables, ``samples/``, ``sweeps/``, perhaps ``can_bus/``.
    version : str
        Name of the folder with the tables, needed only if there are several.
    time_offset : float, s
        Delay of the radar's time stamps: a scan at t shows the motion at t − time_offset.
    speed_factor : float or None
        On the speed of the CAN bus.  With None, or without a CAN bus, v_x is the derivative of the
        poses too.
    prediction_time : float, s
        In a turn, ω² r times this is taken from the Doppler velocities.
    stated_mounting : bool
        Whether the mounting angle is the one that the tables state, without `MOUNTING_ERRORS`.
    strongest, **errors
        As for `load_radarscenes`.  The rounding of positions and velocities is added.
    """
    shared.OFFSET.number("time_offset", time_offset)
    errors = {"sigma_azimuth": azimuth_sigma} | errors
    _PREDICTION.number("prediction_time", prediction_time)
    if speed_factor is not None:
        check_positive_scalar("speed_factor", speed_factor)
    folder = check_path("root", root)
    tables = _tables(folder, version)
    files, mounting, tokens = _drive(tables, scene, channel)
    times = np.array([time for time, _ in files])
    moved = _reference(folder, tables, scene, tokens, times - time_offset, speed_factor)
    reference = Reference(times, moved.theta, moved.poses)
    turns = reference.theta[:, 2]
    known = np.isfinite(turns)
    turns = np.interp(times, times[known], turns[known]) if known.any() else 0.0 * times
    scans = []
    for (time, file), excess in zip(files, prediction_time * turns**2, strict=True):
        path = existing(folder, file, f"a scan of {channel}")
        scans.append(_scan(time, _point_cloud(path), excess, strongest, errors))
    mounting = mounting if stated_mounting else _corrected(mounting, channel)
    return Recording(scans, mounting, reference, NUSCENES_BUDGET)


def _scan(
    time: float,
    columns: dict[str, Array],
    excess: float,
    strongest: int | None,
    errors: Mapping[str, Any],
) -> RadarScan:
    """The scan of valid targets, whose velocities are too large by ``excess`` times the range."""
    good = np.isin(columns["invalid_state"], _VALID) & (columns["ambig_state"] == _UNAMBIGUOUS)
    good &= BOUNDS["range"].hold(np.hypot(columns["x"], columns["y"]))
    good &= np.isfinite([columns[name] for name in ("vx", "vy", "rcs")]).all(axis=0)
    keep = shared.strongest_of(good, columns["rcs"], strongest)
    x, y, vx, vy = (columns[name][keep] for name in ("x", "y", "vx", "vy"))
    doppler = (x * (vx - excess * x) + y * (vy - excess * y)) / np.hypot(x, y)
    sigmas = shared.errors_at(np.arctan2(y, x), errors)
    return RadarScan.from_cartesian(time, x, y, doppler=doppler, grid=GRID, step=STEP, **sigmas)


def _point_cloud(path: Path) -> dict[str, Array]:
    """Columns of a binary file in the PCD format of the Point Cloud Library, by name."""
    with reading(path, "a binary PCD file of a radar"):
        content = shared.bytes_of(path)
        end = _END.search(content)
        if end is None:
            raise ValueError("its header has no line DATA")
        if end[1] != b"binary":
            raise ValueError(f"its data are {end[1].decode()}, and only binary is read")
        lines = map(str.split, content[: end.start()].decode("ascii").splitlines())
        header = {key: values for key, *values in filter(None, lines)}
        if any(count != "1" for count in header.get("COUNT", [])):
            raise ValueError("it has a field of several values")
        columns = zip(header["FIELDS"], header["TYPE"], header["SIZE"], strict=True)
        layout = np.dtype([(name, f"<{kind.lower()}{size}") for name, kind, size in columns])
        count, held = int(header["POINTS"][0]), len(content) - end.end()
        if not 0 <= count * layout.itemsize <= held:
            raise ValueError(
                f"its header announces {count} points of {layout.itemsize} bytes, but {held} bytes "
                "follow"
            )
        rows = np.frombuffer(content, layout, count, end.end())
        missing = [field for field in _FIELDS if field not in header["FIELDS"]]
        if missing:
            raise ValueError(f"it has no field {missing[0]!r}")
        return {field: rows[field].astype(np.float64) for field in _FIELDS}


# ---- The vehicle's motion


def _reference(
    root: Path, tables: Path, scene: str, tokens: set[str], times: Array, factor: float | None
) -> Reference:
    """The derivatives of the poses at some times, and v_x of the speed on the CAN bus."""
    path = root / "can_bus" / f"{scene}_pose.json"
    on_bus = path.exists()
    keys = ["utime", "pos", "orientation", "vel"]
    if not on_bus:
        path = existing(tables, "ego_pose.json", "the table 'ego_pose' of nuScenes")
        keys = ["timestamp", "translation", "rotation"]
    with reading(path, "a file of the vehicle's poses"):
        rows = [row for row in shared.content_of(path) if on_bus or row["token"] in tokens]
        if not rows:
            raise ValueError("it has none of this scene")
        columns = zip(*([_value(key, row[key]) for key in keys] for row in rows), strict=True)
        stamps, place, turn, *speed = map(np.array, columns)
        stamps, first = np.unique(stamps * MICROSECOND, return_index=True)  # some at one time
        poses = np.column_stack([place[first, :2], yaw_of(*turn[first].T)])
    moved = Reference.from_poses(stamps, poses, times)
    if factor is not None and on_bus:
        late, along = times + _SPEED_DELAY, speed[0][first, 0]
        front = factor * np.interp(late, stamps, along, left=np.nan, right=np.nan)
        square = front**2 - (_WHEELBASE * moved.theta[:, 2]) ** 2
        forward = np.sign(front) * np.sqrt(np.maximum(square, 0.0))
        return Reference(times, np.column_stack([forward, moved.theta[:, 1:]]), moved.poses)
    return moved


# ---- The tables


def _tables(root: Path, version: str) -> Path:
    found = sorted(path for path in root.glob(version) if path.is_dir())
    if not found:
        raise FileNotFoundError(
            f"{root / version} does not exist; it should be the folder of the tables of nuScenes"
        )
    if len(found) > 1:
        names = ", ".join(path.name for path in found)
        raise ValueError(f"version must be given, because there are several: {names}")
    return found[0]


def _rows(folder: Path, name: str, *keys: str) -> list[tuple[Any, ...]]:
    path = existing(folder, f"{name}.json", f"the table {name!r} of nuScenes")
    return _parsed(path, keys, os.stat(path).st_mtime_ns)


# All scenes and radars of a root share its tables, whose reading takes longer than all else.
@lru_cache(maxsize=5)
def _parsed(path: Path, keys: tuple[str, ...], _changed: int) -> list[tuple[Any, ...]]:
    with reading(path, "a table of nuScenes"):
        return [tuple(_value(key, row[key]) for key in keys) for row in shared.content_of(path)]


def _value(key: str, value: Any) -> Any:
    """An entry of a table: a text, a time in us, or numbers."""
    if key in _NUMBERS:
        return shared.real_numbers(key, value, _NUMBERS[key])
    if key in ("timestamp", "utime"):
        return shared.whole_number(key, value)
    if not isinstance(value, str):
        raise ValueError(f"{key} must be a text, but is {brief(repr(value))}")
    return value


def _drive(
    folder: Path, scene: str, channel: str
) -> tuple[list[tuple[float, str]], Mounting, set[str]]:
    """Times and files of one radar in one scene, its mounting, and the tokens of all ego poses."""
    scene_token = _chosen("scene", scene, dict(_rows(folder, "scene", "name", "token")))
    sensors = _rows(folder, "sensor", "channel", "token", "modality")
    radars = {name: token for name, token, modality in sensors if modality == "radar"}
    radar = _chosen("channel", channel, radars)
    of_sensors = "token", "sensor_token", "translation", "rotation"
    calibrated = _rows(folder, "calibrated_sensor", *of_sensors)
    mountings = {token: pose for token, sensor, *pose in calibrated if sensor == radar}
    all_samples = _rows(folder, "sample", "token", "scene_token")
    samples = {token for token, of_scene in all_samples if of_scene == scene_token}
    keys = "sample_token", "calibrated_sensor_token", "ego_pose_token", "timestamp", "filename"
    data = [row for row in _rows(folder, "sample_data", *keys) if row[0] in samples]
    own = [row for row in data if row[1] in mountings]
    used = {row[1] for row in own}
    if len(used) != 1:
        found = f"{len(used)} mountings" if used else "no scan"
        raise ValueError(f"{folder / 'sample_data.json'} has {found} of {channel} in {scene}")
    files = sorted((time * MICROSECOND, name) for *_, time, name in own)
    if len({time for time, _ in files}) < len(files):
        raise ValueError(f"{folder / 'sample_data.json'} has two scans with the same time stamp")
    with reading(folder / "calibrated_sensor.json", "a table of nuScenes"):
        (x, y, _), rotation = mountings[used.pop()]
        mounting = Mounting(x, y, float(yaw_of(*rotation)))
    return files, mounting, {row[2] for row in data}


def _chosen(name: str, value: str, choices: dict[str, str]) -> str:
    if value not in choices:
        known = brief(", ".join(sorted(choices)))
        raise ValueError(f"{name} must be one of {known}, but is {brief(repr(value))}")
    return choices[value]


def _corrected(mounting: Mounting, channel: str) -> Mounting:
    """The mounting with the error of its angle removed, if the error is known."""
    stated = float(np.rad2deg(mounting.yaw))
    for angle, error in MOUNTING_ERRORS.get(channel, {}).items():
        if abs(stated - angle) < 0.01:
            return replace(mounting, yaw=mounting.yaw + float(np.deg2rad(error)))
    return mounting


READER = data_set("nuScenes", load_nuscenes, "scene", "channel")
