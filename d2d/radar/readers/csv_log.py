"""Logs of radar targets as tables: one line for each target."""

import csv
import io
import itertools
import os
import warnings
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from d2d._checks import (
    NOT_NEGATIVE,
    check_choice,
    check_instance,
    check_members,
    check_path,
    check_positive_scalar,
)
from d2d._types import Array
from d2d.radar.files import atomic_write, brief
from d2d.radar.readers.reader import Reader, Source, mountings_of, options_of
from d2d.radar.readers.table import TARGET, Table, read_table, scan_of, select, valid
from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.scans.scan import ANGLES, MEASURED, SIGMAS, UPWARDS, RadarScan

_STEP_BACK = 1.0  # s
_TEXTS, _CARTESIAN = ("sensor", "frame"), ("x", "y")
_QUANTITIES = ("time", *TARGET, *_TEXTS)


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

    The first line names the columns, in any order: ``time`` (s, or a date and time in ISO 8601);
    ``range`` (m), ``azimuth`` (rad, counter-clockwise from the boresight) and perhaps ``elevation``
    (rad, upwards), or else ``x`` along the boresight, ``y`` to the left and ``z`` upwards (m);
    ``doppler`` (m/s, positive for targets that move away: ahead of a moving car it is negative);
    ``sigma_range``, ``sigma_azimuth``, ``sigma_doppler`` and ``sigma_elevation`` in the same units;
    an ``snr``; and ``sensor``, a name or number, without which there is one called "radar".

    Other usual names, and a unit at the end of a name (``time_ns``, ``azimuth_deg``), are
    recognised, other columns ignored.  Lines with equal time and sensor form a scan; so do lines
    that are at most ``scan_gap`` (s) apart, at the median of their times, or neighbouring lines
    with the same value in a column ``frame``.  Where the time steps back by more than a second, a
    new segment begins, and none of its scans is merged with one before.

    Returns a dict with the scans of each sensor by its name.  Raises a ``ValueError`` if a column
    is missing, and one with its number if a line is wrong.

    Parameters
    ----------
    path : path
        Text as `d2d.radar.readers.table` says, perhaps compressed by gzip, or Parquet.
    columns : mapping of str to str, optional
        The names of columns by what they hold, with a minus sign if the sign is the other:
        ``{"azimuth": "-track_angle_rad"}``.
    time_unit : "s", "ms", "us" or "ns", optional
    degrees : bool
        Units of times and angles, where a column's name does not say them.
    scan_gap : float, s
    skip_invalid : bool
        Whether lines without a target (a number missing or not finite, no range) are left out, with
        a warning that counts them.
    min_snr : float, optional
        Targets with a smaller value in the column ``snr`` are left out.
    sigma_range, sigma_azimuth, sigma_doppler : float, m, rad, m/s
        Of all targets, instead of the columns; by default usual values, with a warning.
    """
    source, named = check_path("path", path), dict(columns or {})
    given = dict(zip(SIGMAS, (sigma_range, sigma_azimuth, sigma_doppler), strict=True))
    sigmas = {n: check_positive_scalar(n, sigma) for n, sigma in given.items() if sigma is not None}
    gap = NOT_NEGATIVE.number("scan_gap", scan_gap)
    stated = dict.fromkeys(ANGLES, "deg") if degrees else {}
    if time_unit is not None:
        check_choice("time_unit", time_unit, ("s", "ms", "us", "ns"))
        stated["time"] = time_unit
    hint = "" if skip_invalid else "; skip_invalid (--skip-invalid) leaves such lines out"
    table = read_table(
        source,
        [("time", *place, "doppler", *named) for place in (MEASURED[:2], _CARTESIAN)],
        [name for name in _QUANTITIES if name not in sigmas],
        named=named,
        stated=stated,
        torn=skip_invalid,
        hint=hint,
    )
    unused = {*_TEXTS, *(() if min_snr is not None else ("snr",))}
    if table.columns.keys() >= {*MEASURED[:2]}:
        unused |= {*_CARTESIAN}
    read = [name for name in table.columns if name not in unused]
    values = table.numbers(read, invalid=skip_invalid)
    kept = valid(values) | (not skip_invalid)
    try:
        table.check(values, kept)
    except ValueError as error:
        raise ValueError(f"{error}{'' if valid(values).all() else hint}") from None
    values, used = select(str(source), "lines", values, kept, sigmas, min_snr)
    if not used.any():
        raise ValueError(f"{source} has no line with a target")
    rows, sensors = np.flatnonzero(used), np.full(len(used), "radar")
    if "sensor" in table.words:
        sensors = np.char.strip(np.array(table.words["sensor"]))
        for row in rows[sensors[rows] == ""][:1]:
            where = table.where(row)
            raise ValueError(f"{where}: sensor must be a name or a number, but is empty")
    return {
        name: _scans(table, values, rows[sensors[rows] == name], gap)
        for name in dict.fromkeys(sensors[rows].tolist())
    }


def _scans(
    table: Table, values: Mapping[str, Array], rows: NDArray[np.intp], gap: float
) -> list[RadarScan]:
    """The scans of a sensor's rows, in time order within each segment of the clock."""
    times = values["time"][rows]
    segment = np.cumsum(np.diff(times, prepend=times[0]) < -_STEP_BACK)
    if segment[-1]:
        warnings.warn(
            f"{table.source}: the time steps back {segment[-1]} time(s); a new segment begins "
            "there (if this is one drive, sort its lines by time)",
            stacklevel=3,
        )
    if "frame" in table.words:
        order, frames = np.arange(len(rows)), np.array(table.words["frame"])[rows]
        begins = frames[1:] != frames[:-1]
    else:
        order = np.lexsort((times, segment))
        begins = np.diff(times[order]) > gap
    begins |= np.diff(segment[order]) > 0
    groups = np.split(order, 1 + np.flatnonzero(begins))
    middle = [float(np.median(times[group])) for group in groups]
    scans = []
    for which in np.lexsort((middle, [segment[group[0]] for group in groups])):
        own = rows[groups[which]]
        try:
            scans.append(scan_of(middle[which], {name: c[own] for name, c in values.items()}))
        except ValueError as error:
            raise ValueError(f"{table.where(own[0])}, where a scan begins: {error}") from None
    return scans


def write_csv(path: str | os.PathLike[str], sensors: Mapping[str, Iterable[RadarScan]]) -> None:
    """Write the scans of sensors, by their names, as a CSV file that `load_csv` reads, bit by bit.

    All columns but the extent are written, elevations only if there are any; a scan without targets
    leaves no line.  An existing file is replaced once all is written.  Raises a ``ValueError`` if a
    name is empty or begins or ends with a space, or two scans of a sensor have the same time.
    """
    check_instance("sensors", sensors, Mapping)
    scans = []
    for name in check_members("sensors", sensors, str):
        if not name or name != name.strip() or not name.isprintable():
            raise ValueError(f"sensors must be keyed by names, but hold {name!r}")
        own = check_members(f"sensors[{name!r}]", sensors[name], RadarScan)
        scans += [(scan.time, name, scan) for scan in own]
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


def _read(paths: list[str], chosen: Mapping[str, Any]) -> Source:
    """The sensors of logs that have a mounting; files of one sensor follow each other."""
    mountings = mountings_of(chosen)
    scans: dict[str, list[RadarScan]] = {}
    names = "columns", "time_unit", "degrees", "scan_gap", "skip_invalid", "min_snr"
    given = options_of(chosen, *names)
    for source in paths:
        name, equals, path = source.partition("=")
        if not equals or os.path.exists(source):  # without a name
            name, path = "", source
        read = load_csv(path, **given)
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
    return {name: (own, mountings[name]) for name, own in scans.items()}, ErrorBudget()


READER = Reader(
    "csv", "a log with a line for each target", load_csv, ("mounting",), _read, action="append"
)
