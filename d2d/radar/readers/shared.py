"""Options of loaders, selection of targets, and errors that name a file."""

import json
import os
import stat
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from d2d._checks import SECONDS, check_count, check_finite
from d2d._types import Array

MICROSECOND = 1e-6  # s
_OFFSET = SECONDS._replace(most=10.0)  # s, of a radar's clock
_LARGEST = 2**53  # that float64 holds exactly: 285 years in microseconds


@dataclass(frozen=True)
class TargetOptions:
    """Options of the loaders of data sets that do not give standard deviations."""

    strongest: int | None
    time_offset: float
    sigma_range: float
    sigma_azimuth: float | Callable[[Array], ArrayLike]
    sigma_doppler: float
    extent: float

    def __post_init__(self) -> None:
        if self.strongest is not None:
            check_count("strongest", self.strongest)
        _OFFSET.number("time_offset", self.time_offset)

    def kept(self, good: NDArray[np.bool_], cross_section: NDArray[Any]) -> NDArray[np.intp]:
        """Indices of the good targets, of the strongest only if there are more, in their order."""
        keep = np.flatnonzero(good)
        if self.strongest is None or len(keep) <= self.strongest:
            return keep
        order = np.argsort(-cross_section[keep], kind="stable")
        return np.asarray(keep[np.sort(order[: self.strongest])])

    def errors(self, azimuth: Array) -> dict[str, Any]:
        """Arguments of a scan whose targets are at these azimuths (K,)."""
        sigma = self.sigma_azimuth
        given = {name: getattr(self, name) for name in ("sigma_range", "sigma_doppler", "extent")}
        return given | {"sigma_azimuth": sigma(azimuth) if callable(sigma) else sigma}


def yaw_of(w: Array, x: Array, y: Array, z: Array) -> Array:
    """Direction (...) of the x axis in the plane, of quaternions that need not be normalised.

    Raises a ``ValueError`` if one is zero.
    """
    size = np.abs([w, x, y, z]).max(axis=0)
    if not np.all(size > 0.0):
        raise ValueError("a quaternion must not be zero")
    w, x, y, z = (part / size for part in (w, x, y, z))
    return np.asarray(np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z))


def existing(folder: Path, name: str, what: str) -> Path:
    """The path of a file or folder; raises a FileNotFoundError that says ``what`` it should be.

    Raises a ValueError if the name, which a file may have given, leads out of the folder.
    """
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


def brief(text: object, most: int = 300) -> str:
    """A text in one line, of which a part is left out if it has more than ``most`` characters."""
    line = " ".join(str(text).splitlines())
    return line if len(line) <= most else f"{line[: most - 40]} ... {line[-35:]}"


def whole_number(name: str, value: object) -> int:
    """A whole number of a JSON file; raises a ValueError if it is something else."""
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError(f"{name} must be a whole number, but is {brief(repr(value))}")
    if abs(value) > _LARGEST:
        raise ValueError(f"{name} must be at most {_LARGEST}, but is larger")
    return value


def real_numbers(name: str, values: object, count: int) -> list[float]:
    """A list of so many real numbers of a JSON file; raises a ValueError if it is another."""
    if not isinstance(values, list) or any(isinstance(value, bool) for value in values):
        raise ValueError(f"{name} must be {count} numbers, but is {brief(repr(values))}")
    return [float(value) for value in check_finite(name, values, f"({count},)")]


@contextmanager
def reading(path: Path, what: str) -> Iterator[None]:
    """Re-raise whatever goes wrong inside as a ValueError that says which file is not ``what``."""
    try:
        yield
    except (OSError, ValueError) as error:
        raise ValueError(f"{path} is not {what}: {brief(error)}") from None
    except (
        *(ArithmeticError, AttributeError, LookupError, MemoryError, RuntimeError, TypeError),
        *(EOFError, zlib.error, ImportError),
    ) as error:
        raise ValueError(f"{path} is not {what} ({brief(repr(error))})") from None
