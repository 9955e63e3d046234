"""Bounds and checks of the arguments of public functions; every message names the argument."""

import math
import os
from collections.abc import Collection, Iterable, Mapping
from dataclasses import field, fields
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from d2d._kernel.layout import SINGULAR
from d2d._types import Array

T = TypeVar("T")
_PLAIN = float, int, str, np.generic  # entries of a sequence, none of which is an array


def check_real(name: str, value: ArrayLike) -> Array:
    """A float64 copy of ``value``; nan and inf are allowed."""
    if type(value) is not np.ndarray and is_masked(value):
        raise ValueError(f"{name} must not hold masked entries; remove them first")
    try:
        raw = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must be an array of real numbers: {error}") from None
    if raw.dtype.kind not in "biuf":
        raise ValueError(f"{name} must be an array of real numbers, but is of type {raw.dtype}")
    return raw.astype(np.float64)


def is_masked(value: object) -> bool:
    """Whether an array, or one in a sequence, has masked entries, which NumPy would fill in."""
    if isinstance(value, list | tuple):
        plain = all(issubclass(kind, _PLAIN) for kind in {*map(type, value)})
        return not plain and any(map(is_masked, value))
    return bool(np.ma.is_masked(value))


class Bounds(NamedTuple):
    """Bounds of finite numbers, and the hint for those that are too large."""

    above: float = -math.inf
    least: float = -math.inf
    most: float = math.inf  # of the magnitude
    unit: str = ""  # in which they must be
    hint: str = ""  # the unit in which they may be instead

    def array(self, name: str, values: ArrayLike) -> Array:
        """A float64 copy of ``values``; a ``ValueError`` says which bound is broken."""
        array = check_real(name, values)
        if not array.size:
            return array
        few = array.ravel().tolist() if array.size <= 8 else [math.nan]
        if math.isfinite(sum(few)):  # a third of the time, for each motion
            low, high = min(few), max(few)
        else:
            low, high = float(array.min()), float(array.max())
        if not (math.isfinite(low) and math.isfinite(high)):
            raise ValueError(f"{name} must be finite, but holds nan or inf")
        if low <= self.above:
            wanted, found = ("positive" if self.above == 0.0 else f"above {self.above:g}"), low
        elif max(high, -low) > self.most:
            wanted = f"{self.unit}at most {self.most:g}"
            found = high if high > self.most else low
        elif low < self.least:
            wanted, found = f"at least {self.least:g}", low
        else:
            return array
        hint = self.hint if abs(found) > self.most else ""
        verb = "holds" if array.ndim else "is"
        raise ValueError(f"{name} must be {wanted}, but {verb} {found:g}{hint}")

    def number(self, name: str, value: Any) -> float:
        """A single number, as a float."""
        common = type(value) is float and self.above < value >= self.least
        if common and abs(value) <= self.most and math.isfinite(value):
            return float(value)  # without NumPy: every pair of scans comes here several times
        array = self.array(name, value)
        if array.ndim:
            raise ValueError(f"{name} must be a number, but has the shape {array.shape}")
        return float(array)

    def hold(self, values: Array) -> NDArray[np.bool_]:
        """Mask (...) of the values that are finite and within the bounds."""
        within = (values > self.above) & (values >= self.least) & (np.abs(values) <= self.most)
        return within & np.isfinite(values)


FINITE = Bounds()
POSITIVE = Bounds(above=0.0)
NOT_NEGATIVE = Bounds(least=0.0)
SCALE = Bounds(least=1e-50, most=1e50)  # of which squares and inverses are finite
METRES = Bounds(unit="in m, ", hint="; are these millimetres?")
SECONDS = Bounds(unit="in seconds (s), ", hint="; are these milliseconds?")
# beyond a full turn, which float32 rounds up, an angle is taken to be in degrees
ANGLE = Bounds(
    most=2.0 * math.pi * (1.0 + 1e-6), unit="in radians (rad), ", hint="; are these degrees?"
)


def number(default: float, bounds: Bounds = FINITE) -> float:
    """A field of a dataclass that derives from `Bounded`."""
    return field(default=default, metadata={"bounds": bounds})


class Bounded:
    """Base of frozen dataclasses, which checks each field that `number` declares."""

    def __post_init__(self) -> None:
        for each in fields(self):  # type: ignore[arg-type] # a subclass is a dataclass
            if "bounds" in each.metadata:
                value = each.metadata["bounds"].number(each.name, getattr(self, each.name))
                object.__setattr__(self, each.name, value)


check_positive, check_positive_scalar = POSITIVE.array, POSITIVE.number
check_fraction = Bounds(least=0.0, most=1.0).number

# Asymmetry that passes for rounding, relative to the variances; float32 leaves some 1e-7.
_ASYMMETRY = 1e-6


def check_count(name: str, value: Any, minimum: int = 1) -> int:
    """An integer of at least ``minimum``; True and False are refused."""
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not whole or value < minimum:
        raise ValueError(f"{name} must be an integer of at least {minimum}, but is {value!r}")
    return int(value)


def check_flag(name: str, value: Any) -> bool:
    """True or False; other values are refused, even 0 and 1."""
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{name} must be True or False, but is {value!r}")
    return bool(value)


def check_choice(name: str, value: Any, choices: Collection[str]) -> None:
    """Raise a ValueError unless ``value`` is a string, and one of the choices."""
    if not isinstance(value, str) or value not in choices:
        raise ValueError(f"{name} must be one of {', '.join(choices)}, but is {value!r}")


def check_path(name: str, value: str | os.PathLike[str]) -> Path:
    """A path, with a leading ``~`` replaced by the home folder."""
    if not isinstance(value, str | os.PathLike):
        raise ValueError(f"{name} must be a path, but is {value!r}")
    return Path(os.path.expanduser(value))


def check_instance(name: str, value: object, kind: type, *, optional: bool = False) -> None:
    """Raise a ValueError unless ``value`` is an instance of ``kind`` or, if ``optional``, None."""
    if not isinstance(value, kind) and not (optional and value is None):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        raise ValueError(
            f"{name} must be {article} {kind.__name__}, but is a {type(value).__name__}"
        )


def check_members(name: str, value: Iterable[T], kind: type) -> list[T]:
    """The members of an iterable as a list, each checked to be an instance of ``kind``."""
    if not isinstance(value, Iterable):
        raise ValueError(f"{name} must be a sequence, but is a {type(value).__name__}")
    listed = list(value)
    for number, member in enumerate(listed):
        check_instance(f"{name}[{number}]", member, kind)
    return listed


def check_mapping(name: str, value: Mapping[Any, T], kind: type) -> dict[Any, T]:
    """A mapping as a dict, each value checked to be an instance of ``kind``."""
    check_instance(name, value, Mapping)
    for key, member in value.items():
        check_instance(f"{name}[{key!r}]", member, kind)
    return dict(value)


def check_rows(name: str, value: Iterable[T], *kinds: type) -> list[T]:
    """The tuples in an iterable as a list, each checked to hold one instance per kind, in order."""
    listed = check_members(name, value, object)
    for number, row in enumerate(listed):
        which = f"{name}[{number}]"
        if not isinstance(row, tuple | list) or len(row) != len(kinds):
            wanted = ", ".join(kind.__name__ for kind in kinds)
            length = f" of length {len(row)}" if isinstance(row, tuple | list) else ""
            raise ValueError(
                f"{which} must be a tuple ({wanted}), but is a {type(row).__name__}{length}"
            )
        for place, (member, kind) in enumerate(zip(row, kinds, strict=True)):
            check_instance(f"{which}[{place}]", member, kind)
    return listed


def check_schedule(name: str, value: ArrayLike) -> tuple[float, ...]:
    """One or more numbers from 1e-50 to 1e50."""
    if isinstance(value, tuple) and value == (1.0,):
        return (1.0,)
    steps = SCALE.array(name, value)
    if steps.ndim != 1 or not steps.size:
        raise ValueError(f"{name} must be a sequence of numbers, but has the shape {steps.shape}")
    return tuple(steps.tolist())


def check_tail(confidence: float) -> float:
    """The probability on either side of the central region of a ``confidence`` within (0, 1)."""
    tail = 0.5 * (1.0 - check_fraction("confidence", confidence))
    if not 0.0 < tail < 0.5:
        raise ValueError(f"confidence must lie within (0, 1), but is {confidence:g}")
    return tail


def check_finite(
    name: str, value: ArrayLike, *shapes: str, like: str = "", empty: bool = True
) -> Array:
    """A float64 copy of finite numbers, of one of the shapes if any are given: `check_shape`."""
    array = FINITE.array(name, value)
    if shapes:
        check_shape(name, array, *shapes, like=like, empty=empty)
    return array


def check_shape(
    name: str, array: NDArray[Any], *shapes: str, like: str = "", empty: bool = True
) -> None:
    """Raise a ValueError unless an array has one of the shapes, such as "(..., N, 2)".

    A letter stands for any length, the same wherever it is repeated, three dots for any axes.
    ``like`` is the argument that the shape must match.  If not ``empty``, no length may be zero.
    """
    if not any(_has_shape(array.shape, each) for each in shapes):
        wanted = " or ".join(shapes) + (f" to match {like}" if like else "")
        raise ValueError(f"{name} must have the shape {wanted}, but has {array.shape}")
    if not (empty or array.size):
        raise ValueError(f"{name} must not be empty, but has the shape {array.shape}")


@lru_cache(maxsize=256)
def _has_shape(shape: tuple[int, ...], wanted: str) -> bool:
    axes = wanted.strip("()").replace(",", " ").split()
    if axes[:1] == ["..."]:
        axes = axes[1:]
        shape = shape[max(len(shape) - len(axes), 0) :]
    lengths = {axis: int(axis) for axis in axes if axis.isdigit()}
    return len(shape) == len(axes) and all(
        length == lengths.setdefault(axis, length) for axis, length in zip(axes, shape, strict=True)
    )


def check_covariances(name: str, value: ArrayLike) -> Array:
    """Finite, symmetric, positive definite matrices (..., D, D) with D = 1, 2 or more."""
    array = check_finite(name, value, "(..., D, D)")
    symmetrise(name, array)
    if not is_positive_definite(array):
        raise ValueError(f"{name} must be positive definite")
    return array


def symmetrise(name: str, array: Array) -> None:
    """Make matrices (..., D, D) exactly symmetric in place; refuse more asymmetry than rounding."""
    for i in range(array.shape[-1]):
        for j in range(i):
            above, below = array[..., j, i], array[..., i, j]
            gap = np.abs(above - below)
            deviations = np.sqrt(np.abs(array[..., i, i])), np.sqrt(np.abs(array[..., j, j]))
            size = deviations[0] * deviations[1] + np.abs(below)
            if not (gap <= _ASYMMETRY * size).all():
                worst = np.unravel_index(np.argmax(gap - _ASYMMETRY * size), gap.shape)
                raise ValueError(
                    f"{name} must be symmetric, but entry ({j}, {i}) of a matrix differs from "
                    f"entry ({i}, {j}), which is {below[worst]:.3g}, by {gap[worst]:.1e}"
                )
            array[..., i, j] = array[..., j, i] = 0.5 * (above + below)


def is_positive_definite(array: Array) -> bool:
    """Whether all symmetric matrices (..., D, D) are positive definite, by more than rounding."""
    variances = np.diagonal(array, axis1=-2, axis2=-1)
    if not (variances > 0.0).all():
        return False
    sigmas = np.sqrt(variances)
    correlations = array / (sigmas[..., :, None] * sigmas[..., None, :])
    if array.shape[-1] == 2:  # in closed form, which is faster for many small ones
        return bool((1.0 - correlations[..., 0, 1] ** 2 > SINGULAR).all())
    return bool((np.linalg.eigvalsh(correlations)[..., 0] > SINGULAR).all())


def broadcast_batches(name: str, *shapes: tuple[int, ...]) -> tuple[int, ...]:
    """The common batch shape; raises a ValueError with all shapes if there is none."""
    try:
        return np.broadcast_shapes(*shapes)
    except ValueError:
        listed = ", ".join(map(str, shapes))
        raise ValueError(f"the batch axes of {name} do not broadcast: {listed}") from None
