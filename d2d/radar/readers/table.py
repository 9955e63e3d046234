"""Tables as text, compressed or not, or as Parquet: columns by name, sign and unit, and targets."""

import csv
import gzip
import io
import math
import re
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from d2d._checks import FINITE, check_choice
from d2d._types import Array
from d2d.radar.files import brief, reading
from d2d.radar.readers.shared import bytes_of
from d2d.radar.scans.scan import ANGLES, BOUNDS, MEASURED, RadarScan
from d2d.radar.tracks.gyro import RATE

Mask = NDArray[np.bool_]

_COMPRESSION = 200  # times the size of a gzip file that its text may have; logs have some 10
_TIMES = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0, "sec": 1.0, "nsec": 1e-9}
_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "km": 1e3}
_SPEEDS = {"m_per_s": 1.0, "mps": 1.0, "m_s": 1.0, "kmh": 1 / 3.6, "km_h": 1 / 3.6}
_ANGLES = {"rad": 1.0, "deg": math.pi / 180.0}
_RATES = {f"{name}{end}": one for name, one in _ANGLES.items() for end in ("_per_s", "_s", "ps")}
_VELOCITIES = "doppler_velocity v_doppler range_rate radial_velocity radial_speed v_r vr velocity"
# What a column of a target may hold: its units in terms of the scan's own, and its usual names.
TARGET: dict[str, tuple[Mapping[str, float], str]] = {
    "range": (_LENGTHS, "range distance dist r rho"),
    "azimuth": (_ANGLES, "azimuth az angle phi"),
    "elevation": (_ANGLES, "elevation el"),
    "x": (_LENGTHS, "x pos_x"),
    "y": (_LENGTHS, "y pos_y"),
    "z": (_LENGTHS, "z pos_z"),
    "doppler": (_SPEEDS, f"doppler {_VELOCITIES}"),
    "snr": ({}, "snr snr_db intensity amplitude power rcs"),
}
TARGET |= {f"sigma_{name}": (TARGET[name][0], f"sigma_{name}") for name in (*MEASURED, "elevation")}
QUANTITIES = TARGET | {
    "time": (_TIMES, "time timestamp stamp t datetime"),
    "sensor": ({}, "sensor sensor_id"),
    "frame": ({}, ""),
    "speed": (_SPEEDS, "speed velocity v"),
    "yaw_rate": (_RATES | _ANGLES, "yaw_rate yawrate omega gyro_z wz angular_velocity_z"),
}
_HINT = "; are these degrees (degrees=True, on the command line --degrees)?"
# Between those that RadarScenes, nuScenes and the thesis's radar have.
USUAL = {"sigma_range": 0.15, "sigma_azimuth": math.radians(0.5), "sigma_doppler": 0.06}
_BOUNDS = BOUNDS | {name: BOUNDS[name]._replace(hint=_HINT) for name in ANGLES}
_BOUNDS |= {"yaw_rate": RATE._replace(hint="; are these deg/s (column yaw_rate_deg)?")}


class Column(NamedTuple):
    """A column of a table: its name, and the factor to the units of `RadarScan`."""

    name: str
    factor: float = 1.0
    unit: str = ""  # as its name says; empty if it does not


class Table(NamedTuple):
    """The lines of a table that have a word for each column."""

    source: Path
    columns: dict[str, Column]  # by the quantities that are recognised
    words: Mapping[str, Sequence[str]]  # likewise
    lines: NDArray[np.int64]
    hint: str = ""  # for lines that are not right

    def where(self, row: int) -> str:
        """The file and the line of a row, for messages."""
        return f"{self.source}, line {self.lines[row]}"

    def numbers(self, names: Iterable[str], *, invalid: bool = False) -> dict[str, Array]:
        """The named columns, in the units of `RadarScan`; times may be dates.

        A word that is no number raises a ValueError with its line, or is nan with ``invalid``.
        """
        found = {}
        for name in names:
            words, factor = self.words[name], self.columns[name].factor
            dates = name == "time" and ":" in next(filter(None, words), "")
            convert = _seconds if dates else _float
            values = np.full(len(words), np.nan)
            for row, word in enumerate(words):
                try:
                    values[row] = convert(word)
                except ValueError:
                    if not invalid:
                        number(f"{self.where(row)}: {name}", word, convert, self.hint)
            found[name] = values if dates else values * factor
        return found

    def check(self, columns: Mapping[str, Array], used: Mask | bool = True) -> None:
        """Raise a ValueError that names the first line with a number that is out of bounds."""
        wrong = {
            int(np.argmax(bad)): name
            for name, column in columns.items()
            if (bad := used & ~_BOUNDS.get(name, FINITE).hold(column)).any()
        }
        if wrong:
            row, name = min(wrong.items())
            bounds, value = _BOUNDS.get(name, FINITE), float(columns[name][row])
            if name in ANGLES and self.columns[name].unit == "deg":
                value, most = math.degrees(value), math.degrees(bounds.most)
                bounds = bounds._replace(most=most, unit="in degrees, ", hint="")
            bounds.number(f"{self.where(row)}: {name}", value)


def columns_among(
    names: Collection[str],
    quantities: Collection[str],
    named: Mapping[str, str],
    stated: Mapping[str, str] = {},
) -> dict[str, Column]:
    """The columns of those quantities that are recognised among some names, or ``named`` there.

    A minus sign before a name turns the sign.  The unit is at its end, or the ``stated`` one.
    """
    found = {}
    for quantity, wanted in {**dict.fromkeys(quantities, ""), **named}.items():
        check_choice("columns", quantity, quantities)
        if not wanted and quantity in named:
            raise ValueError(f"columns must name the column of {quantity}, as in {quantity}=COLUMN")
        units, known = QUANTITIES[quantity]
        usual = [f"{n}_{unit}" if unit else n for n in known.split() for unit in ("", *units)]
        plain = plain_name(wanted.strip().removeprefix("-"))
        name = next((each for each in ([plain] if plain else usual) if each in names), None)
        if name is not None:
            ends = (unit for unit in units if name.endswith(f"_{unit}"))
            unit = max(ends, key=len, default=stated.get(quantity, ""))
            sign = -1.0 if wanted.strip()[:1] == "-" else 1.0
            found[quantity] = Column(name, sign * units.get(unit, 1.0), unit)
    return found


def read_table(
    source: Path,
    needed: Sequence[Collection[str]],
    quantities: Collection[str],
    *,
    named: Mapping[str, str] = {},
    stated: Mapping[str, str] = {},
    torn: bool = False,
    hint: str = "",
) -> Table:
    """The columns of some quantities in a file, whose first line names them, perhaps behind a #.

    Columns are separated by a comma, a semicolon or a tab, and numbers may have a decimal comma.
    Lines that are empty or begin with # are skipped.  Names and units of columns may be ``named``
    and ``stated``, by quantity.  Raises a ValueError unless all columns of one of the sets of
    ``needed`` ones are there, and one with its number if a line has another number of words, unless
    ``torn`` lines are to be lines without a word.  The ``hint`` ends the messages about lines.
    """
    file = io.StringIO(decoded(source), newline="")
    for first, line in enumerate(iter(file.readline, ""), start=1):
        separator, where = max(",;\t", key=line.count), f"{source}, line {first}"
        names = [plain_name(word.strip().strip('"')) for word in line.lstrip("# ").split(separator)]
        columns = columns_among(names, quantities, named, stated)
        if any(columns.keys() >= {*each} for each in needed):
            break
        if line.strip() and not line.startswith("#"):
            sets = (", ".join(named.get(n, n) for n in dict.fromkeys(each)) for each in needed)
            raise ValueError(
                f"{where}: the first line must name the columns {' or '.join(sets)}, but names "
                f"{brief(', '.join(map(repr, names)))}"
            )
    else:
        raise ValueError(f"{source} is empty: its first line must name the columns")
    for quantity, (name, _, unit) in columns.items():
        if names.count(name) > 1:
            raise ValueError(f"{where}: the column {name!r} is named twice")
        if unit != (said := stated.get(quantity, unit)):
            raise ValueError(f"{where}: {name} is in {unit}, but is said to be in {said}")
    rows, lines, width = [], [], len(names)
    reader = csv.reader(file, delimiter=separator, strict=True)
    try:
        for row in reader:
            if not any(row) or row[0].startswith("#"):
                continue
            if len(row) != width and not torn:
                raise ValueError(
                    f"there must be {width} values as in the first line, but are {len(row)}{hint}"
                )
            rows.append(row if len(row) == width else [""] * width)
            lines.append(first + reader.line_num)
    except (csv.Error, ValueError) as error:
        raise ValueError(f"{source}, line {first + reader.line_num}: {error}") from None
    each = [*zip(*rows, strict=True)] or [()] * width
    words = {quantity: each[names.index(column.name)] for quantity, column in columns.items()}
    return Table(source, columns, words, np.array(lines, dtype=np.int64), hint)


def decoded(path: Path) -> str:
    """The text of a file in UTF-8, in UTF-16 with its mark, or otherwise in Latin-1.

    It may be compressed by gzip; Parquet, for which pandas and pyarrow must be there, becomes text.
    """
    raw = bytes_of(path)
    if raw[:2] == b"\x1f\x8b":
        with reading(path, "a complete gzip file"):
            most = _COMPRESSION * len(raw)
            raw = gzip.GzipFile(fileobj=io.BytesIO(raw)).read(most + 1)
            if len(raw) > most:
                raise ValueError(f"it holds over {most} bytes, too many for its size")
    if raw[:4] == b"PAR1":
        with reading(path, "a Parquet file that pandas and pyarrow read"):
            import pandas

            frame = pandas.read_parquet(io.BytesIO(raw))
            return str(frame.to_csv(index=frame.index.name is not None))
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return raw.decode("utf-16", errors="replace")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")  # so that names that differ stay different


def _float(word: str) -> float:
    """The number that a word is, also one with a decimal comma."""
    if "_" in word or not word.isascii():  # a typing error, but a number to Python
        raise ValueError
    return float(word.replace(",", ".") if "," in word else word)


def _seconds(word: str) -> float:
    """Seconds since 1970 of a date and time in ISO 8601, in UTC unless it says otherwise."""
    moment = datetime.fromisoformat(word.strip())
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def number(name: str, text: str, convert: Callable[[str], float] = _float, hint: str = "") -> float:
    """The number that a text is; a ValueError names what it should be."""
    try:
        return convert(text)
    except ValueError:
        raise ValueError(f"{name} must be a number, but is {brief(repr(text))}{hint}") from None


def plain_name(name: str) -> str:
    """A column's name in small letters, with _ for spaces and for brackets around a unit."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_") or name.strip().lower()


# ---- The targets of logs


def valid(columns: Mapping[str, Array]) -> Mask:
    """Mask of the targets that have all numbers, and a place that is not the sensor's."""
    away = (
        columns["range"] > 0.0 if "range" in columns else (columns["x"] != 0) | (columns["y"] != 0)
    )
    return np.asarray(away & np.isfinite(np.stack([*columns.values()])).all(axis=0))


def select(
    where: str,
    what: str,
    columns: dict[str, Array],
    kept: Mask,
    sigmas: dict[str, float],
    min_snr: float | None,
) -> tuple[dict[str, Array], Mask]:
    """The columns with the standard deviations of all targets, and a mask of the targets to use.

    Warnings count what is not ``kept``, and tell of standard deviations that are not known: usual
    ones are taken, although Doppler velocities may be rounded to steps for which these are small.
    """
    lost, used = int((~kept).sum()), kept
    if lost:
        warnings.warn(
            f"{where}: {lost} of {len(kept)} {what} are left out, because a number is missing or "
            "not finite, or the range is not positive",
            stacklevel=3,
        )
    if min_snr is not None:
        if "snr" not in columns:
            raise ValueError(f"{where} has no column snr, which min_snr needs")
        used = kept & (columns["snr"] >= FINITE.number("min_snr", min_snr))
    taken = {name: sigma for name, sigma in USUAL.items() if name not in columns.keys() | sigmas}
    if taken:
        distinct = np.unique(np.round(columns["doppler"][kept], 6))
        steps = np.diff(distinct) if 1 < len(distinct) < kept.sum() / 10 else np.zeros(1)
        step, rounded = steps.min(), ""
        if step / math.sqrt(12.0) > taken.get("sigma_doppler", math.inf):
            rounded = (
                f"; Doppler velocities come in steps of {step:.3g} m/s, so that --sigma-doppler "
                f"must be at least {step / math.sqrt(12.0):.2g}"
            )
        warnings.warn(
            f"{where} has no {', '.join(sorted(taken))}: usual values are taken out of 0.15 m, 0.5 "
            "deg, 0.06 m/s; --sigma-range, --sigma-azimuth and --sigma-doppler state those of your "
            f"radar, on which the covariances rest{rounded}",
            stacklevel=3,
        )
    stated = {name: np.full(len(kept), sigma) for name, sigma in (sigmas | taken).items()}
    return columns | stated, used


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
