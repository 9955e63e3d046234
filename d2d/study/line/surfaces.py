"""Cost surfaces over a grid of translations, and their peaks."""

import functools
import math
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from d2d._types import Array
from d2d.cost import CorruptedGaussian, RegistrationCost, UniformOutlier
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
    """Logarithm (..., T) of the fused density, the negative cost, over translations (T,).

    The formulas written out for sets on a line, of which a claim needs millions of values.
    """
    outlier, targets = cost.outlier, []
    for k in range(moving.size):
        terms: list[Any] = []
        for i in range(fixed.size):
            log_weight = np.log(fixed.weights[..., i, np.newaxis])
            variance = fixed.covariances[..., i, :, 0]
            if cost.metric == "d2d":
                variance = variance + moving.covariances[..., k, :, 0]
            square = (moving.means[..., k, :] - fixed.means[..., i, :] + translations) ** 2
            inlier = log_weight + _log_normal(square, variance)
            if isinstance(outlier, CorruptedGaussian):
                wide = _log_normal(square, outlier.covariance[0])
                terms.append(math.log(outlier.fraction) + log_weight + wide)
                inlier += math.log1p(-outlier.fraction)
            terms.append(inlier)
        if isinstance(outlier, UniformOutlier):
            terms.append(math.log(outlier.density))
        targets.append(_log_sum(terms))
    return np.asarray(sum(targets) if cost.fusion == "likelihood" else _log_sum(targets))


def _log_normal(square: Array, variance: Array) -> Array:
    return -0.5 * (square / variance + np.log(2.0 * math.pi * variance))


def _log_sum(terms: list[Any]) -> Array:
    top = functools.reduce(np.maximum, terms)
    return np.asarray(top + np.log(sum(np.exp(term - top) for term in terms)))


class Peaks(NamedTuple):
    """Local maxima of surfaces, the highest first; where there are fewer, NaN and -inf."""

    positions: Array  # (..., P), m, that of the highest maximum first
    log_heights: Array  # (..., P), relative to the highest

    @property
    def number(self) -> NDArray[np.int64]:
        """How many maxima each surface has (...)."""
        return np.asarray(np.isfinite(self.log_heights).sum(axis=-1))

    @property
    def second_log_height(self) -> Array:
        """Log height (...) of the second maximum relative to the highest, -inf without one."""
        return np.asarray(self.log_heights[..., 1:].max(axis=-1, initial=-np.inf))


def peaks(translations: Array, log_values: Array) -> Peaks:
    """Local maxima within a grid (T,) of surfaces (..., T) of logarithms; a plateau counts once."""
    rows = np.reshape(log_values, (-1, len(translations)))
    # one search through all rows, with a wall after each so that its ends are no maxima
    walled = np.pad(rows, ((0, 0), (0, 1)), constant_values=np.inf)
    row, column = np.divmod(scipy.signal.find_peaks(walled.ravel())[0], walled.shape[1])
    row, column = (index[column < len(translations)] for index in (row, column))

    order = np.lexsort((-rows[row, column], row))
    row, column = row[order], column[order]
    heights = rows[row, column]
    numbers = np.bincount(row, minlength=len(rows))
    highest = (np.cumsum(numbers) - numbers)[row]  # of the same row
    rank = np.arange(len(row)) - highest

    positions = np.full((len(rows), numbers.max(initial=0)), np.nan)
    log_heights = np.full(positions.shape, -np.inf)
    positions[row, rank] = translations[column]
    log_heights[row, rank] = heights - heights[highest]
    shape = (*np.shape(log_values)[:-1], positions.shape[-1])
    return Peaks(positions.reshape(shape), log_heights.reshape(shape))


def basin_of_attraction(
    translations: Array, log_values: Array, start: float
) -> tuple[Array, Array, Array]:
    """Where an ascent from ``start`` (m) ends on surfaces (..., T), and the basin it started in.

    Returns the maximum and both edges (...) in m: minima next to it, or ends of the grid.
    """
    rising = log_values[..., 1:] > log_values[..., :-1]  # from each sample to the next
    nearest = np.full(rising.shape[:-1], np.abs(translations - start).argmin())
    top = _after_previous(rising, _next(~rising, nearest))
    left, right = _after_previous(~rising, top), _next(rising, top)
    return translations[top], translations[left], translations[right]


def _next(condition: NDArray[np.bool_], start: NDArray[np.int64]) -> NDArray[np.int64]:
    """First index (...) from ``start`` on at which a condition (..., N) is met; N if none."""
    size: int = condition.shape[-1]
    met = condition & (np.arange(size) >= start[..., np.newaxis])
    return np.where(met.any(axis=-1), met.argmax(axis=-1), size)


def _after_previous(condition: NDArray[np.bool_], end: NDArray[np.int64]) -> NDArray[np.int64]:
    """One more than the last index (...) below ``end`` at which a condition is met; 0 if none."""
    size: int = condition.shape[-1]
    return size - _next(condition[..., ::-1], size - end)


class Survey(NamedTuple):
    """Optima and basins of the surfaces of many draws, one entry (draws,) for each."""

    optima: Array  # local maxima of the logarithm
    highest: Array  # m, where the highest is
    rival: Array  # height of the second over the highest, 0 where there is none
    ascent: Array  # m, where an ascent from the true alignment ends
    basin_width: Array  # m, of the basin of attraction that holds the true alignment

    def right(self, truth: float, tolerance: float) -> NDArray[np.bool_]:
        """Whether the highest maximum of each draw lies within the tolerance of the truth."""
        return np.asarray(np.abs(self.highest - truth) < tolerance)


def survey(translations: Array, log_values: Array, truth: float) -> Survey:
    """Measure every surface (draws, T), given by its logarithm on a grid (T,)."""
    maxima = peaks(translations, log_values)
    top, left, right = basin_of_attraction(translations, log_values, truth)
    optima = maxima.number.astype(np.float64)
    return Survey(
        optima, maxima.positions[:, 0], np.exp(maxima.second_log_height), top, right - left
    )
