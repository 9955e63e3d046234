"""Values that are computed once, and the immutable containers that store them."""

from collections.abc import Callable
from functools import cached_property
from typing import Any, Generic, TypeVar, overload

import numpy as np

T = TypeVar("T")


class lazy(Generic[T]):
    """`functools.cached_property` without its lock, which before Python 3.12 costs a microsecond.

    Two threads may compute the value twice; either result is kept.
    """

    def __init__(self, compute: Callable[[Any], T]) -> None:
        self.compute = compute
        self.__doc__ = compute.__doc__

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, instance: None, owner: type) -> "lazy[T]": ...

    @overload
    def __get__(self, instance: object, owner: type) -> T: ...

    def __get__(self, instance: object | None, owner: type) -> "T | lazy[T]":
        """The value, which from then on stands in the instance's own dictionary."""
        if instance is None:
            return self
        value = instance.__dict__[self.name] = self.compute(instance)
        return value


class Frozen:
    """Base of the frozen dataclasses whose arrays are read-only, so that a cached value holds.

    NumPy makes every copied or unpickled array writeable.  A copy of such a dataclass therefore
    gets read-only arrays again, and computes its cached values anew.
    """

    def _keep(self, name: str, value: object) -> None:
        """Set an attribute; an array of the object's own, or a tuple of them, becomes read-only."""
        for array in value if isinstance(value, tuple) else (value,):
            if isinstance(array, np.ndarray):
                array.flags.writeable = False
        object.__setattr__(self, name, value)

    def __getstate__(self) -> dict[str, Any]:
        kind = type(self)
        return {
            name: value
            for name, value in self.__dict__.items()
            if not isinstance(getattr(kind, name, None), lazy | cached_property)
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            self._keep(name, value)
