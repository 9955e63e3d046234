"""The files of a track: arrays that load bit by bit, and a table of velocities as text."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from d2d.radar.files import written_whole
from d2d.radar.scans.budget import CovarianceParts

Arrays = dict[str, NDArray[Any]]

# The fields of a track, apart from the parts of its covariance.
REQUIRED = ("times", "intervals", "theta", "covariance", "converged")
OPTIONAL = ("reasons", "targets", "inliers")
_MARK, _FORMAT = "format", "d2d.radar.Track 1"
_PARTS = tuple(f"parts_{name}" for name in CovarianceParts._fields)
# The entries of a covariance that are written: the upper triangle.
_UPPER = np.triu_indices(3)
COLUMNS = {
    "time": "s",
    "interval": "s",
    "v_x": "m/s",
    "v_y": "m/s",
    "omega": "rad/s",
    "converged": "0/1",
    "var_v_x": "m^2/s^2",
    "cov_v_x_v_y": "m^2/s^2",
    "cov_v_x_omega": "m*rad/s^2",
    "var_v_y": "m^2/s^2",
    "cov_v_y_omega": "m*rad/s^2",
    "var_omega": "rad^2/s^2",
}
_ENTRIES = list(COLUMNS)[6:]
PART_COLUMNS = {
    f"{part}_{name}": COLUMNS[name] for part in CovarianceParts._fields for name in _ENTRIES
}
_TITLE = "# Velocities of a vehicle and their covariances, written by d2d, format"
_EXPLAINED = (
    "# v_x forward and v_y left of the vehicle frame's origin, omega counter-clockwise. Where",
    "# converged is 0, the covariance is nan and the velocity is the last one that was accepted.",
)
_OF_PARTS = (
    "# The covariance is the sum of three parts. To a filter, noise and dependence are white: new",
    "# in each estimate. The systematic part stays for 10 to 20 s on the road: it belongs in the",
    "# filter's state, as a random walk or a decaying error of that length.",
)


def save_fields(path: Path, fields: Mapping[str, Any]) -> None:
    """Write the fields of a track that are known as a compressed npz file."""
    arrays: dict[str, Any] = {_MARK: np.array(_FORMAT)}
    for name in (*REQUIRED, *OPTIONAL):
        if fields[name] is not None:
            arrays[name] = fields[name]
    if fields["parts"] is not None:
        arrays |= zip(_PARTS, fields["parts"], strict=True)
    with written_whole(path) as file:
        np.savez_compressed(file, **arrays)


def load_fields(path: Path) -> dict[str, Any]:
    """The fields that `save_fields` wrote; raises a ValueError if the file is not complete."""
    with path.open("rb") as raw:
        try:
            opened = np.load(raw, allow_pickle=False)
            if not isinstance(opened, np.lib.npyio.NpzFile):
                raise ValueError("it holds a single array")
            with opened as file:
                known = {*REQUIRED, *OPTIONAL, *_PARTS, _MARK}
                fields: dict[str, Any] = {name: file[name] for name in known & {*file.files}}
            mark = str(fields.pop(_MARK))
        except Exception as error:  # damaged bytes raise errors of zipfile, zlib or NumPy
            raise ValueError(f"{path} is not a complete file of Track.save ({error!r})") from None
    if mark != _FORMAT:
        raise ValueError(f"{path} has the format {mark!r}, but this version reads {_FORMAT!r}")
    with_parts = any(name in fields for name in _PARTS)
    missing = {*REQUIRED, *(_PARTS if with_parts else ())} - fields.keys()
    if missing:
        raise ValueError(f"{path} is not a complete file of Track.save: it lacks {sorted(missing)}")
    if with_parts:
        fields["parts"] = CovarianceParts(*(fields.pop(name) for name in _PARTS))
    return fields


def velocity_columns(fields: Mapping[str, Any]) -> Arrays:
    """The columns (n,) of a table of velocities, named as in `COLUMNS`, from a track's fields.

    Those of `PART_COLUMNS` follow if the parts of the covariance are known.
    """
    times, intervals, theta, covariance, converged = (fields[name] for name in REQUIRED)
    entries = covariance[:, _UPPER[0], _UPPER[1]].T
    columns = dict(zip(COLUMNS, [times, intervals, *theta.T, converged, *entries], strict=True))
    if fields["parts"] is not None:
        parts = np.stack(fields["parts"])[:, :, _UPPER[0], _UPPER[1]].swapaxes(1, 2)
        columns |= zip(PART_COLUMNS, parts.reshape(len(PART_COLUMNS), len(times)), strict=True)
    return columns


def write_velocity_table(path: Path, fields: Mapping[str, Any]) -> None:
    """Write the columns as text, each number with all its digits."""
    columns = velocity_columns(fields)
    lists = [
        column.astype(int).tolist() if column.dtype == np.bool_ else column.tolist()
        for column in columns.values()
    ]
    units = " ".join(f"{name}[{(COLUMNS | PART_COLUMNS)[name]}]" for name in columns)
    whole = len(columns) == len(COLUMNS)
    header = (f"{_TITLE} {1 if whole else 2}", *_EXPLAINED, *(() if whole else _OF_PARTS))
    rows = (" ".join(map(repr, row)) for row in zip(*lists, strict=True))
    end = _end(len(lists[0]))
    with written_whole(path) as file:
        for line in (*header, f"# {units}", *rows, end):
            file.write(f"{line}\n".encode())


def read_velocity_table(path: Path) -> dict[str, Any]:
    """The fields that `write_velocity_table` wrote; raises a ValueError that names a wrong line."""
    lines = path.read_text(encoding="utf-8-sig", errors="replace").rstrip().splitlines()
    title = next((line.rstrip() for line in lines if line.strip()), "")
    widths = {f"{_TITLE} 1": len(COLUMNS), f"{_TITLE} 2": len(COLUMNS) + len(PART_COLUMNS)}
    width = widths.get(title)
    if width is None:
        raise ValueError(f"{path} is not a table of velocities: line 1 must be '{_TITLE} 1' or 2")
    rows = []
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.startswith("#"):
            continue
        rows.append(_row(line.split(), width, f"{path}, line {number}"))
    if lines[-1].rstrip() != _end(len(rows)):
        raise ValueError(
            f"{path} is not complete: its last line must be {_end(len(rows))!r} after as many rows"
        )
    table = np.array(rows).reshape(-1, width)
    entries = table[:, 6:].reshape(len(table), width // 6 - 1, 6).swapaxes(0, 1)
    matrices = np.empty((len(entries), len(table), 3, 3))
    matrices[..., _UPPER[0], _UPPER[1]] = matrices[..., _UPPER[1], _UPPER[0]] = entries
    covariance, *parts = matrices
    return {
        "times": table[:, 0].copy(),
        "intervals": table[:, 1].copy(),
        "theta": table[:, 2:5].copy(),
        "covariance": covariance,
        "converged": table[:, 5] > 0.0,
        "parts": CovarianceParts(*parts) if parts else None,
    }


def _row(words: list[str], width: int, where: str) -> list[float]:
    if len(words) != width:
        raise ValueError(f"{where}: there must be {width} numbers, but are {len(words)}")
    try:
        row = [float(word) for word in words]
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None
    if row[5] not in (0.0, 1.0):
        raise ValueError(f"{where}: converged must be 0 or 1, but is {words[5]}")
    return row


def _end(count: int) -> str:
    """The last line, by which a file that was cut off is recognised."""
    return f"# end of {count} estimates"
