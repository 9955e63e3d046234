"""Cost surfaces over a grid of translations, and their peaks."""

from typing import NamedTuple

import numpy as np
from scipy.signal import find_peaks

from d2d._checks import Array
from d2d.cost import RegistrationCost
from d2d.point_set import PointSet


def target_log_surfaces(
    cost: RegistrationCost, translations: Array, fixed: PointSet, moving: PointSet
) -> Array:
    """Log density (K, T) of every moving target of one 1D scene over the translations (T,)."""
    alone = PointSet(moving.means[:, np.newaxis], moving.covariances[:, np.newaxis])
    return -cost.value(translations[:, np.newaxis, np.newaxis], fixed, alone).T


def log_surface(
    cost: RegistrationCost, translations: Array, fixed: PointSet, moving: PointSet
) -> Array:
    """Logarithm (..., T) of the fused density, the negative cost, over translations (T,)."""
    axes = (np.newaxis,) * len(fixed.batch_shape)
    theta = translations[(slice(None), *axes, np.newaxis)]
    return -np.moveaxis(cost.value(theta, fixed, moving), 0, -1)


class Peaks(NamedTuple):
    """Local maxima of one surface, the highest first."""

    positions: Array  # m
    log_heights: Array  # relative to the highest


def peaks(translations: Array, log_values: Array) -> Peaks:
    """Local maxima of a surface given by its logarithm on a grid (T,)."""
    index, _ = find_peaks(log_values)
    index = index[np.argsort(-log_values[index], kind="stable")]
    heights = log_values[index]
    return Peaks(translations[index], heights - heights[:1])


def basin(translations: Array, log_values: Array, start: float) -> tuple[float, float, float]:
    """Where an ascent from ``start`` (m) ends on a surface, and the basin it started in.

    Returns the local maximum reached and both edges of its basin of attraction, in m: the
    neighbouring minima, or the ends of the grid.
    """
    rising = np.diff(log_values) > 0
    i = int(np.argmin(np.abs(translations - start)))
    while i < len(rising) and rising[i]:
        i += 1
    while i > 0 and not rising[i - 1]:
        i -= 1
    left = right = i
    while left > 0 and rising[left - 1]:
        left -= 1
    while right < len(rising) and not rising[right]:
        right += 1
    return float(translations[i]), float(translations[left]), float(translations[right])


class Survey(NamedTuple):
    """What the surfaces of many draws look like, one entry (draws,) for each."""

    optima: Array  # local maxima of the logarithm
    highest: Array  # m, where the highest is
    rival: Array  # height of the second over the highest, 0 where there is none
    ascent: Array  # m, where an ascent from the true alignment ends
    basin: Array  # m, width of the basin that holds the true alignment

    def right(self, truth: float, tolerance: float) -> float:
        """Share of the draws whose highest maximum lies within the tolerance of the truth."""
        return float(np.mean(np.abs(self.highest - truth) < tolerance))


def survey(translations: Array, log_values: Array, truth: float) -> Survey:
    """Measure every surface (draws, T), given by its logarithm on a grid (T,)."""
    rows = []
    for values in log_values:
        found = peaks(translations, values)
        top, left, right = basin(translations, values, truth)
        rival = np.exp(found.log_heights[1]) if len(found.positions) > 1 else 0.0
        rows.append((len(found.positions), found.positions[0], rival, top, right - left))
    return Survey(*np.array(rows, dtype=np.float64).T)
