"""The thesis's scenes on a line: three targets, also with an outlier or a cluster (sec. 4)."""

from collections.abc import Sequence

import numpy as np

from d2d._types import Array
from d2d.cost import CorruptedGaussian
from d2d.point_set import PointSet

TRUTH = 2.0  # m, the translation t_x
SIGMA = 0.15  # m
NAMES = ("B", "A", "C")
FIXED_POSITIONS = np.array([0.0, 8.0, 10.2])  # m: B's surface peaks at 2, 2 + 8 and 2 + 8 + 2.2

# m, each in the frame of its set. The one in M meets A of F at t_x = 4; at 4.2, A meets C.
OUTLIER_FIXED, OUTLIER_MOVING = 4.5, 4.0
SPAN = 5.0  # m: an outlier at random is drawn up to this far beyond the targets
CLUSTER_NAMES = ("B", "A", "C", "D", "E")

# The values of thesis ch. 6, here on the line: a fifth of outliers, 10 m wide.
CORRUPTED = CorruptedGaussian(0.2, np.array([[100.0]]))


def line_scene(
    rng: np.random.Generator,
    *,
    positions: Sequence[float] | Array = FIXED_POSITIONS,
    sigma_fixed: float = SIGMA,
    sigma_moving: float = SIGMA,
    draws: tuple[int, ...] = (),
) -> tuple[PointSet, PointSet]:
    """Noisy observations of the targets before and after the motion: the fixed and the moving set.

    ``positions`` (m) are the true ones in F; the one-dimensional sets have the batch shape
    ``draws`` and independent noise ``sigma_fixed`` and ``sigma_moving`` (m).
    """
    true = np.asarray(positions, dtype=np.float64)
    shape = (*draws, len(true))

    def observe(true_positions: Array, sigma: float) -> PointSet:
        means = true_positions + sigma * rng.standard_normal(shape)
        return PointSet(means[..., None], np.full((len(true), 1, 1), sigma**2))

    return observe(true, sigma_fixed), observe(true - TRUTH, sigma_moving)


def with_outlier(
    rng: np.random.Generator, where: str, *, at: float | None = None, draws: tuple[int, ...] = ()
) -> tuple[PointSet, PointSet]:
    """The line scene with one extra target, the last one of the set ``where``, fixed or moving.

    It stands ``at`` (m) in that set's frame, by default anywhere up to 5 m beyond the targets.
    """
    fixed, moving = line_scene(rng, draws=draws)
    shift = 0.0 if where == "fixed" else TRUTH
    low, high = FIXED_POSITIONS.min() - shift - SPAN, FIXED_POSITIONS.max() - shift + SPAN
    position = rng.uniform(low, high, draws) if at is None else np.full(draws, at)
    outlier = (position + SIGMA * rng.standard_normal(draws))[..., None, None]
    if where == "fixed":
        return _extended(fixed, outlier), moving
    return fixed, _extended(moving, outlier)


def _extended(points: PointSet, mean: Array) -> PointSet:
    means = np.concatenate([points.means, mean], axis=-2)
    covariances = np.concatenate([points.covariances, points.covariances[..., :1, :, :]], axis=-3)
    return PointSet(means, covariances)


def cluster_positions(spacing: float) -> Array:
    """Positions (5,) in F: B, A, C, and then D and E, ``spacing`` m to either side of A."""
    a = FIXED_POSITIONS[1]
    return np.concatenate([FIXED_POSITIONS, [a - spacing, a + spacing]])


def clustered(
    rng: np.random.Generator, spacing: float, draws: tuple[int, ...] = ()
) -> tuple[PointSet, PointSet]:
    """The line scene with a cluster of three targets around A."""
    return line_scene(rng, positions=cluster_positions(spacing), draws=draws)
