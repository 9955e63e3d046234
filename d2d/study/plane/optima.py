"""Where the optima of a planar registration cost are, and from where they are reached."""

from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np

from d2d import rigid
from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.point_set import PointSet
from d2d.problem import Estimate
from d2d.registration import register, start_grid
from d2d.study.plane.evaluation import at_truth
from d2d.study.plane.scenarios import Scenario
from d2d.study.point_sets.convergence import start_plane
from d2d.study.runs import THREADS

SEARCH_DISTANCE, SEARCH_ROTATION = 10.0, np.deg2rad(45.0)  # m, rad: of the search, around the truth
SPACING, ROTATIONS = 2.0, 7
SAME = np.array([0.05, 0.05, np.deg2rad(0.3)])  # m, m, rad: nearer optima count as one
VISIBLE = np.log(0.01)  # a peak below 1 % of the highest cannot be seen in a plot of the density

DISTANCES = np.arange(0.0, 20.1, 1.0)  # m
TURNS = np.deg2rad(np.arange(-60.0, 60.1, 6.0))  # rad


class Minima(NamedTuple):
    """Distinct local minima of one cost, the lowest first."""

    errors: Array  # (M, 3) in m, m, rad
    log_heights: Array  # (M,) logarithm of the density over the highest

    @property
    def near(self) -> int:
        """Number of minima within 10 m and 45 degrees of the truth."""
        inside = np.abs(self.errors) <= (SEARCH_DISTANCE, SEARCH_DISTANCE, SEARCH_ROTATION)
        return int(inside.all(axis=-1).sum())

    @property
    def visible(self) -> int:
        """Number of all minima found whose density is above 1 % of the highest."""
        return int(np.sum(self.log_heights > VISIBLE))

    @property
    def right(self) -> bool:
        """Whether the lowest minimum found is at the truth."""
        return bool(at_truth(self.errors[0]))


@cache
def local_minima(scenario: Scenario, cost: RegistrationCost, draws: int = 5) -> tuple[Minima, ...]:
    """The local minima of a cost, for each draw of seed 5.

    Found by descents from a grid of 847 starts within 10 m and 45 degrees of the truth; their
    number is a lower bound.
    """
    found = _descents(scenario, cost, draws)
    errors = found.theta - scenario.theta
    errors[..., 2] = np.angle(np.exp(1j * errors[..., 2]))
    reached = found.converged
    return tuple(
        _distinct(errors[reached[:, draw], draw], found.value[reached[:, draw], draw])
        for draw in range(draws)
    )


def highest_density(scenario: Scenario, cost: RegistrationCost, draws: int) -> Array:
    """Logarithm (draws,) of the highest fused density that the same descents find in each draw."""
    found = _descents(scenario, cost, draws)
    heights = np.where(found.converged, -found.value, -np.inf)
    return np.asarray(heights.max(axis=0))


@lru_cache(maxsize=4)
def _descents(scenario: Scenario, cost: RegistrationCost, draws: int) -> Estimate:
    """Estimates (847, draws) from the grid of starts."""
    fixed, moving = scenario.sample(draws, np.random.default_rng(5))
    angles = np.linspace(-SEARCH_ROTATION, SEARCH_ROTATION, ROTATIONS)
    starts = scenario.theta + start_grid(SEARCH_DISTANCE, SPACING, angles)
    return register(fixed, moving, cost, starts[:, np.newaxis], threads=THREADS)


def _distinct(errors: Array, values: Array) -> Minima:
    left = np.argsort(values, kind="stable")
    kept: list[int] = []
    while left.size:
        kept.append(int(left[0]))
        apart = np.abs(errors[left] - errors[left[0]]) > SAME
        left = left[apart.any(axis=-1)]
    return Minima(errors[kept], values[kept[0]] - values[kept])


def nearest(fixed: Array, moving: Array, theta: Array) -> Array:
    """Distance (K,) of each moving position (K, 2), moved by theta, to the next fixed one, in m."""
    moved = rigid.transform_means(theta, moving)
    apart = np.linalg.norm(moved[:, np.newaxis] - fixed, axis=-1)
    return np.asarray(apart.min(axis=1))


def arrival_shares(
    scenario: Scenario,
    cost: RegistrationCost,
    *,
    scales: tuple[float, ...] = (1.0,),
) -> Array:
    """Share (turns, distances) of starts from which the cost ends at the truth, over eight draws.

    A start is the truth plus a translation by one of `DISTANCES`, in eight directions, and a
    rotation by one of `TURNS`.
    """
    fixed, moving = scenario.sample(8, np.random.default_rng(0))
    starts = scenario.theta + start_plane(DISTANCES, TURNS, 8)[..., np.newaxis, :]
    found = register(fixed, moving, cost, starts, scales, threads=THREADS)
    return np.asarray(at_truth(found.theta - scenario.theta).mean(axis=(-2, -1)))


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
