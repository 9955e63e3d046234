"""Reader of the RadarScenes data set (Schumann et al. 2021; CC BY-NC-SA 4.0) in its own layout."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from d2d._checks import check_count, check_path
from d2d._types import Array
from d2d.radar.files import reading
from d2d.radar.readers import shared
from d2d.radar.readers.reader import data_set
from d2d.radar.readers.shared import MICROSECOND, existing, whole_number
from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.scans.reference import Recording, Reference, SlipLaw
from d2d.radar.scans.scan import BOUNDS, MEASURED, Mounting, RadarScan

SLIP = SlipLaw(ahead=0.0, compliance=0.0045)

_COMPRESSION = 100  # times the size of a file that its tables may have; the original's have 3
# Fitted to the errors of all four sensors together in sequence 105, by maximum likelihood, which
# cannot tell azimuth (0.10 deg) and Doppler (0.040 m/s) apart; sensor 3 alone has 0.2 deg.
# With 0.16 deg/s of the yaw rate itself, displacements on 105 and 108 have the best log score.
RADARSCENES_BUDGET = ErrorBudget(
    azimuth=float(np.deg2rad(0.20)),
    doppler=0.035,
    scale=0.0013,
    lag=0.015,
    omega=float(np.deg2rad(0.16)),
    sway=float(np.deg2rad(0.1)),
    neighbours=1.0,
    source="RadarScenes, sequence 105, four sensors and one alone; paths of 105 and 108",
)

Table = dict[str, NDArray[Any]]

_TARGET_FIELDS = ("timestamp", "sensor_id", "range_sc", "azimuth_sc", "rcs", "vr")
_ODOMETRY_FIELDS = ("timestamp", "x_seq", "y_seq", "yaw_seq", "vx", "yaw_rate")


def azimuth_sigma(azimuth: Array) -> Array:
    """Standard deviation of the azimuth, rad: 0.3 deg up to 45 deg, then 0.5 rising to 1 deg at 60.

    The data set gives none; it fits the residuals.
    """
    off = np.abs(np.rad2deg(azimuth))
    return np.deg2rad(np.where(off <= 45.0, 0.3, np.interp(off, [45.0, 60.0], [0.5, 1.0])))


def load_radarscenes(
    root: str | os.PathLike[str],
    sequence: int | str,
    sensor: int,
    *,
    strongest: int | None = None,
    time_offset: float = 0.11,
    slip: SlipLaw = SLIP,
    side_slip: float | None = None,
    **errors: Any,
) -> Recording:
    """Read one sensor's scans of one sequence, with the budget `RADARSCENES_BUDGET`.

    The defaults are explained under "What the readers of data sets correct".
    Raises a ``FileNotFoundError`` that says which file or folder is missing, or a ``ValueError`` if
    a file is not one of RadarScenes, has no such sensor, or an option is out of range.

    Parameters
    ----------
    root : path
        The folder that holds the folder ``data``.
    sequence, sensor : int or str, int
        Number or name, such as 105 or "sequence_105", and 1 to 4.
    strongest : int, optional
        Keep only this many targets of each scan, those of largest radar cross-section.
    time_offset : float, s
        Delay of the radar's time stamps: a scan at t shows the motion at t − time_offset.
    slip : SlipLaw
        Of the lateral velocity, which the odometry has not.
    side_slip : float, s, optional
        In place of ``slip``: v_y = side_slip v_x omega.
    **errors
        ``sigma_range``, ``sigma_azimuth``, ``sigma_doppler`` and ``extent`` of `RadarScan`, numbers
        or functions of the azimuths (K,), instead of 0.15 m, `azimuth_sigma`, 0.06 m/s and 0.1 m.
    """
    shared.OFFSET.number("time_offset", time_offset)
    errors = {"sigma_azimuth": azimuth_sigma} | errors
    check_count("sensor", sensor)
    what = "the folder `data` of the RadarScenes data set"
    data = existing(check_path("root", root), "data", what)
    name = f"sequence_{sequence}" if str(sequence).isdigit() else str(sequence)
    folder = existing(data, name, "the folder of that sequence")
    mounting = _mounting(data, sensor)
    listed = _listed(existing(folder, "scenes.json", "the list of its scans"), sensor)
    path = existing(folder, "radar_data.h5", "its targets and odometry")
    targets, odometry = _tables(path)

    scans = [_scan(path, entry, targets, sensor, strongest, errors) for entry in listed]
    times = np.array([scan.time for scan in scans])
    x, y, yaw, v_x, omega = (odometry[field].astype(np.float64) for field in _ODOMETRY_FIELDS[1:])
    theta, poses = np.column_stack([v_x, 0.0 * v_x, omega]), np.column_stack([x, y, yaw])
    driven = Reference(odometry["timestamp"] * MICROSECOND, theta, poses).at(times - time_offset)
    v_x, _, omega = driven.theta.T
    v_y = slip.lateral(v_x, omega) if side_slip is None else side_slip * v_x * omega
    reference = Reference(times, np.column_stack([v_x, v_y, omega]), driven.poses)
    return Recording(scans, mounting, reference, RADARSCENES_BUDGET)


def _mounting(data: Path, sensor: int) -> Mounting:
    path, key = existing(data, "sensors.json", "the list of mountings"), f"radar_{sensor}"
    with reading(path, f"a list of mountings with x, y and yaw of {key}"):
        mountings = shared.content_of(path)
        if key not in mountings:
            raise ValueError(f"it has only {', '.join(mountings)}")
        entry = mountings[key]
        return Mounting(entry["x"], entry["y"], entry["yaw"])


def _listed(path: Path, sensor: int) -> list[tuple[int, int, int]]:
    """Time stamp in us and half-open target indices of the sensor's scans, in time order."""
    with reading(path, "a RadarScenes scene list"):
        listed = sorted(
            (whole_number("a time stamp", json.loads(stamp)), first, last)
            for stamp, scene in shared.content_of(path)["scenes"].items()
            if whole_number("sensor_id", scene["sensor_id"]) == sensor
            for first, last in [(whole_number("radar_indices", i) for i in scene["radar_indices"])]
        )
    if not listed:
        raise ValueError(f"{path} has no scan of sensor {sensor}")
    return listed


def _tables(path: Path) -> tuple[Table, Table]:
    """The required columns of both tables, by name, because their order differs between files."""
    try:
        import h5py
    except ModuleNotFoundError:
        raise ModuleNotFoundError(
            "RadarScenes needs h5py: pip install 'd2d[radarscenes]'"
        ) from None
    with reading(path, "a RadarScenes radar file"), h5py.File(path, "r") as file:
        targets = _table(file, "radar_data", _TARGET_FIELDS)
        odometry = _table(file, "odometry", _ODOMETRY_FIELDS)
        for field, column in odometry.items():
            if not np.isfinite(column).all():  # np.unwrap would carry a nan on to later headings
                raise ValueError(f"its odometry's {field!r} holds nan or inf")
        stamps = odometry["timestamp"]  # compared, not subtracted: unsigned differences wrap around
        if not (stamps[1:] > stamps[:-1]).all() or not len(stamps):
            raise ValueError("its odometry is not in time order")
    return targets, odometry


def _table(file: Any, name: str, fields: tuple[str, ...]) -> Table:
    outside = hasattr(file.get(name, getlink=True), "filename")  # of an external link
    if not outside and name not in file:
        raise ValueError(f"it has no table {name!r}")
    if outside or file[name].is_virtual or file[name].external:
        raise ValueError(f"the table {name!r} must be in the file, not in another one")
    dataset = file[name]
    if dataset.nbytes > _COMPRESSION * os.path.getsize(file.filename):
        raise ValueError(f"the table {name!r} claims {dataset.nbytes} bytes, too many for its file")
    rows = dataset[:]
    missing = [field for field in fields if field not in (rows.dtype.names or ())]
    if missing:
        raise ValueError(f"the table {name!r} has no column {missing[0]!r}")
    table = {field: np.ascontiguousarray(rows[field]) for field in fields}
    for field, column in table.items():
        if column.dtype.kind not in "iuf" or column.ndim != 1:
            raise ValueError(f"the column {field!r} of the table {name!r} does not hold numbers")
    return table


def _scan(
    path: Path,
    listed: tuple[int, int, int],
    targets: Table,
    sensor: int,
    strongest: int | None,
    errors: Mapping[str, Any],
) -> RadarScan:
    stamp, first, last = listed
    where, count = f"{path}: the scan at {stamp} us", len(targets["sensor_id"])
    if not 0 <= first <= last <= count:
        raise ValueError(f"{where} has the targets {first} to {last}, but the file holds {count}")
    rows = {field: column[first:last] for field, column in targets.items()}
    if (rows["sensor_id"] != sensor).any():
        raise ValueError(f"{where} holds targets of another sensor than {sensor}")
    with np.errstate(invalid="ignore"):  # a signalling nan is left out like any other
        columns = [rows[name].astype(np.float64) for name in ("range_sc", "azimuth_sc", "vr")]
    good = np.all([BOUNDS[name].hold(c) for name, c in zip(MEASURED, columns, strict=True)], axis=0)
    keep = shared.strongest_of(good, rows["rcs"], strongest)
    distance, azimuth, doppler = (column[keep] for column in columns)
    sigmas = shared.errors_at(azimuth, errors)
    return RadarScan(stamp * MICROSECOND, distance, azimuth, doppler, **sigmas)


READER = data_set("RadarScenes", load_radarscenes, "sequence", "sensor")
