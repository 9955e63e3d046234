"""Logs of radar targets as tables: one line for each target."""

import csv
import io
import itertools
import math
import os
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from d2d._checks import (
    FINITE,
    NOT_NEGATIVE,
    Bounds,
    check_choice,
    check_path,
    check_positive_scalar,
)
from d2d._types import Array
from d2d.radar.files import atomic_write
from d2d.radar.readers.reader import LOG_OPTIONS, Option, Reader, Source, mountings_of, options_of
from d2d.radar.readers.shared import brief
from d2d.radar.readers.table import (
    QUANTITIES,
    TARGET,
    Column,
    Table,
    read_table,
    scan_of,
    usual_sigmas,
)
from d2d.radar.scans.scan import ANGLES, BOUNDS, MEASURED, SIGMAS, UPWARDS, RadarScan

Mask = NDArray[np.bool_]
Rows = NDArray[np.intp]

_RADIANS = BOUNDS["azimuth"]._replace(
    hint="; are these degrees (degrees=True, on the command line --degrees)?"
)
_DEGREES = Bounds(most=360.0, unit="in degrees, ")
_STEP_BACK = 1.0  # s
_POLAR, _CARTESIAN = ("range", "azimuth"), ("x", "y")
_LOG_QUANTITIES = ("time", *TARGET, "sensor", "frame")


def load_csv(
    path: str | os.PathLike[str],
    *,
    columns: Mapping[str, str] | None = None,
    time_unit: str | None = None,
    degrees: bool = False,
    scan_gap: float = 0.0,
    skip_invalid: bool = False,
    min_snr: float | None = None,
    sigma_range: float | None = None,
    sigma_azimuth: float | None = None,
    sigma_doppler: float | None = None,
) -> dict[str, list[RadarScan]]:
    """Read the scans of one or several sensors from a table with a line for each target.

    Returns a dict with the scans of each sensor by its name.  Lines with equal time and sensor form
    a scan; so do lines that are at most ``scan_gap`` (s) apart, at the median of their times, or
    neighbouring lines with the same value in a column ``frame``.  Where the time steps back by more
    than a second, a new segment begins, and none of its scans is merged with one before.  A scan
    without targets has no line.

    The first line names the columns, in any order: ``time`` (s), ``range`` (m), ``azimuth`` (rad,
    counter-clockwise from the boresight), ``doppler`` (m/s, positive for receding targets) and, if
    the radar measures it, ``elevation`` (rad, upwards); or positions ``x``, ``y`` and ``z`` (m)
    instead of range and angles.  Then the standard deviations ``sigma_range``, ``sigma_azimuth``,
    ``sigma_doppler`` and ``sigma_elevation``, and ``sensor``, a name or number; without it, there
    is one sensor called "radar".  Other usual names, and a unit at the end of a name (``time_ns``,
    ``azimuth_deg``, ``doppler_kmh``), are recognised, other columns ignored.  Times may be dates in
    ISO 8601.  The file is text as `d2d.radar.readers.table` says, perhaps compressed by gzip, or
    Parquet.  Raises a ``ValueError`` if a column is missing, and one with its number if a line is
    wrong.

    Parameters
    ----------
    path : path
    columns : mapping of str to str, optional
        The names of columns by what they hold, with a minus sign if the sign is the other:
        ``{"azimuth": "-track_angle_rad"}``.
    time_unit : "s", "ms", "us" or "ns", optional
        Of a column whose name does not say it; by default s.
    degrees : bool
        Whether angles are in degrees, where a column's name does not say it.
    scan_gap : float, s
    skip_invalid : bool
        Whether lines are left out, with a warning that counts them, if a number is missing, nan or
        infinite, a range is not positive, or words are missing.
    min_snr : float, optional
        Targets with a smaller value in the column ``snr`` are left out.
    sigma_range, sigma_azimuth, sigma_doppler : float, m, rad, m/s
        Of all targets, instead of the columns.  Where there is none, usual values are taken, with a
        warning.
    """
    source = check_path("path", path)
    sigmas = {
        name: check_positive_scalar(name, sigma)
        for name, sigma in zip(SIGMAS, (sigma_range, sigma_azimuth, sigma_doppler), strict=True)
        if sigma is not None
    }
    gap = NOT_NEGATIVE.number("scan_gap", scan_gap)
    named = dict(columns or {})
    for name in named:
        check_choice("columns", name, _LOG_QUANTITIES)
    table = read_table(source, lambda table: _lacking(table, named), torn=skip_invalid)
    found = _columns(table, named, sigmas, time_unit, degrees)
    sigmas |= usual_sigmas(source, found.keys() | sigmas.keys())
    if min_snr is None:
        found.pop("snr", None)
    elif "snr" not in found:
        raise ValueError(f"{source} has no column snr, which min_snr needs")
    texts = {
        name: table.words[found.pop(name).place] for name in ("sensor", "frame") if name in found
    }
    values = {name: table.numbers(name, c, invalid=skip_invalid) for name, c in found.items()}
    used = _valid(table, values, skip_invalid)
    _check(table, found, values, used)
    if min_snr is not None:
        used = used & (values["snr"] >= FINITE.number("min_snr", min_snr))
    rows = np.flatnonzero(used)
    if not len(rows):
        raise ValueError(f"{source} has no line with a target")
    values |= {name: np.full(len(used), sigma) for name, sigma in sigmas.items()}
    scans: dict[str, list[RadarScan]] = {}
    for sensor, own in _by_sensor(table, texts.get("sensor"), rows).items():
        frames = None if "frame" not in texts else np.array(texts["frame"])[own]
        times = values["time"][own]
        scans[sensor] = [
            scan_of(
                float(np.median(times[group])),
                {name: column[own[group]] for name, column in values.items()},
            )
            for group in _groups(source, times, frames, gap)
        ]
    return scans


def _lacking(table: Table, named: Mapping[str, str]) -> str:
    """The columns that a first line lacks, as the user knows them."""
    has = {name for name in _LOG_QUANTITIES if table.column(name, named)}
    place = _CARTESIAN if has.issuperset(_CARTESIAN) and not has.issuperset(_POLAR) else _POLAR
    needed = ("time", *place, "doppler")
    if has.issuperset((*needed, *named)):
        return ""
    return ", ".join(named.get(name, name) for name in dict.fromkeys((*needed, *named)))


def _columns(
    table: Table,
    named: Mapping[str, str],
    sigmas: Mapping[str, float],
    time_unit: str | None,
    degrees: bool,
) -> dict[str, Column]:
    """The columns that are read, with factors to s, m, rad and m/s."""
    found = {name: table.column(name, named) for name in _LOG_QUANTITIES if name not in sigmas}
    columns = {name: column for name, column in found.items() if column is not None}
    if columns.keys() >= {*_POLAR}:
        columns = {name: c for name, c in columns.items() if name not in _CARTESIAN}
    stated = dict.fromkeys(ANGLES, "deg") if degrees else {}
    if time_unit is not None:
        check_choice("time_unit", time_unit, ("s", "ms", "us", "ns"))
        stated["time"] = time_unit
    for name in stated.keys() & columns.keys():
        place, factor, unit = columns[name]
        if unit not in ("", stated[name]):
            raise ValueError(
                f"{table.source}: {table.names[place]} is in {unit}, but is said to be in "
                f"{stated[name]}"
            )
        factor = math.copysign(QUANTITIES[name].units[stated[name]], factor)
        columns[name] = Column(place, factor, stated[name])
    return columns


def _valid(table: Table, values: Mapping[str, Array], skip: bool) -> Mask:
    """Mask of the lines that are used; those that are not are counted in a warning."""
    used = np.ones(len(table.lines), dtype=np.bool_)
    if not skip:
        return used
    for name, column in values.items():
        used &= np.isfinite(column) & (column > 0.0 if name == "range" else True)
    left_out = int((~used).sum()) + table.torn
    if left_out:
        warnings.warn(
            f"{table.source}: {left_out} of {len(used) + table.torn} lines are left out, because a "
            "number is missing or not finite, or the range is not positive",
            stacklevel=3,
        )
    return used


def _check(
    table: Table, columns: Mapping[str, Column], values: Mapping[str, Array], used: Mask
) -> None:
    """Raise a ValueError that names the first line with a number that is out of bounds."""
    wrong = {
        int(np.flatnonzero(bad)[0]): name
        for name, column in values.items()
        if (bad := ~BOUNDS.get(name, FINITE).hold(column) & used).any()
    }
    if not wrong:
        return
    row, name = min(wrong.items())
    said, value = f"{table.where(row)}: {name}", values[name][row]
    if name in ANGLES and columns[name].unit == "deg":
        _DEGREES.number(said, float(np.rad2deg(value)))
    elif name in ANGLES:
        _RADIANS.number(said, value)
    BOUNDS.get(name, FINITE).number(said, value)


def _by_sensor(table: Table, names: Any, rows: Rows) -> dict[str, Rows]:
    """The rows of each sensor, by its name."""
    if names is None:
        return {"radar": rows}
    found: dict[str, list[int]] = {}
    for row in rows.tolist():
        name = names[row].strip()
        if not name:
            raise ValueError(f"{table.where(row)}: sensor must be a name or a number, but is empty")
        found.setdefault(name, []).append(row)
    return {name: np.array(own) for name, own in found.items()}


def _groups(source: Path, times: Array, frames: Any, gap: float) -> list[Rows]:
    """The indices of each scan's targets, in time order within each segment of the clock."""
    segment = np.cumsum(np.diff(times, prepend=times[0]) < -_STEP_BACK)
    if segment[-1]:
        warnings.warn(
            f"{source}: the time steps back {segment[-1]} time(s); a new segment begins there (if "
            "this is one drive, sort its lines by time)",
            stacklevel=3,
        )
    order = np.arange(len(times)) if frames is not None else np.lexsort((times, segment))
    begins = np.diff(segment[order]) > 0
    begins |= frames[1:] != frames[:-1] if frames is not None else np.diff(times[order]) > gap
    groups = np.split(order, 1 + np.flatnonzero(begins))
    if frames is None:
        return groups
    return sorted(groups, key=lambda group: (segment[group[0]], np.median(times[group])))


def write_csv(path: str | os.PathLike[str], sensors: Mapping[str, Iterable[RadarScan]]) -> None:
    """Write the scans of sensors, by their names, as a CSV file that `load_csv` reads, bit by bit.

    All columns are written, in m, rad and m/s, line by line in time order; elevations only if there
    are any.  The extent is not, and a scan without targets leaves no line.  An existing file is
    replaced once all is written; a leading ``~`` stands for the home folder.  Raises a
    ``ValueError`` if a name is empty or begins or ends with a space, or two scans of a sensor have
    the same time.
    """
    for name in sensors:
        if not name or name != name.strip() or not name.isprintable():
            raise ValueError(f"sensors must be keyed by names, but hold {name!r}")
    scans = [(scan.time, name, scan) for name, own in sensors.items() for scan in own]
    scans.sort(key=lambda entry: entry[:2])
    for (time, name, _), later in itertools.pairwise(scans):
        if (time, name) == later[:2]:
            raise ValueError(f"sensors[{name!r}] must hold one scan of each time")
    fields = [*MEASURED, *SIGMAS]
    if any(scan.elevation.any() for *_, scan in scans):
        fields += UPWARDS
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("time", "sensor", *fields))
    for time, name, scan in scans:
        columns = [getattr(scan, field).tolist() for field in fields]
        writer.writerows((time, name, *row) for row in zip(*columns, strict=True))
    with atomic_write(check_path("path", path)) as file:
        file.write(text.getvalue().encode())


# ---- The entry of READERS


def _read(paths: list[str], chosen: Mapping[str, Any]) -> Source:
    """The sensors of logs that have a mounting; files of one sensor follow each other."""
    mountings = mountings_of(chosen)
    scans: dict[str, list[RadarScan]] = {}
    names = ("time_unit", "degrees", "scan_gap", "skip_invalid", "min_snr")
    options = {"columns": _pairs(chosen["columns"]), **options_of(chosen, *names)}
    for source in paths:
        name, path = _named(source)
        read = load_csv(path, **options)
        if name and len(read) > 1:
            raise ValueError(f"--csv {source}: the file has several sensors, {', '.join(read)}")
        for sensor, own in read.items():
            scans.setdefault(name or sensor, []).extend(own)
    if scans.keys() != mountings.keys():
        raise ValueError(
            f"the sensors of {', '.join(paths)} are {brief(', '.join(sorted(scans)))}, but "
            f"--mounting names {', '.join(sorted(mountings))}; each needs one --mounting NAME X Y "
            "YAW"
        )
    return Source({name: (own, mountings[name]) for name, own in scans.items()})


def _named(source: str) -> tuple[str, str]:
    """Name and path of NAME=FILE; a path alone has no name."""
    name, equals, path = source.partition("=")
    return (name, path) if equals and not os.path.exists(source) else ("", source)


def _pairs(text: str | None) -> dict[str, str]:
    """The columns that --columns names."""
    pairs = [pair.partition("=") for pair in (text or "").split(",") if pair]
    for name, _, column in pairs:
        if not column or name not in _LOG_QUANTITIES:
            raise ValueError(
                f"--columns must be like time=time_ns,range=dist, with names out of "
                f"{', '.join(_LOG_QUANTITIES)}, but has {name!r}"
            )
    return {name: column for name, _, column in pairs}


READER = Reader(
    "csv",
    "a log with a line for each target",
    load_csv,
    (
        *LOG_OPTIONS,
        Option(
            "columns",
            "the columns of a log by what they hold, such as time=stamp_ns,azimuth=-angle_rad",
            {"metavar": "NAME=COLUMN,..."},
        ),
        Option("time_unit", "of the times", {"choices": ("s", "ms", "us", "ns")}),
        Option(
            "degrees",
            "the file's azimuths and their standard deviations are in degrees",
            {"action": "store_true", "default": None},
        ),
        Option(
            "scan_gap",
            "lines that are at most S apart are one scan (default: those of equal time)",
            {"type": float, "metavar": "S"},
        ),
        Option(
            "skip_invalid",
            "leave out lines with a number that is missing or not finite, or without a range",
            {"action": "store_true", "default": None},
        ),
    ),
    _read,
    parsing={"action": "append"},
)
