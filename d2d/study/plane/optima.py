"""Where the optima of a planar registration cost are, and from where they are reached."""

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from d2d import rigid
from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.point_set import PointSet
from d2d.registration import register, start_grid
from d2d.study.book.measured import Measured, median_of
from d2d.study.plane.evaluation import at_truth
from d2d.study.plane.scenarios import Scenario
from d2d.study.point_sets.convergence import start_plane
from d2d.study.runs import THREADS, scheduled

SEARCH_DISTANCE, SEARCH_ROTATION = 10.0, np.deg2rad(45.0)  # m, rad: of the search, around the truth
SPACING, ROTATIONS = 2.0, 7
SAME = np.array([0.05, 0.05, np.deg2rad(0.3)])  # m, m, rad: nearer optima count as one
VISIBLE = np.log(0.01)  # a peak below 1 % of the highest cannot be seen in a plot of the density

DISTANCES = np.arange(0.0, 20.1, 1.0)  # m
TURNS = np.deg2rad(np.arange(-60.0, 60.1, 6.0))  # rad


class Minima(NamedTuple):
    """Distinct local minima of one cost in each of several draws, the lowest first."""

    errors: tuple[Array, ...]  # (M, 3) in m, m, rad of each draw
    log_heights: tuple[Array, ...]  # (M,) logarithm of the density over the highest
    highest: Array  # (draws,) logarithm of the highest density

    @property
    def near(self) -> NDArray[np.int64]:
        """Number (draws,) of minima within 10 m and 45 degrees of the truth."""
        limits = (SEARCH_DISTANCE, SEARCH_DISTANCE, SEARCH_ROTATION)
        return np.array([(np.abs(errors) <= limits).all(axis=-1).sum() for errors in self.errors])

    @property
    def visible(self) -> NDArray[np.int64]:
        """Number (draws,) of all minima found whose density is above 1 % of the highest."""
        return np.array([np.sum(heights > VISIBLE) for heights in self.log_heights])

    @property
    def right(self) -> NDArray[np.bool_]:
        """Whether the lowest minimum found is at the truth (draws,)."""
        return at_truth([errors[0] for errors in self.errors])

    @property
    def rivals(self) -> Array:
        """Highest density elsewhere over that of the highest optimum at the truth (draws,)."""
        drops = []
        for errors, heights in zip(self.errors, self.log_heights, strict=True):
            right = at_truth(errors)
            elsewhere, there = (
                each.max(initial=-np.inf) for each in (heights[~right], heights[right])
            )
            drops.append(elsewhere - there)
        return np.exp(drops)

    @property
    def decades_to_second(self) -> Measured:
        """Median log10 of the density at the second optimum over that at the first."""
        return median_of(np.array([heights[1] for heights in self.log_heights]) / np.log(10.0))


@cache
def local_minima(scenario: Scenario, cost: RegistrationCost, draws: int = 5) -> Minima:
    """The local minima that descents from 847 starts near the truth find, for draws of seed 5."""
    fixed, moving = scenario.sample(draws, np.random.default_rng(5))
    angles = np.linspace(-SEARCH_ROTATION, SEARCH_ROTATION, ROTATIONS)
    starts = scenario.theta + start_grid(SEARCH_DISTANCE, SPACING, angles)
    estimates = register(fixed, moving, cost, starts[:, np.newaxis], threads=THREADS)
    errors = estimates.theta - scenario.theta
    errors[..., 2] = np.angle(np.exp(1j * errors[..., 2]))
    distinct = []
    for draw, converged in enumerate(estimates.converged.T):
        chosen, values = errors[converged, draw], estimates.value[converged, draw]
        kept = _distinct(chosen, values)
        distinct.append((chosen[kept], values[kept[0]] - values[kept], -values[kept[0]]))
    own_errors, log_heights, highest = zip(*distinct, strict=True)
    return Minima(own_errors, log_heights, np.array(highest))


def _distinct(errors: Array, values: Array) -> list[int]:
    """The lowest of all that lie close to each other, the lowest of all first."""
    left = np.argsort(values, kind="stable")
    columns, kept = errors[left].T.copy(), list[int]()
    while left.size:
        kept.append(int(left[0]))
        apart = (np.abs(columns - columns[:, :1]) > SAME[:, None]).any(axis=0)
        left, columns = left[apart], columns[:, apart]
    return kept


def nearest(fixed: Array, moving: Array, theta: Array) -> Array:
    """Distance (K,) of each moving position (K, 2), moved by theta, to the next fixed one, in m."""
    moved = rigid.transform_means(theta, moving)
    apart = np.linalg.norm(moved[:, np.newaxis] - fixed, axis=-1)
    return np.asarray(apart.min(axis=1))


def arrival_shares(
    scenario: Scenario, cost: RegistrationCost, *, scales: tuple[float, ...] = (1.0,)
) -> Array:
    """Share (turns, distances) of starts from which the cost ends at the truth, over eight draws.

    A start is off by one of `DISTANCES`, in eight directions, and one of `TURNS`.
    """
    fixed, moving = scenario.sample(8, np.random.default_rng(0))
    starts = scenario.theta + start_plane(DISTANCES, TURNS, 8)[..., np.newaxis, :]
    estimates = scheduled(fixed, moving, cost, starts, scales, threads=THREADS)
    return np.asarray(at_truth(estimates.theta - scenario.theta).mean(axis=(-2, -1)))


def translation_surface(
    cost: RegistrationCost, fixed: PointSet, moving: PointSet, theta: Array, offsets: Array
) -> Array:
    """Logarithm (T, T) of the fused density over t_y (rows) and t_x, offsets (T,) from theta."""
    x, y = np.meshgrid(offsets, offsets)
    shifts = np.stack([x, y, np.zeros_like(x)], axis=-1)
    return -cost.value(theta + shifts, fixed, moving)


def rotation_profile(
    cost: RegistrationCost, fixed: PointSet, moving: PointSet, theta: Array, turns: Array
) -> Array:
    """Logarithm (T,) of the fused density over rotations, offsets (T,) in rad from theta."""
    return -cost.value(theta + np.multiply.outer(turns, [0.0, 0.0, 1.0]), fixed, moving)
