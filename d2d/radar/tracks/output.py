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
TYPES = {"converged": np.bool_, "reasons": np.str_, "targets": np.int64}  # others are floats
_MARK, _FORMAT = "format", "d2d.radar.Track 2"
_UPPER = np.triu_indices(3)
# The columns of a table; the last six are the upper triangle of the covariance.
_COLUMNS = (
    *("time", "interval", "v_x", "v_y", "omega", "converged", "var_v_x", "cov_v_x_v_y"),
    *("cov_v_x_omega", "var_v_y", "cov_v_y_omega", "var_omega"),
)


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
    missing, other = {*REQUIRED} - fields.keys(), fields.keys() - {*REQUIRED, *OPTIONAL}
    if missing or other:
        said = f"lacks {sorted(missing)}" if missing else f"also holds {sorted(other)}"
        raise ValueError(f"{path} is not a complete file of Track.save: it {said}")
    return fields


def table_columns(fields: Mapping[str, Any]) -> Arrays:
    """The columns (n,) of a table, by their names, from a track's fields and ``guessed``.

    Reasons, targets and inliers follow where they are known.
    """
    times, intervals, theta, covariance, converged = (fields[name] for name in REQUIRED)
    entries = covariance[:, _UPPER[0], _UPPER[1]].T
    columns = dict(zip(_COLUMNS, [times, intervals, *theta.T, converged, *entries], strict=True))
    known = [name for name in ("guessed", *OPTIONAL[:-1]) if fields[name] is not None]
    return columns | {name: fields[name] for name in known}


def write_table(path: Path, fields: Mapping[str, Any]) -> None:
    """Write the columns as CSV, each number with all its digits."""
    columns = table_columns(fields)
    with atomic_write(path) as raw:
        file = io.TextIOWrapper(raw, encoding="utf-8", newline="")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*(column.tolist() for column in columns.values()), strict=True))
        file.detach()


def write_poses(path: Path, times: Array, poses: Array) -> None:
    """Write poses (n, 3) as a TUM trajectory file, one line "t x y z qx qy qz qw" each."""
    x, y, yaw = poses.T
    zero = np.zeros_like(x)
    columns = [times, x, y, zero, zero, zero, np.sin(0.5 * yaw), np.cos(0.5 * yaw)]
    with atomic_write(path) as file:
        np.savetxt(file, np.column_stack(columns), "%.9f")
