"""Files of data sets, numbers in them, and standard deviations of targets."""

import json
import os
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from d2d._checks import SECONDS, check_count, check_finite
from d2d._types import Array
from d2d.radar.files import brief

MICROSECOND = 1e-6  # s
OFFSET = SECONDS._replace(most=10.0)  # s, of a radar's clock
_LARGEST = 2**53  # that float64 holds exactly: 285 years in microseconds


def strongest_of(
    good: NDArray[np.bool_], cross_section: NDArray[Any], strongest: int | None
) -> NDArray[np.intp]:
    """Indices of the good targets in their order, at most so many, the strongest."""
    keep = np.flatnonzero(good)
    if strongest is None:
        return keep
    order = np.argsort(-cross_section[keep], kind="stable")
    return np.asarray(keep[np.sort(order[: check_count("strongest", strongest)])])


def errors_at(azimuth: Array, errors: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of a `RadarScan`: usual errors, or others, also functions of the azimuth (K,)."""
    given = {"sigma_range": 0.15, "sigma_doppler": 0.06, "extent": 0.1, **errors}
    return {name: error(azimuth) if callable(error) else error for name, error in given.items()}


def yaw_of(w: Array, x: Array, y: Array, z: Array) -> Array:
    """Direction (...) of the x axis in the plane, of quaternions that need not be normalised."""
    size = np.abs([w, x, y, z]).max(axis=0)
    if not np.all(size > 0.0):
        raise ValueError("a quaternion must not be zero")
    w, x, y, z = (part / size for part in (w, x, y, z))
    return np.asarray(np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z))


def existing(folder: Path, name: str, what: str) -> Path:
    """The path of a file or folder, which must exist; ``what`` it should be is for messages."""
    if os.path.isabs(name) or ".." in Path(name).parts or "\0" in name:
        raise ValueError(f"{brief(name)} must be {what}, but is not a name inside {folder}")
    path = folder / name
    if not os.path.exists(path):  # Path.exists() raises an error if the name is too long
        raise FileNotFoundError(f"{brief(path)} does not exist; it should be {what}")
    return path


def content_of(path: Path) -> Any:
    """Read a JSON file."""
    return json.loads(bytes_of(path).decode("utf-8"))


def bytes_of(path: Path) -> bytes:
    """The content of a file or a pipe; a ValueError names what is neither, or cannot be read."""
    mode = os.stat(path).st_mode
    if not (stat.S_ISREG(mode) or stat.S_ISFIFO(mode)):  # a device may never end
        raise ValueError(f"{path} is a folder or a device, but must be a file")
    try:
        return path.read_bytes()
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {error.strerror}") from None


def whole_number(name: str, value: object) -> int:
    """A whole number of a JSON file; raises a ValueError if it is something else."""
    if isinstance(value, bool) or not isinstance(value, int) or abs(value) > _LARGEST:
        raise ValueError(f"{name} must be a whole number, but is {brief(repr(value))}")
    return value


def real_numbers(name: str, values: object, count: int) -> list[float]:
    """A list of so many real numbers of a JSON file; raises a ValueError if it is another."""
    if not isinstance(values, list) or any(isinstance(value, bool) for value in values):
        raise ValueError(f"{name} must be {count} numbers, but is {brief(repr(values))}")
    return [float(value) for value in check_finite(name, values, f"({count},)")]
