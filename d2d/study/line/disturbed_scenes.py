"""The line scene with an outlier in one set, and with a cluster (thesis sec. 4.4 and 4.5)."""

import numpy as np

from d2d._types import Array
from d2d.cost import CorruptedGaussian
from d2d.point_set import PointSet
from d2d.study.line.scene import FIXED_POSITIONS, SIGMA, TRUTH, line_scene

# m, each in the frame of its set. The one in M meets A of F at t_x = 4; at 4.2, A meets C.
OUTLIER_FIXED, OUTLIER_MOVING = 4.5, 4.0
SPAN = 5.0  # m: an outlier at random is drawn up to this far beyond the targets
CLUSTER_NAMES = ("B", "A", "C", "D", "E")

# The values of thesis ch. 6, here on the line: a fifth of outliers, 10 m wide.
CORRUPTED = CorruptedGaussian(0.2, np.array([[100.0]]))


def with_outlier(
    rng: np.random.Generator,
    where: str,
    *,
    at: float | None = None,
    draws: tuple[int, ...] = (),
) -> tuple[PointSet, PointSet]:
    """The line scene with one extra target, the last one of the set ``where``, fixed or moving.

    It stands ``at`` (m) in that set's frame or, unless that is given, anywhere over the targets and
    5 m beyond, drawn anew for every draw.  ``draws`` is the batch shape.
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
