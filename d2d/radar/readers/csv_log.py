"""Logs of radar targets as comma-separated values: one line for each target."""

import csv
import io
import math
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TextIO

import numpy as np

from d2d._checks import check_flag, check_instance, check_members, check_path, check_positive_scalar
from d2d.radar.files import written_whole
from d2d.radar.scans.scan import MAX_RANGE, RadarScan

ONLY_SENSOR = "radar"  # the name of the sensor of a file that names none

_MEASURED = ("time", "range", "azimuth", "doppler")
_SIGMAS = ("sigma_range", "sigma_azimuth", "sigma_doppler")
_READ = (*_MEASURED, *_SIGMAS, "sensor")
_ANGLES = ("azimuth", "sigma_azimuth")
_POSITIVE = ("range", *_SIGMAS)
_SEPARATORS = ",;\t"
_TURN = 2.0 * math.pi * (1.0 + 1e-6)  # as scans allow it


class _Header(NamedTuple):
    """The content of the first line, and its number."""

    names: list[str]
    separator: str
    line: int


def load_csv(
    path: str | os.PathLike[str],
    *,
    degrees: bool = False,
    sigma_range: float | None = None,
    sigma_azimuth: float | None = None,
    sigma_doppler: float | None = None,
) -> dict[str, list[RadarScan]]:
    """Read the scans of one or several sensors from a CSV file with a line for each target.

    Parameters
    ----------
    path : path
        The first line names the columns, in any order: ``time`` (s), ``range`` (m), ``azimuth``
        (rad, counter-clockwise from the boresight), ``doppler`` (m/s, positive for receding
        targets), the standard deviations ``sigma_range``, ``sigma_azimuth`` and ``sigma_doppler``
        in the same units, and ``sensor``, a name or number.  Other columns are ignored, and so are
        empty lines and those that begin with #.  The separator is a comma, a semicolon or a tab;
        the decimal separator is a point.
    degrees : bool
        Whether the columns ``azimuth`` and ``sigma_azimuth`` are in degrees.
    sigma_range, sigma_azimuth, sigma_doppler : float, optional, in m, rad and m/s
        Standard deviations of all targets.  Needed if the file has no such column; if it has, these
        are taken instead.

    Returns
    -------
    dict of str to list of RadarScan
        The scans of each sensor in time order.  Lines with equal time and sensor form a scan,
        wherever they stand.  Without the column ``sensor``, all belong to one called "radar".

    Raises
    ------
    ValueError
        If a column is missing, or a line cannot be read; the message gives its number and says what
        is wrong with it.  Also if an argument is invalid.
    OSError
        If the file cannot be read.

    Notes
    -----
    A scan without targets has no line.  The scan before it and the one after it are then neighbours
    at a longer interval.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import numpy as np
    >>> from d2d.radar import load_csv
    >>> lines = ["time,range,azimuth,doppler", "0.0,12.5,-3.0,-4.9", "0.0,8.1,20.0,-4.7"]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     log = Path(folder) / "log.csv"
    ...     np.savetxt(log, lines, "%s")
    ...     load_csv(
    ...         log, degrees=True, sigma_range=0.1, sigma_azimuth=0.01, sigma_doppler=0.05
    ...     )
    {'radar': [RadarScan(time=0.000000 s, 2 targets)]}
    """
    source = check_path("path", path)
    in_degrees = check_flag("degrees", degrees)
    sigmas = {
        name: check_positive_scalar(name, sigma)
        for name, sigma in zip(_SIGMAS, (sigma_range, sigma_azimuth, sigma_doppler), strict=True)
        if sigma is not None
    }
    # bytes that are not text become a character that no number has, so that their line is named
    with source.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        header = _header(source, file)
        columns = _columns(source, header, sigmas)
        targets: dict[str, dict[float, list[list[float]]]] = {}
        for number, row in _rows(source, file, header):
            try:
                sensor, values = _target(row, columns, in_degrees)
            except ValueError as error:
                raise ValueError(f"{source}, line {number}: {error}") from None
            targets.setdefault(sensor, {}).setdefault(values[0], []).append(values[1:])
    if not targets:
        raise ValueError(f"{source} has no line with a target")
    names = [name for name in (*_MEASURED, *_SIGMAS) if name in columns][1:]
    return {
        sensor: [_scan(time, names, scans[time], sigmas) for time in sorted(scans)]
        for sensor, scans in targets.items()
    }


def _header(source: Path, file: TextIO) -> _Header:
    """The line that names the columns; it may stand behind a #, as NumPy writes it."""
    for number, line in enumerate(iter(file.readline, ""), start=1):
        separator = max(_SEPARATORS, key=line.count)
        names = [word.strip().strip('"').lower() for word in line.lstrip("# ").split(separator)]
        missing = [name for name in _MEASURED if name not in names]
        if not missing:
            twice = [name for name in _READ if names.count(name) > 1]
            if twice:
                raise ValueError(f"{source}, line {number}: the column {twice[0]!r} is named twice")
            return _Header(names, separator, number)
        if line.strip() and not line.startswith("#"):
            raise ValueError(
                f"{source}, line {number}: the first line must name the columns "
                f"{', '.join(_MEASURED)}, but names {', '.join(map(repr, names))}"
            )
    raise ValueError(f"{source} is empty: its first line must name the columns")


def _columns(source: Path, header: _Header, sigmas: Mapping[str, float]) -> dict[str, int]:
    """The place of each column that is read."""
    places = {name: place for place, name in enumerate(header.names)}
    missing = [name for name in _SIGMAS if name not in places and name not in sigmas]
    if missing:
        flags = ", ".join(f"--{name.replace('_', '-')}" for name in missing)
        raise ValueError(
            f"{source} has no column {', '.join(missing)}, so that what is missing must be given "
            f"for all targets, as an argument of the same name (on the command line: {flags})"
        )
    wanted = (*_MEASURED, *(name for name in _SIGMAS if name not in sigmas), "sensor")
    return {name: places[name] for name in wanted if name in places}


def _rows(source: Path, file: TextIO, header: _Header) -> Iterator[tuple[int, list[str]]]:
    """The lines that hold targets, with their numbers."""
    reader = csv.reader(file, delimiter=header.separator, strict=True)
    try:
        for row in reader:
            if not any(word.strip() for word in row) or row[0].startswith("#"):
                continue
            number = header.line + reader.line_num
            if len(row) != len(header.names):
                raise ValueError(
                    f"{source}, line {number}: there must be {len(header.names)} values as in "
                    f"the first line, but are {len(row)}"
                )
            yield number, row
    except csv.Error as error:
        raise ValueError(f"{source}, line {header.line + reader.line_num}: {error}") from None


def _target(row: list[str], columns: Mapping[str, int], degrees: bool) -> tuple[str, list[float]]:
    """The sensor of a target and its numbers, in the order of the columns."""
    values = []
    for name, place in columns.items():
        if name != "sensor":
            values.append(_number(name, row[place], degrees and name in _ANGLES))
    if "sensor" not in columns:
        return ONLY_SENSOR, values
    sensor = row[columns["sensor"]].strip()
    if not sensor:
        raise ValueError("sensor must be a name or a number, but is empty")
    return sensor, values


def _number(name: str, text: str, degrees: bool) -> float:
    """A finite number, angles in rad."""
    plain = text.strip()
    try:
        if "_" in plain or not plain.isascii():  # a typing error, but a number to Python
            raise ValueError
        value = float(plain)
    except ValueError:
        raise ValueError(f"{name} must be a number, but is {text!r}") from None
    if not math.isfinite(value):
        raise ValueError(f"{name} must be finite, but is {text.strip()}")
    if name in _POSITIVE and value <= 0.0:
        raise ValueError(f"{name} must be positive, but is {text.strip()}")
    if name == "range" and value > MAX_RANGE:
        raise ValueError(
            f"range must be in m, at most {MAX_RANGE:g}, but is {plain}; are these millimetres?"
        )
    if degrees:
        value = math.radians(value)
    if name == "azimuth" and abs(value) > _TURN:
        unit, hint = (
            ("degrees", "")
            if degrees
            else ("radians", "; are these degrees (degrees=True, on the command line --degrees)?")
        )
        raise ValueError(f"azimuth must be in {unit}, within a turn, but is {text.strip()}{hint}")
    return value


def _scan(
    time: float, names: list[str], rows: list[list[float]], sigmas: Mapping[str, float]
) -> RadarScan:
    values = dict(zip(names, np.array(rows).T, strict=True)) | dict(sigmas)
    return RadarScan(time, *(values[name] for name in (*_MEASURED[1:], *_SIGMAS)))


def write_csv(path: str | os.PathLike[str], sensors: Mapping[str, Iterable[RadarScan]]) -> None:
    """Write the scans of sensors as a CSV file that `load_csv` reads, bit by bit.

    Parameters
    ----------
    path : path
        An existing file is replaced once all is written; a leading ``~`` stands for the home
        folder.
    sensors : mapping of str to iterable of RadarScan
        The scans by the name of their sensor.  All columns are written, in m, rad and m/s, line by
        line in time order.  The extent is not, and a scan without targets leaves no line.

    Raises
    ------
    ValueError
        If an argument is of the wrong type, or a name is empty.
    OSError
        If the file cannot be written.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("time", "sensor", *_MEASURED[1:], *_SIGMAS))
    for time, name, scan in _in_time_order(sensors):
        columns = [getattr(scan, field).tolist() for field in (*_MEASURED[1:], *_SIGMAS)]
        writer.writerows((time, name, *row) for row in zip(*columns, strict=True))
    with written_whole(check_path("path", path)) as file:
        file.write(text.getvalue().encode())


def _in_time_order(
    sensors: Mapping[Any, Iterable[RadarScan]],
) -> list[tuple[float, str, RadarScan]]:
    check_instance("sensors", sensors, Mapping)
    scans = []
    for name, own in sensors.items():
        if not isinstance(name, str) or not name.isprintable() or name != name.strip() or not name:
            raise ValueError(f"sensors must be keyed by names, but hold {name!r}")
        members = check_members(f"sensors[{name!r}]", own, RadarScan)
        if len({scan.time for scan in members}) < len(members):
            raise ValueError(f"sensors[{name!r}] must hold one scan of each time")
        scans += [(scan.time, name, scan) for scan in members]
    return sorted(scans, key=lambda entry: entry[:2])
