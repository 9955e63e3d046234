"""Logs of radar targets as comma-separated values: one line for each target."""

import csv
import io
import itertools
import math
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from d2d._checks import FINITE, Bounds, check_path, check_positive_scalar
from d2d._types import Array
from d2d.radar.files import atomic_write
from d2d.radar.readers.reader import Option, Reader, Source, check_once
from d2d.radar.readers.shared import brief, bytes_of
from d2d.radar.scans.scan import BOUNDS, MEASURED, SIGMAS, Mounting, RadarScan

_RADIANS = BOUNDS["azimuth"]._replace(
    hint="; are these degrees (degrees=True, on the command line --degrees)?"
)
_STEP_BACK = 1.0  # s
_DEGREES = Bounds(most=360.0, unit="in degrees, ")


def load_csv(
    path: str | os.PathLike[str],
    *,
    degrees: bool = False,
    sigma_range: float | None = None,
    sigma_azimuth: float | None = None,
    sigma_doppler: float | None = None,
) -> dict[str, list[RadarScan]]:
    """Read the scans of one or several sensors from a CSV file with a line for each target.

    Returns a dict with the scans of each sensor, in time order, by its name; where its clock steps
    back once by more than a second, as at midnight, the scans after that step come last.  Lines
    with equal time and sensor form a scan, wherever they stand.  A scan without targets has no
    line: the one before it and the one after it are then neighbours at a longer interval.

    The first line names the columns, in any order: ``time`` (s), ``range`` (m), ``azimuth`` (rad,
    counter-clockwise from the boresight), ``doppler`` (m/s, positive for receding targets), the
    standard deviations ``sigma_range``, ``sigma_azimuth`` and ``sigma_doppler`` in the same units,
    and ``sensor``, a name or number; without it, there is one sensor called "radar".  Other columns
    are ignored, and so are empty lines and those that begin with #.  The separator is a comma, a
    semicolon or a tab; the decimal separator is a point.  With ``degrees``, the columns ``azimuth``
    and ``sigma_azimuth`` are in degrees.

    The arguments ``sigma_range``, ``sigma_azimuth`` and ``sigma_doppler`` are the standard
    deviations of all targets, always in m, rad and m/s, instead of the columns or where the file
    has none.

    Raises a ``ValueError`` if a column is missing, and one with its number if a line is wrong.
    """
    source = check_path("path", path)
    sigmas = {
        name: check_positive_scalar(name, sigma)
        for name, sigma in zip(SIGMAS, (sigma_range, sigma_azimuth, sigma_doppler), strict=True)
        if sigma is not None
    }
    names, rows = read_table(source, decoded(source), ("time", *MEASURED), (*SIGMAS, "sensor"))
    columns = _columns(source, names, sigmas)
    lines: list[int] = []
    values: list[list[float]] = []
    members: dict[str, dict[float, list[int]]] = {}  # which targets each scan has
    for line, row in rows:
        try:
            sensor, numbers = _target(row, columns)
        except ValueError as error:
            raise ValueError(f"{source}, line {line}: {error}") from None
        members.setdefault(sensor, {}).setdefault(numbers[0], []).append(len(lines))
        lines.append(line)
        values.append(numbers)
    if not lines:
        raise ValueError(f"{source} has no line with a target")
    numeric = [name for name in columns if name != "sensor"]
    table = dict(zip(numeric, np.array(values).T, strict=True))
    _check(source, lines, table, degrees)
    for name in ("azimuth", "sigma_azimuth"):
        if degrees and name in table:
            table[name] = np.deg2rad(table[name])
    table |= {name: np.full(len(lines), sigma) for name, sigma in sigmas.items()}
    return {
        sensor: [
            RadarScan(time, *(table[name][scans[time]] for name in (*MEASURED, *SIGMAS)))
            for time in _in_order(scans)
        ]
        for sensor, scans in members.items()
    }


def _in_order(times: Iterable[float]) -> list[float]:
    """Times in the order of lines if a clock steps back once, as at midnight; otherwise sorted."""
    given = list(times)
    steps = enumerate(itertools.pairwise(given), start=1)
    back = [i for i, (earlier, later) in steps if later < earlier - _STEP_BACK]
    cut = back[0] if len(back) == 1 else 0
    return sorted(given[:cut]) + sorted(given[cut:])


def decoded(path: Path) -> str:
    """The text of a file in UTF-8, in UTF-16 with its mark, or otherwise in Latin-1."""
    raw = bytes_of(path)
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return raw.decode("utf-16", errors="replace")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")  # so that names that differ stay different


def _check(source: Path, lines: list[int], table: Mapping[str, Array], degrees: bool) -> None:
    """Raise a ValueError that names the first line with a number that is out of bounds."""
    bounds = {"time": FINITE, **BOUNDS, "azimuth": _DEGREES if degrees else _RADIANS}
    wrong = {
        int(np.flatnonzero(bad)[0]): name
        for name, column in table.items()
        if (bad := ~bounds[name].hold(column)).any()
    }
    if wrong:
        first = min(wrong)
        name = wrong[first]
        bounds[name].number(f"{source}, line {lines[first]}: {name}", table[name][first])


def read_table(
    source: Path, text: str, needed: tuple[str, ...], known: tuple[str, ...] = ()
) -> tuple[list[str], Iterator[tuple[int, list[str]]]]:
    """The names of the columns, perhaps behind a # as NumPy writes it, and the rows below them.

    A row is the number and the words of a line that is neither empty nor a comment.
    """
    file = io.StringIO(text, newline="")
    for number, line in enumerate(iter(file.readline, ""), start=1):
        separator = max(",;\t", key=line.count)
        names = [word.strip().strip('"').lower() for word in line.lstrip("# ").split(separator)]
        missing = [name for name in needed if name not in names]
        if not missing:
            twice = [name for name in (*needed, *known) if names.count(name) > 1]
            if twice:
                raise ValueError(f"{source}, line {number}: the column {twice[0]!r} is named twice")
            reader = csv.reader(file, delimiter=separator, strict=True)
            return names, _rows(source, reader, number, len(names))
        if line.strip() and not line.startswith("#"):
            raise ValueError(
                f"{source}, line {number}: the first line must name the columns "
                f"{', '.join(needed)}, but names {brief(', '.join(map(repr, names)))}"
            )
    raise ValueError(f"{source} is empty: its first line must name the columns")


def _columns(source: Path, names: list[str], sigmas: Mapping[str, float]) -> dict[str, int]:
    places = {name: place for place, name in enumerate(names)}
    missing = [name for name in SIGMAS if name not in places and name not in sigmas]
    if missing:
        flags = ", ".join(f"--{name.replace('_', '-')}" for name in missing)
        raise ValueError(
            f"{source} has no column {', '.join(missing)}, so that what is missing must be given "
            f"for all targets, as an argument of the same name (on the command line: {flags})"
        )
    wanted = ("time", *MEASURED, *(name for name in SIGMAS if name not in sigmas), "sensor")
    return {name: places[name] for name in wanted if name in places}


def _rows(source: Path, reader: Any, first: int, width: int) -> Iterator[tuple[int, list[str]]]:
    """The rows below the line ``first``, each of ``width`` words."""
    try:
        for row in reader:
            if not any(word.strip() for word in row) or row[0].startswith("#"):
                continue
            if len(row) != width:
                raise ValueError(
                    f"{source}, line {first + reader.line_num}: there must be {width} values as in "
                    f"the first line, but are {len(row)}"
                )
            yield first + reader.line_num, row
    except csv.Error as error:
        raise ValueError(f"{source}, line {first + reader.line_num}: {error}") from None


def _target(row: list[str], columns: Mapping[str, int]) -> tuple[str, list[float]]:
    numbers = [number(name, row[place]) for name, place in columns.items() if name != "sensor"]
    if "sensor" not in columns:
        return "radar", numbers
    sensor = row[columns["sensor"]].strip()
    if not sensor:
        raise ValueError("sensor must be a name or a number, but is empty")
    return sensor, numbers


def number(name: str, text: str) -> float:
    """The number that a text is; a ValueError names what it should be."""
    try:
        if "_" in text or not text.isascii():  # a typing error, but a number to Python
            raise ValueError
        return float(text)
    except ValueError:
        raise ValueError(f"{name} must be a number, but is {brief(repr(text))}") from None


def write_csv(path: str | os.PathLike[str], sensors: Mapping[str, Iterable[RadarScan]]) -> None:
    """Write the scans of sensors, by their names, as a CSV file that `load_csv` reads, bit by bit.

    All columns are written, in m, rad and m/s, line by line in time order.  The extent is not, and
    a scan without targets leaves no line.  An existing file is replaced once all is written; a
    leading ``~`` stands for the home folder.  Raises a ``ValueError`` if a name is empty or begins
    or ends with a space, or two scans of a sensor have the same time.
    """
    for name in sensors:
        if not name or name != name.strip() or not name.isprintable():
            raise ValueError(f"sensors must be keyed by names, but hold {name!r}")
    scans = [(scan.time, name, scan) for name, own in sensors.items() for scan in own]
    scans.sort(key=lambda entry: entry[:2])
    for (time, name, _), later in itertools.pairwise(scans):
        if (time, name) == later[:2]:
            raise ValueError(f"sensors[{name!r}] must hold one scan of each time")
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("time", "sensor", *MEASURED, *SIGMAS))
    for time, name, scan in scans:
        columns = [getattr(scan, field).tolist() for field in (*MEASURED, *SIGMAS)]
        writer.writerows((time, name, *row) for row in zip(*columns, strict=True))
    with atomic_write(check_path("path", path)) as file:
        file.write(text.getvalue().encode())


# ---- The entry of READERS


def _read(path: str, chosen: Mapping[str, Any]) -> Source:
    """The sensors of a log that have a mounting; angles are in degrees."""
    mountings = mountings_of(chosen)
    scans = load_csv(path, degrees=bool(chosen["degrees"]), **sigmas_of(chosen))
    if scans.keys() != mountings.keys():
        raise ValueError(
            f"the sensors of {path} are {brief(', '.join(sorted(scans)))}, but --mounting names "
            f"{', '.join(sorted(mountings))}; each needs one --mounting NAME X Y YAW"
        )
    return Source({name: (own, mountings[name]) for name, own in scans.items()})


def mountings_of(chosen: Mapping[str, Any]) -> dict[str, Mounting]:
    """The mountings that the options name."""
    check_once([name for name, *_ in chosen["mounting"]])
    mountings = {}
    for name, *numbers in chosen["mounting"]:
        try:
            x, y, yaw = (number("each of X, Y and YAW", word) for word in numbers)
            mountings[name] = Mounting(x, y, math.radians(yaw))
        except ValueError as error:
            raise ValueError(f"--mounting {name} {' '.join(numbers)}: {error}") from None
    return mountings


def sigmas_of(chosen: Mapping[str, Any]) -> dict[str, float | None]:
    """The standard deviations that the options give to all targets."""
    sigmas = {name: chosen[name] for name in SIGMAS}
    if sigmas["sigma_azimuth"] is not None:
        sigmas["sigma_azimuth"] = math.radians(sigmas["sigma_azimuth"])
    return sigmas


def _sigma(name: str, unit: str) -> Option:
    about = f"standard deviation of the {name} of all targets, instead of a column"
    return Option(f"sigma_{name}", about, {"type": float, "metavar": unit})


READER = Reader(
    "csv",
    "a log with a line for each target",
    load_csv,
    (
        Option(
            "mounting",
            "where a sensor sits, in m, m, degrees; once for each sensor",
            {"action": "append", "nargs": 4, "metavar": ("NAME", "X", "Y", "YAW")},
            needed=True,
        ),
        Option(
            "degrees",
            "the file's azimuths and their standard deviations are in degrees",
            {"action": "store_true", "default": None},
        ),
        _sigma("range", "M"),
        _sigma("azimuth", "DEG"),
        _sigma("doppler", "M/S"),
    ),
    _read,
)
