"""Bounds of numbers and arrays, declared once and checked where they come in."""

import math
from dataclasses import field, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from d2d._types import Array


def check_real(name: str, value: ArrayLike) -> Array:
    """A float64 copy of ``value``; nan and inf are allowed."""
    try:
        raw = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must be an array of real numbers: {error}") from None
    if raw.dtype.kind not in "biuf":
        raise ValueError(f"{name} must be an array of real numbers, but is of type {raw.dtype}")
    if np.ma.is_masked(value):
        raise ValueError(f"{name} must not hold masked entries; remove them first")
    return raw.astype(np.float64)


class Bounds(NamedTuple):
    """What finite numbers must be, and what is said of those that are too large."""

    above: float = -math.inf
    least: float = -math.inf
    most: float = math.inf  # of the magnitude
    unit: str = ""  # in which they must be
    hint: str = ""  # the unit in which they may be instead

    def array(self, name: str, values: ArrayLike) -> Array:
        """A float64 copy of ``values``; raises a ``ValueError`` that names what is not right."""
        array = check_real(name, values)
        if not array.size:
            return array
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
        """Which of the values (...) are finite and within the bounds."""
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
