"""Tables of numbers as text, compressed or not, or as Parquet: columns by name, sign and unit."""

import csv
import gzip
import io
import math
import re
import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from d2d._types import Array
from d2d.radar.readers.shared import brief, bytes_of, reading
from d2d.radar.scans.scan import MEASURED, RadarScan

_COMPRESSION = 200  # times the size of a gzip file that its text may have; logs have some 10
_TIMES = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0, "sec": 1.0, "nsec": 1e-9}
_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "km": 1e3}
_SPEEDS = {"m_per_s": 1.0, "mps": 1.0, "m_s": 1.0, "kmh": 1 / 3.6, "km_h": 1 / 3.6}
_ANGLES = {"rad": 1.0, "deg": math.pi / 180.0}
_RATES = {f"{name}{end}": one for name, one in _ANGLES.items() for end in ("_per_s", "_s", "ps")}


class Quantity(NamedTuple):
    """Content of a column: names that are recognised, and units in terms of the scan's own."""

    names: tuple[str, ...]
    units: Mapping[str, float] = {}


QUANTITIES = {
    "time": Quantity(("time", "timestamp", "stamp", "t"), _TIMES),
    "range": Quantity(("range", "distance", "dist", "r", "rho"), _LENGTHS),
    "azimuth": Quantity(("azimuth", "az", "angle", "phi"), _ANGLES),
    "elevation": Quantity(("elevation", "el"), _ANGLES),
    "x": Quantity(("x", "pos_x"), _LENGTHS),
    "y": Quantity(("y", "pos_y"), _LENGTHS),
    "z": Quantity(("z", "pos_z"), _LENGTHS),
    "doppler": Quantity(
        (
            *("doppler", "doppler_velocity", "v_doppler", "range_rate", "radial_velocity"),
            *("radial_speed", "v_r", "vr", "velocity"),
        ),
        _SPEEDS,
    ),
    "sigma_range": Quantity(("sigma_range",), _LENGTHS),
    "sigma_azimuth": Quantity(("sigma_azimuth",), _ANGLES),
    "sigma_doppler": Quantity(("sigma_doppler",), _SPEEDS),
    "sigma_elevation": Quantity(("sigma_elevation",), _ANGLES),
    "snr": Quantity(("snr", "snr_db", "intensity", "amplitude", "power", "rcs")),
    "sensor": Quantity(("sensor", "sensor_id")),
    "frame": Quantity(()),
    "speed": Quantity(("speed", "velocity", "v"), _SPEEDS),
    "yaw_rate": Quantity(("yaw_rate", "yawrate", "omega", "gyro_z"), _RATES | _ANGLES),
}

# Of a target; the others are of a log or of an odometry.
TARGET = (
    *("range", "azimuth", "elevation", "x", "y", "z", "doppler", "snr"),
    *("sigma_range", "sigma_azimuth", "sigma_doppler", "sigma_elevation"),
)
# Between those that RadarScenes, nuScenes and the thesis's radar have.
_USUAL = {"sigma_range": 0.15, "sigma_azimuth": math.radians(0.5), "sigma_doppler": 0.06}


class Column(NamedTuple):
    """A column of a table: its place, and the factor to the units of `RadarScan`."""

    place: int
    factor: float = 1.0
    unit: str = ""  # as its name says; empty if it does not


class Table(NamedTuple):
    """The lines of a table that have a word for each column."""

    source: Path
    first: int  # number of the line that names the columns
    names: list[str]
    lines: NDArray[np.int64]
    words: Sequence[Sequence[str]]  # of each column
    torn: int  # lines with another number of words, which are left out

    def column(self, quantity: str, named: Mapping[str, str]) -> Column | None:
        """The column of a quantity: as ``named``, perhaps behind a minus sign, or recognised."""
        wanted = named.get(quantity, "").strip()
        found = recognised(quantity, self.names, _plain(wanted.removeprefix("-")))
        if found is None:
            return None
        name, factor, unit = found
        if self.names.count(name) > 1:
            where = f"{self.source}, line {self.first}"
            raise ValueError(f"{where}: the column {name!r} is named twice")
        return Column(self.names.index(name), -factor if wanted[:1] == "-" else factor, unit)

    def numbers(self, name: str, column: Column, *, invalid: bool = False) -> Array:
        """The numbers of a column, in the units of `RadarScan`; times may be dates.

        A word that is not one raises a ValueError with its line, or is nan with ``invalid``.
        """
        words = self.words[column.place]
        convert: Callable[[str], float] = float_of
        if name == "time" and words and is_date(words[0]):
            convert = seconds_of
        values = np.empty(len(words))
        for i, word in enumerate(words):
            try:
                values[i] = convert(word)
            except ValueError:
                if not invalid:
                    raise ValueError(
                        f"{self.where(i)}: {name} must be a number, but is {brief(repr(word))}"
                    ) from None
                values[i] = np.nan
        return values if convert is seconds_of else values * column.factor

    def where(self, row: int) -> str:
        """The file and the line of a row, for messages."""
        return f"{self.source}, line {self.lines[row]}"


def recognised(
    quantity: str, names: Collection[str], wanted: str = ""
) -> tuple[str, float, str] | None:
    """The name of a quantity among others, the factor of its unit and the unit that it ends with.

    It is the ``wanted`` name if one is given.
    """
    known, units = QUANTITIES[quantity]
    usual = (f"{name}_{unit}" if unit else name for name in known for unit in ("", *units))
    name = next((each for each in ([wanted] if wanted else usual) if each in names), None)
    if name is None:
        return None
    unit = max((u for u in units if name.endswith(f"_{u}")), key=len, default="")
    return name, units.get(unit, 1.0), unit


def read_table(source: Path, lacking: Callable[[Table], str], *, torn: bool = False) -> Table:
    """The table of a file, whose first line names the columns, perhaps behind a #.

    Columns are separated by a comma, a semicolon or a tab, and numbers may have a decimal comma.
    Lines that are empty or begin with # are skipped.  ``lacking`` says what a first line lacks.
    Raises a ValueError if the first line lacks something, and one with its number if a line has
    another number of words, unless ``torn`` lines are left out.
    """
    file = io.StringIO(decoded(source), newline="")
    for number, line in enumerate(iter(file.readline, ""), start=1):
        separator = max(",;\t", key=line.count)
        names = [_plain(word.strip().strip('"')) for word in line.lstrip("# ").split(separator)]
        table = Table(source, number, names, np.empty(0, np.int64), [[]] * len(names), 0)
        missing = lacking(table)
        if not missing:
            return _filled(table, csv.reader(file, delimiter=separator, strict=True), torn)
        if line.strip() and not line.startswith("#"):
            raise ValueError(
                f"{source}, line {number}: the first line must name the columns {missing}, but "
                f"names {brief(', '.join(map(repr, names)))}"
            )
    raise ValueError(f"{source} is empty: its first line must name the columns")


def _filled(table: Table, reader: Any, torn: bool) -> Table:
    """The table with the rows below its first line."""
    width, lines, rows, left_out = len(table.names), [], [], 0
    try:
        for row in reader:
            if len(row) == width and (row[0] or any(row)) and row[0][:1] != "#":
                lines.append(table.first + reader.line_num)
                rows.append(row)
            elif any(word.strip() for word in row) and not row[0].startswith("#"):
                left_out += 1
                if not torn:
                    raise ValueError(
                        f"there must be {width} values as in the first line, but are {len(row)}"
                    )
    except (csv.Error, ValueError) as error:
        where = f"{table.source}, line {table.first + reader.line_num}"
        raise ValueError(f"{where}: {error}") from None
    words = [*zip(*rows, strict=True)] if rows else [()] * width
    return table._replace(lines=np.array(lines, dtype=np.int64), words=words, torn=left_out)


def decoded(path: Path) -> str:
    """The text of a file in UTF-8, in UTF-16 with its mark, or otherwise in Latin-1.

    It may be compressed by gzip; a Parquet file, for which pandas must be installed, becomes text.
    """
    raw = bytes_of(path)
    if raw[:2] == b"\x1f\x8b":
        with reading(path, "a complete gzip file"):
            most = _COMPRESSION * len(raw)
            raw = gzip.GzipFile(fileobj=io.BytesIO(raw)).read(most + 1)
            if len(raw) > most:
                raise ValueError(f"it holds over {most} bytes, too many for its size")
    if raw[:4] == b"PAR1":
        import pandas

        with reading(path, "a Parquet file that pandas reads"):
            return str(pandas.read_parquet(io.BytesIO(raw)).to_csv(index=False))
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return raw.decode("utf-16", errors="replace")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")  # so that names that differ stay different


def float_of(word: str) -> float:
    """The number that a word is, also one with a decimal comma."""
    if "_" in word or not word.isascii():  # a typing error, but a number to Python
        raise ValueError
    return float(word.replace(",", ".") if "," in word else word)


def is_date(word: str) -> bool:
    """Whether a word is a date and time instead of a number."""
    try:
        return word.count("-") == 2 and math.isfinite(seconds_of(word))
    except ValueError:
        return False


def seconds_of(word: str) -> float:
    """Seconds since 1970 of a date and time in ISO 8601, in UTC unless it says otherwise."""
    moment = datetime.fromisoformat(word.strip())
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def scan_of(time: float, columns: Mapping[str, Any]) -> RadarScan:
    """The scan of targets that have range and azimuth, or else x and y, and perhaps a height."""
    errors: dict[str, Any] = {n: c for n, c in columns.items() if n.startswith("sigma_")}
    if not {"range", "azimuth"} <= columns.keys():
        place = columns["x"], columns["y"], columns.get("z")
        return RadarScan.from_cartesian(time, *place, doppler=columns["doppler"], **errors)
    elevation = columns.get("elevation")
    if elevation is None and "z" in columns:
        elevation = np.arcsin(np.clip(columns["z"] / columns["range"], -1.0, 1.0))
    measured = (columns[name] for name in MEASURED)
    return RadarScan(time, *measured, **errors, elevation=elevation)


def usual_sigmas(where: object, known: Collection[str]) -> dict[str, float]:
    """Standard deviations that stand in for those that are not known, with a warning if any do."""
    taken = sorted(_USUAL.keys() - known)
    if taken:
        warnings.warn(
            f"{where} has no {', '.join(taken)}: usual values are taken out of 0.15 m, 0.5 deg, "
            "0.06 m/s; --sigma-range, --sigma-azimuth and --sigma-doppler state those of your "
            "radar, on which the covariances rest",
            stacklevel=2,
        )
    return {name: _USUAL[name] for name in taken}


def number(name: str, text: str) -> float:
    """The number that a text is; a ValueError names what it should be."""
    try:
        return float_of(text)
    except ValueError:
        raise ValueError(f"{name} must be a number, but is {brief(repr(text))}") from None


def _plain(name: str) -> str:
    """A column's name in small letters, with _ for spaces and for brackets around a unit."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_") or name.strip().lower()
