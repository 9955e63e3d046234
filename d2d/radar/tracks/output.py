"""The files of a track: arrays that load bit by bit, and a table of numbers as CSV."""

import csv
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from d2d._types import Array
from d2d.radar.files import atomic_write

Arrays = dict[str, NDArray[Any]]

# The fields of a track.
REQUIRED = ("times", "intervals", "theta", "covariance", "converged")
OPTIONAL = ("reasons", "targets", "inliers", "errors")
TYPES = {
    "converged": np.bool_,
    "guessed": np.bool_,
    "reasons": np.str_,
    "targets": np.int64,
}  # others are floats
_MARK, _FORMAT = "format", "d2d.radar.Track 2"
_IN_TABLES = OPTIONAL[:-1]
# The entries of a covariance that are written: the upper triangle.
_UPPER = np.triu_indices(3)
_VELOCITY = ("time", "interval", "v_x", "v_y", "omega", "converged")
_ENTRIES = ("var_v_x", "cov_v_x_v_y", "cov_v_x_omega", "var_v_y", "cov_v_y_omega", "var_omega")
_COLUMNS = _VELOCITY + _ENTRIES


def save_fields(path: Path, fields: Mapping[str, Any]) -> None:
    """Write the fields of a track that are known as a compressed npz file."""
    arrays: dict[str, Any] = {_MARK: np.array(_FORMAT)}
    arrays |= {n: fields[n] for n in (*REQUIRED, *OPTIONAL) if fields[n] is not None}
    with atomic_write(path) as file:
        np.savez_compressed(file, **arrays)


def load_fields(path: Path) -> dict[str, Any]:
    """The fields that `save_fields` wrote; raises a ValueError if the file is not one of it."""
    with path.open("rb") as raw:
        try:
            opened = np.load(raw, allow_pickle=False)
            if not isinstance(opened, np.lib.npyio.NpzFile):
                raise ValueError("it holds a single array")
            with opened as file:
                mark = str(file[_MARK])
                fields: dict[str, Any] = {name: file[name] for name in file.files}
        except Exception as error:  # damaged bytes raise errors of zipfile, zlib or NumPy
            raise ValueError(f"{path} is not a complete file of Track.save ({error!r})") from None
    if mark != _FORMAT:
        raise ValueError(f"{path} has the format {mark!r}, but this version reads {_FORMAT!r}")
    del fields[_MARK]
    for names, said in (
        ({*REQUIRED} - fields.keys(), "lacks"),
        (fields.keys() - {*REQUIRED, *OPTIONAL}, "also holds"),
    ):
        if names:
            raise ValueError(
                f"{path} is not a complete file of Track.save: it {said} {sorted(names)}"
            )
    return fields


def table_columns(fields: Mapping[str, Any]) -> Arrays:
    """The columns (n,) of a table, by their names, from a track's fields and ``guessed``.

    Reasons, targets and inliers follow where they are known.
    """
    times, intervals, theta, covariance, converged = (fields[name] for name in REQUIRED)
    entries = covariance[:, _UPPER[0], _UPPER[1]].T
    columns = dict(zip(_COLUMNS, [times, intervals, *theta.T, converged, *entries], strict=True))
    columns["guessed"] = fields["guessed"]
    return columns | {name: fields[name] for name in _IN_TABLES if fields[name] is not None}


def write_table(path: Path, fields: Mapping[str, Any]) -> None:
    """Write the columns as CSV, each number with all its digits."""
    columns = table_columns(fields)
    with atomic_write(path) as raw:
        file = io.TextIOWrapper(raw, encoding="utf-8", newline="")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*(column.tolist() for column in columns.values()), strict=True))
        file.detach()


def read_table(path: Path) -> dict[str, Any]:
    """The fields that `write_table` wrote; raises a ValueError that names a wrong line."""
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        rows = csv.reader(file)
        names = [name.strip() for name in next(rows, [])]
        columns: dict[str, list[Any]] = {name: [] for name in names}
        missing = [name for name in _COLUMNS if name not in columns]
        if missing:
            raise ValueError(f"{path} is not a table of velocities: it lacks {', '.join(missing)}")
        for row in filter(None, rows):
            try:
                if len(row) != len(names):
                    raise ValueError(f"there must be {len(names)} values, but are {len(row)}")
                for name, value in zip(names, row, strict=True):
                    columns[name].append(_parsed(name, value))
            except ValueError as error:
                raise ValueError(f"{path}, line {rows.line_num}: {error}") from None
    arrays: Arrays = {
        n: np.array(values, dtype=TYPES.get(n, np.float64)) for n, values in columns.items()
    }
    fields: dict[str, Any] = {
        "times": arrays["time"],
        "intervals": arrays["interval"],
        "theta": np.column_stack([arrays[name] for name in _VELOCITY[2:5]]),
        "covariance": _matrices(arrays),
        "converged": arrays["converged"],
    }
    return fields | {name: arrays[name] for name in _IN_TABLES if name in arrays}


def _parsed(name: str, value: str) -> object:
    """A value of a table; an empty one is not known, as pandas writes it."""
    if name == "reasons":
        return value
    if TYPES.get(name) is np.bool_:
        if value not in ("True", "False"):
            raise ValueError(f"{name} must be True or False, but is {value}")
        return value == "True"
    return int(value) if name == "targets" else float(value or "nan")


def _matrices(arrays: Arrays) -> Array:
    """Covariances (n, 3, 3) from the columns of their upper triangles."""
    entries = np.array([arrays[entry] for entry in _ENTRIES])
    matrices = np.empty((entries.shape[1], 3, 3))
    matrices[:, _UPPER[0], _UPPER[1]] = matrices[:, _UPPER[1], _UPPER[0]] = entries.T
    return matrices


def write_poses(path: Path, times: Array, poses: Array) -> None:
    """Write poses (n, 3) as a TUM trajectory file, one line "t x y z qx qy qz qw" each."""
    x, y, yaw = poses.T
    zero = np.zeros_like(x)
    columns = [times, x, y, zero, zero, zero, np.sin(0.5 * yaw), np.cos(0.5 * yaw)]
    with atomic_write(path) as file:
        np.savetxt(file, np.column_stack(columns), "%.9f")
