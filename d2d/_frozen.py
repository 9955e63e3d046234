"""The base of containers that do not change, and so may store what they have computed."""

from functools import cached_property
from typing import Any, Self

import numpy as np


class Frozen:
    """Base of the frozen dataclasses whose arrays are read-only, so that a cached value holds.

    The arrays of a copy and of an unpickled object are, too, although NumPy makes them writeable.
    """

    def _keep(self, name: str, value: object) -> None:
        """Set an attribute; an array of the object's own, or a tuple of them, becomes read-only."""
        for array in value if isinstance(value, tuple) else (value,):
            if isinstance(array, np.ndarray):
                array.setflags(write=False)
        object.__setattr__(self, name, value)

    @classmethod
    def _made(cls, *values: object) -> Self:
        """An object of values that are known to be good, in the order of the fields."""
        made = cls.__new__(cls)
        for name, value in zip(cls.__dataclass_fields__, values, strict=True):  # type: ignore[attr-defined]
            made._keep(name, value)
        return made

    def __getstate__(self) -> dict[str, Any]:
        kind = type(self)
        return {
            name: value
            for name, value in self.__dict__.items()
            if not isinstance(getattr(kind, name, None), cached_property)
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            self._keep(name, value)
