"""What public functions ask of their arguments; every message names the argument."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def real(name: str, value: ArrayLike) -> Array:
    """A float64 copy of ``value``, which may hold nan or inf."""
    try:
        raw = np.asarray(value)
    except ValueError as error:
        raise ValueError(f"{name} must be an array of real numbers: {error}") from None
    if raw.dtype.kind not in "biuf":
        raise ValueError(f"{name} must be an array of real numbers, but is of type {raw.dtype}")
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


def count(name: str, value: Any) -> int:
    """An integer of at least 1."""
    if not isinstance(value, int | np.integer) or value < 1:
        raise ValueError(f"{name} must be an integer of at least 1, but is {value!r}")
    return int(value)


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
    for i in range(array.shape[-1]):
        for j in range(i):
            above, below = array[..., j, i], array[..., i, j]
            size = np.sqrt(np.abs(array[..., i, i] * array[..., j, j]))
            if not (np.abs(above - below) <= 1e-9 * size).all():
                raise ValueError(f"{name} must be symmetric")
            array[..., i, j] = array[..., j, i] = 0.5 * (above + below)
    if not positive_definite(array):
        raise ValueError(f"{name} must be positive definite")
    return array


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
