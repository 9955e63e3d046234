"""Reader of the RadarScenes data set (Schumann et al. 2021) in its official on-disk layout.

The data set is licensed CC BY-NC-SA 4.0 and is not part of this package.
"""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from d2d._checks import (
    check_count,
    check_instance,
    check_path,
    check_positive_scalar,
    check_scalar,
    check_seconds,
)
from d2d._types import Array
from d2d.radar.files import existing, read_json, strongest_targets
from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.scans.recording import LONGEST_OFFSET, Recording
from d2d.radar.scans.reference import Reference
from d2d.radar.scans.scan import MAX_RANGE, Mounting, RadarScan
from d2d.radar.scans.slip import SlipLaw

MICROSECOND = 1e-6
SLIP = SlipLaw(ahead=0.0, compliance=0.0045)

# Fitted to the errors of all four sensors together in sequence 105, by maximum likelihood.
RADARSCENES_BUDGET = ErrorBudget(
    azimuth=float(np.deg2rad(0.1)),
    doppler=0.04,
    scale=0.0013,
    lag=0.015,
    neighbours=1.0,
    source="RadarScenes, sequence 105, four sensors",
)

_TARGET_FIELDS = ("timestamp", "sensor_id", "range_sc", "azimuth_sc", "rcs", "vr")
_ODOMETRY_FIELDS = ("timestamp", "x_seq", "y_seq", "yaw_seq", "vx", "yaw_rate")


def azimuth_sigma(azimuth: Array) -> Array:
    """Standard deviation of the azimuth, rad: 0.3 deg up to 45 deg, then 0.5 rising to 1 deg at 60.

    It stands in for the standard deviations that the data set does not give, and fits the residuals
    of the data.
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
    sigma_range: float = 0.15,
    sigma_azimuth: float | Callable[[Array], Array] = azimuth_sigma,
    sigma_doppler: float = 0.06,
    extent: float = 0.1,
) -> Recording:
    """Read one sensor's scans of one sequence.

    Parameters
    ----------
    root : path
        The folder that contains ``data/sequence_<n>/{radar_data.h5,scenes.json}``, with
        ``sensors.json`` in ``data`` or beside it; a leading ``~`` is replaced by the home folder.
    sequence : int or str
        Number or name, such as 105 or "sequence_105".
    sensor : int
        Number of the sensor, 1 to 4.
    strongest : int, optional
        Keep only this many targets of each scan, those of largest radar cross-section.
    time_offset : float, s
        Delay of the radar's time stamps: a scan at t shows the motion that the odometry gives for
        t - time_offset.
    slip : SlipLaw
        The odometry has no lateral velocity; it is taken from this law.
    side_slip : float, s, optional
        In place of ``slip``: v_y = side_slip v_x omega.
    sigma_range, sigma_doppler : float, m and m/s
        Standard deviations, which the data set does not give.
    sigma_azimuth : float or function of the azimuths (K,), rad
        Standard deviation, or a function that returns those of the azimuths.

    extent : float, m
        Scatter of the points at which objects are seen; see `RadarScan`.

    Returns
    -------
    Recording
        With the budget `RADARSCENES_BUDGET`.  Times in s.  Targets are left out if their range is
        not positive or beyond 10 km, if their azimuth is beyond 2 pi, or if one of these or the
        Doppler velocity is nan or inf.

    Raises
    ------
    FileNotFoundError
        If a file or folder is missing; the message gives its path and what should be there.
    ValueError
        If a file is not a RadarScenes file or does not contain the sensor, the indices of a scan do
        not match the targets, or an argument is out of range.

    Notes
    -----
    `calibrate` finds, from four sensors in the two minutes of sequence 105, a lag of 0.121 +- 0.015
    s and, with the origin on the rear axle, a compliance of 0.0045 +- 0.0002 s^2/m.  If the place
    of the origin is fitted too, it is -0.10 +- 0.22 m ahead of the axle.
    """
    if strongest is not None:
        check_count("strongest", strongest)
    offset = check_seconds("time_offset", time_offset, LONGEST_OFFSET)
    check_instance("slip", slip, SlipLaw)
    linear = None if side_slip is None else check_scalar("side_slip", side_slip)
    for name, sigma in (("sigma_range", sigma_range), ("sigma_doppler", sigma_doppler)):
        check_positive_scalar(name, sigma)
    if not isinstance(sequence, int | np.integer | str):
        raise ValueError(
            f"sequence must be a number or a name like sequence_105, but is {sequence!r}"
        )
    check_count("sensor", sensor)
    data = existing(
        check_path("root", root), "data", "the folder `data` of the RadarScenes data set"
    )
    name = f"sequence_{sequence}" if str(sequence).isdigit() else str(sequence)
    folder = existing(data, name, "the folder of that sequence")
    mounting = _mounting(data, sensor)
    scenes = _scenes(existing(folder, "scenes.json", "the list of its scans"), sensor)
    path = existing(folder, "radar_data.h5", "its targets and odometry")
    targets, odometry = _tables(path)

    scans = []
    for microseconds, (first, last) in scenes:
        if not 0 <= first <= last <= len(targets["sensor_id"]):
            raise ValueError(
                f"{path}: the scan at {microseconds} us has the targets {first} to {last}, but the "
                f"file holds {len(targets['sensor_id'])} targets"
            )
        chosen = {field: column[first:last] for field, column in targets.items()}
        if (chosen["sensor_id"] != sensor).any():
            raise ValueError(
                f"{path}: the scan at {microseconds} us holds targets of another sensor than "
                f"{sensor}"
            )
        scans.append(
            _scan(
                microseconds * MICROSECOND,
                chosen,
                strongest,
                sigma_range,
                sigma_azimuth,
                sigma_doppler,
            ).with_extent(extent)
        )
    times = np.array([scan.time for scan in scans])
    reference = _reference(times, odometry, offset)
    v_x, omega = reference.theta[:, 0], reference.theta[:, 2]
    reference.theta[:, 1] = slip.lateral(v_x, omega) if linear is None else linear * v_x * omega
    return Recording(scans, mounting, reference, RADARSCENES_BUDGET)


def _mounting(data: Path, sensor: int) -> Mounting:
    """The mounting in sensors.json, which is in the data set's root or its folder ``data``."""
    places = [folder / "sensors.json" for folder in (data, data.parent)]
    found = [path for path in places if path.exists()]
    if not found:
        raise FileNotFoundError(
            f"neither {places[0]} nor {places[1]} exists; one should hold the sensors' mountings"
        )
    entry = read_json(found[0])
    key = f"radar_{sensor}"
    if not isinstance(entry, dict) or key not in entry:
        raise ValueError(f"sensor must be one of those in {found[0]}, but is {sensor}")
    try:
        return Mounting(*(entry[key][field] for field in ("x", "y", "yaw")))
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{found[0]}: {key} has no x, y and yaw ({error!r})") from None


def _scenes(path: Path, sensor: int) -> list[tuple[int, tuple[int, int]]]:
    """Time stamp in us and half-open target indices of the sensor's scans, in time order."""
    content = read_json(path)
    try:
        chosen = sorted(
            (int(stamp), (int(scene["radar_indices"][0]), int(scene["radar_indices"][1])))
            for stamp, scene in content["scenes"].items()
            if scene["sensor_id"] == sensor
        )
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError) as error:
        raise ValueError(f"{path} is not a RadarScenes scene list ({error!r})") from None
    if not chosen:
        raise ValueError(f"{path} has no scan of sensor {sensor}")
    return chosen


Table = dict[str, NDArray[Any]]


def _tables(path: Path) -> tuple[Table, Table]:
    """The required columns of both tables, by name, because their order differs between files."""
    try:
        with h5py.File(path, "r") as file:
            targets = _table(file, "radar_data", _TARGET_FIELDS)
            odometry = _table(file, "odometry", _ODOMETRY_FIELDS)
    except (OSError, ValueError, TypeError, AttributeError, RuntimeError, KeyError) as error:
        raise ValueError(f"{path} is not a RadarScenes radar file: {error}") from None
    for field, column in odometry.items():
        if not np.isfinite(column).all():  # np.unwrap would carry a nan on to all later headings
            raise ValueError(
                f"{path} is not a RadarScenes radar file: its odometry's {field!r} holds nan or inf"
            )
    stamps = odometry["timestamp"]  # compared, not subtracted: unsigned differences wrap around
    if not (stamps[1:] > stamps[:-1]).all() or not len(stamps):
        raise ValueError(
            f"{path} is not a RadarScenes radar file: its odometry is not in time order"
        )
    return targets, odometry


def _table(file: h5py.File, name: str, fields: tuple[str, ...]) -> Table:
    if name not in file:
        raise ValueError(f"it has no table {name!r}")
    rows = np.atleast_1d(file[name][()])
    missing = [field for field in fields if field not in (rows.dtype.names or ())]
    if missing:
        raise ValueError(f"the table {name!r} has no column {missing[0]!r}")
    table = {field: np.ascontiguousarray(rows[field]) for field in fields}
    text = [f for f, column in table.items() if column.dtype.kind not in "iuf" or column.ndim != 1]
    if text:
        raise ValueError(f"the column {text[0]!r} of the table {name!r} is not a column of numbers")
    return table


def _scan(
    time: float,
    targets: Table,
    strongest: int | None,
    sigma_range: float,
    sigma_azimuth: float | Callable[[Array], Array],
    sigma_doppler: float,
) -> RadarScan:
    with np.errstate(invalid="ignore"):  # a signalling nan is left out like any other
        distance, azimuth, doppler = (
            targets[field].astype(np.float64) for field in ("range_sc", "azimuth_sc", "vr")
        )
    good = (distance > 0) & (distance <= MAX_RANGE) & np.isfinite(doppler)
    good &= np.abs(azimuth) <= 2.0 * np.pi  # not so if it is nan
    keep = np.flatnonzero(good)
    keep = keep[strongest_targets(targets["rcs"][keep], strongest)]
    azimuth = azimuth[keep]
    sigma = sigma_azimuth(azimuth) if callable(sigma_azimuth) else sigma_azimuth
    return RadarScan(
        time, distance[keep], azimuth, doppler[keep], sigma_range, sigma, sigma_doppler
    )


def _reference(times: Array, odometry: Table, offset: float) -> Reference:
    """The odometry at the times of the scans less the offset, with a lateral velocity of zero."""
    stamps = odometry["timestamp"] * MICROSECOND
    columns = {
        field: odometry[field].astype(np.float64)
        for field in _ODOMETRY_FIELDS
        if field != "timestamp"
    }
    columns["yaw_seq"] = np.unwrap(columns["yaw_seq"])
    x, y, yaw, vx, yaw_rate = (
        np.interp(times - offset, stamps, columns[field], left=np.nan, right=np.nan)
        for field in ("x_seq", "y_seq", "yaw_seq", "vx", "yaw_rate")
    )
    theta = np.column_stack([vx, np.zeros_like(vx), yaw_rate])
    return Reference(times, theta, np.column_stack([x, y, yaw]))
