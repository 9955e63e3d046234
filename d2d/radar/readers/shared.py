"""Options of loaders, selection of targets, and errors that name a file."""

import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from d2d._checks import SECONDS, check_count
from d2d._types import Array

MICROSECOND = 1e-6  # s
_OFFSET = SECONDS._replace(most=10.0)  # s, of a radar's clock


class Noise(NamedTuple):
    """Standard deviations that a data set does not give, as a loader takes them."""

    sigma_range: float
    sigma_azimuth: float | Callable[[Array], ArrayLike]
    sigma_doppler: float
    extent: float

    def at(self, azimuth: Array) -> dict[str, Any]:
        """Arguments of a scan whose targets are at these azimuths (K,)."""
        sigma = self.sigma_azimuth
        return self._asdict() | {"sigma_azimuth": sigma(azimuth) if callable(sigma) else sigma}


def check_options(strongest: int | None, time_offset: float) -> None:
    """Check what all loaders take and no scan checks."""
    if strongest is not None:
        check_count("strongest", strongest)
    _OFFSET.number("time_offset", time_offset)


def kept(
    good: NDArray[np.bool_], cross_section: NDArray[Any], strongest: int | None
) -> NDArray[np.intp]:
    """Indices of the good targets, of the ``strongest`` only if there are more, in their order."""
    keep = np.flatnonzero(good)
    if strongest is None or len(keep) <= strongest:
        return keep
    order = np.argsort(-cross_section[keep], kind="stable")
    return np.asarray(keep[np.sort(order[:strongest])])


def yaw_of(w: Array, x: Array, y: Array, z: Array) -> Array:
    """Direction (...) of the x axis in the plane, of quaternions that need not be normalised."""
    return np.asarray(np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z))


def existing(folder: Path, name: str, what: str) -> Path:
    """The path of a file or folder; raises a FileNotFoundError that says ``what`` it should be."""
    path = folder / name
    if not os.path.exists(path):  # Path.exists() raises an error if the name is too long
        raise FileNotFoundError(f"{path} does not exist; it should be {what}")
    return path


def content_of(path: Path) -> Any:
    """Read a JSON file."""
    return json.loads(path.read_text(encoding="utf-8"))


@contextmanager
def reading(path: Path, what: str) -> Iterator[None]:
    """Whatever goes wrong inside becomes a ValueError that says which file is not ``what``."""
    try:
        yield
    except (OSError, ValueError) as error:
        raise ValueError(f"{path} is not {what}: {error}") from None
    except (ArithmeticError, AttributeError, LookupError, RuntimeError, TypeError) as error:
        raise ValueError(f"{path} is not {what} ({error!r})") from None
