"""The thesis's evaluation (thesis sec. 6.3): its costs, its measures, its table, other layouts."""

from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from d2d._types import Array
from d2d.cost import CorruptedGaussian, RegistrationCost
from d2d.point_set import PointSet
from d2d.study.plane.scenarios import LAYOUTS, Layout, Scenario, random_scene
from d2d.study.runs import MonteCarlo, monte_carlo

ALPHA = 0.2  # assumed share of outliers
OUTLIER_COVARIANCE = 100.0 * np.eye(2)  # m^2

SUMMING = RegistrationCost(fusion="summing")
LIKELIHOOD = RegistrationCost(fusion="likelihood")
ROBUST = RegistrationCost(outlier=CorruptedGaussian(ALPHA, OUTLIER_COVARIANCE))
COSTS = {"summing": SUMMING, "likelihood": LIKELIHOOD, "robust": ROBUST}

# A run is at the truth if it is no farther off: some six times the likelihood's RMSE, and less than
# half way to a start at zero.
NEAR_DISTANCE, NEAR_ROTATION = 1.5, np.deg2rad(6.0)  # m, rad

NOTICEABLE = 0.3  # dB of a credibility ratio to either side of 0


Start = Literal["truth", "zero"]


@cache
def evaluated(
    scenario: Scenario, cost: RegistrationCost, initial: Start = "truth", runs: int = 1000
) -> MonteCarlo:
    """`monte_carlo` with seed 0, cached: the same draws for every cost and start."""
    return monte_carlo(scenario, cost, runs, initial=initial)


def same_draws(scenario: Scenario, runs: int = 1000) -> tuple[PointSet, PointSet]:
    """The first sets that `evaluated` registers: those of `monte_carlo` with seed 0, 1000 runs."""
    child = np.random.SeedSequence(0).spawn(1)[0]
    fixed, moving = scenario.sample(1000, np.random.default_rng(child))
    return fixed[:runs], moving[:runs]


def distance_and_rotation(errors: ArrayLike) -> tuple[Array, Array]:
    """Length of the translation's error (...) in m and size of the rotation's (...) in rad."""
    e = np.asarray(errors, dtype=np.float64)
    turn = np.abs(np.angle(np.exp(1j * e[..., 2])))
    return np.hypot(e[..., 0], e[..., 1]), turn


def at_truth(errors: ArrayLike) -> NDArray[np.bool_]:
    """Whether each error (..., 3) is within 1.5 m and 6 degrees."""
    distance, turn = distance_and_rotation(errors)
    right: NDArray[np.bool_] = (distance < NEAR_DISTANCE) & (turn < NEAR_ROTATION)
    return right


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


@dataclass(frozen=True, eq=False)
class LayoutStudy:
    """One measure of each kind per random layout, arrays (layouts,)."""

    share: Array  # of runs at the truth
    rmse: Array  # m, of all runs
    inclination: Array  # dB
    pessimistic: Array  # share of runs with a credibility ratio below -0.3 dB
    optimistic: Array  # and above +0.3 dB
    nci: Array  # dB
    coverage: Array  # share of runs whose error lies within the stated 95 % region


@cache
def over_layouts(
    kind: str | Layout,
    cost: RegistrationCost,
    initial: Start = "truth",
    layouts: int = 200,
    runs: int = 100,
) -> LayoutStudy:
    """Evaluate a cost on random layouts of eight targets, with as many ``runs`` on each.

    ``kind`` is a `Layout` or the name of one in `d2d.study.plane.scenarios.LAYOUTS`; layout s has
    the seed s.
    """

    def study(seed: int) -> tuple[float, ...]:
        result = monte_carlo(random_layout(kind, seed), cost, runs, seed, initial)
        share = at_truth(result.errors).mean()
        rmse = rms(distance_and_rotation(result.errors)[0])
        indices = result.credibility
        ratio = 10.0 * np.log10(indices.ratio)
        parts = (ratio < -NOTICEABLE).mean(), (ratio > NOTICEABLE).mean()
        covered = (indices.nees < scipy.special.chdtri(result.errors.shape[1], 0.05)).mean()
        return share, rmse, indices.inclination, *parts, indices.nci, covered

    return LayoutStudy(*np.array([study(seed) for seed in range(layouts)]).T)


@cache
def random_layout(kind: str | Layout, seed: int) -> Scenario:
    """A scene of that kind, with targets in other places for every seed."""
    layout = LAYOUTS[kind] if isinstance(kind, str) else kind
    return random_scene(str(kind), layout, np.random.default_rng(seed))
