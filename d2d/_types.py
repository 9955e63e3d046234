"""Types shared by the whole package."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
