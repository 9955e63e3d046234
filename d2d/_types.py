"""Types shared by the whole package."""

from collections.abc import Sequence
from types import EllipsisType
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_Number = int | np.integer[Any]
# A slice, indices or a mask along an axis (True and False are integers).
Selection = (
    slice | Sequence[_Number] | Sequence[np.bool_] | NDArray[np.integer[Any]] | NDArray[np.bool_]
)
# Along one of several axes, and along all of them.
_AxisIndex = _Number | Selection | EllipsisType | None
Index = _AxisIndex | tuple[_AxisIndex, ...]
