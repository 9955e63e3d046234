"""What public functions ask of their arguments; every message names the argument."""

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
T = TypeVar("T")

# Of matrices that are symmetric but for rounding, relative to the variances: float32 has 1e-7.
_ASYMMETRY = 1e-6


def real(name: str, value: ArrayLike) -> Array:
    """A float64 copy of ``value``, which may hold nan or inf."""
    try:
        raw = np.asarray(value)
    except ValueError as error:
        raise ValueError(f"{name} must be an array of real numbers: {error}") from None
    if raw.dtype.kind not in "biuf":
        raise ValueError(f"{name} must be an array of real numbers, but is of type {raw.dtype}")
    if isinstance(value, np.ma.MaskedArray) and np.any(value.mask):
        raise ValueError(f"{name} must not hold masked entries: leave them out")
    return raw.astype(np.float64)


def finite(name: str, value: ArrayLike) -> Array:
    """A float64 copy of ``value`` without nan or inf."""
    array = real(name, value)
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite, but holds nan or inf")
    return array


def positive(name: str, value: ArrayLike) -> Array:
    """A finite array of numbers above zero."""
    array = finite(name, value)
    if not (array > 0).all():
        raise ValueError(f"{name} must be positive, but holds {array.min():g}")
    return array


def count(name: str, value: Any, least: int = 1) -> int:
    """An integer of at least ``least``."""
    if not isinstance(value, int | np.integer) or value < least:
        raise ValueError(f"{name} must be an integer of at least {least}, but is {value!r}")
    return int(value)


def flag(name: str, value: Any) -> bool:
    """True or False, and nothing that merely counts as one of them."""
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{name} must be True or False, but is {value!r}")
    return bool(value)


def as_path(name: str, value: str | os.PathLike[str]) -> Path:
    """A path, in which ``~`` stands for the home folder."""
    if not isinstance(value, str | os.PathLike):
        raise ValueError(f"{name} must be a path, but is {value!r}")
    return Path(os.path.expanduser(value))


def instance(name: str, value: object, kind: type) -> None:
    """Raise a ValueError unless ``value`` is of that kind."""
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        raise ValueError(
            f"{name} must be {article} {kind.__name__}, but is a {type(value).__name__}"
        )


def members(name: str, value: Iterable[T], kind: type) -> list[T]:
    """A list of what an iterable holds, all of that kind."""
    if not isinstance(value, Iterable):
        raise ValueError(f"{name} must be a sequence, but is a {type(value).__name__}")
    listed = list(value)
    for number, member in enumerate(listed):
        instance(f"{name}[{number}]", member, kind)
    return listed


def rows(name: str, value: Iterable[T], *kinds: type) -> list[T]:
    """A list of the tuples that an iterable holds, their members of these kinds in this order."""
    listed = members(name, value, object)
    for number, row in enumerate(listed):
        which = f"{name}[{number}]"
        if not isinstance(row, tuple | list) or len(row) != len(kinds):
            wanted = ", ".join(kind.__name__ for kind in kinds)
            length = f" of length {len(row)}" if isinstance(row, tuple | list) else ""
            raise ValueError(
                f"{which} must be a tuple ({wanted}), but is a {type(row).__name__}{length}"
            )
        for place, (member, kind) in enumerate(zip(row, kinds, strict=True)):
            instance(f"{which}[{place}]", member, kind)
    return listed


def schedule(name: str, value: ArrayLike) -> Array:
    """One or more positive numbers in a row."""
    steps = positive(name, value)
    if steps.ndim != 1 or not steps.size:
        raise ValueError(f"{name} must be a sequence of numbers, but has the shape {steps.shape}")
    return steps


def fraction(name: str, value: float) -> float:
    """A number within [0, 1]."""
    number = scalar(name, value)
    if not 0 <= number <= 1:
        raise ValueError(f"{name} must lie within [0, 1], but is {number:g}")
    return number


def scalar(name: str, value: Any) -> float:
    """A finite number."""
    array = finite(name, value)
    if array.ndim:
        raise ValueError(f"{name} must be a number, but has the shape {array.shape}")
    return float(array)


def covariance_matrices(name: str, value: ArrayLike) -> Array:
    """Finite, symmetric, positive definite matrices (..., D, D) with D = 1, 2 or more."""
    array = finite(name, value)
    if array.ndim < 2 or array.shape[-1] != array.shape[-2]:
        raise ValueError(f"{name} must have the shape (..., D, D), but has {array.shape}")
    symmetrise(name, array)
    if not positive_definite(array):
        raise ValueError(f"{name} must be positive definite")
    return array


def symmetrise(name: str, array: Array) -> None:
    """Make matrices (..., D, D) exactly symmetric that are so but for rounding, in place."""
    for i in range(array.shape[-1]):
        for j in range(i):
            above, below = array[..., j, i], array[..., i, j]
            gap = np.abs(above - below)
            size = np.sqrt(np.abs(array[..., i, i] * array[..., j, j])) + np.abs(below)
            if not (gap <= _ASYMMETRY * size).all():
                worst = np.unravel_index(np.argmax(gap - _ASYMMETRY * size), gap.shape)
                raise ValueError(
                    f"{name} must be symmetric, but entry ({j}, {i}) of a matrix differs from "
                    f"entry ({i}, {j}) by {gap[worst]:.1e}, with {below[worst]:.3g} there"
                )
            array[..., i, j] = array[..., j, i] = 0.5 * (above + below)


def positive_definite(array: Array) -> bool:
    """Whether all symmetric matrices (..., D, D) are positive definite."""
    if array.shape[-1] == 2:  # in closed form: point sets are built within a few microseconds
        xx, xy, yy = array[..., 0, 0], array[..., 0, 1], array[..., 1, 1]
        return bool(((xx > 0) & (yy > 0) & (xx * yy - xy * xy > 0)).all())
    try:
        np.linalg.cholesky(array)
    except np.linalg.LinAlgError:
        return False
    return True


def broadcast(name: str, *shapes: tuple[int, ...]) -> tuple[int, ...]:
    """The common batch shape; a ValueError says which arguments do not fit together."""
    try:
        return np.broadcast_shapes(*shapes)
    except ValueError:
        listed = ", ".join(map(str, shapes))
        raise ValueError(f"the batch axes of {name} do not broadcast: {listed}") from None
