"""The thesis's one-dimensional scene: three targets on a line (thesis sec. 4.1)."""

from collections.abc import Sequence

import numpy as np

from d2d._types import Array
from d2d.point_set import PointSet

TRUTH = 2.0  # m, the translation t_x
SIGMA = 0.15  # m
NAMES = ("B", "A", "C")
FIXED_POSITIONS = np.array([0.0, 8.0, 10.2])  # m: B's surface peaks at 2, 2 + 8 and 2 + 8 + 2.2


def line_scene(
    rng: np.random.Generator,
    *,
    positions: Sequence[float] | Array = FIXED_POSITIONS,
    sigma_fixed: float = SIGMA,
    sigma_moving: float = SIGMA,
    draws: tuple[int, ...] = (),
) -> tuple[PointSet, PointSet]:
    """Noisy observations of the targets before and after the motion: the fixed and the moving set.

    ``positions`` (m) are the true ones in F; those in M are smaller by the true translation.  The
    sets are one-dimensional, of batch shape ``draws``, with independent noise of the standard
    deviations ``sigma_fixed`` and ``sigma_moving`` (m).
    """
    true = np.asarray(positions, dtype=np.float64)
    shape = (*draws, len(true))

    def observe(true_positions: Array, sigma: float) -> PointSet:
        means = true_positions + sigma * rng.standard_normal(shape)
        return PointSet(means[..., None], np.full((len(true), 1, 1), sigma**2))

    return observe(true, sigma_fixed), observe(true - TRUTH, sigma_moving)
