"""The thesis's evaluation (thesis sec. 6.3): its costs, its measures, other layouts."""

from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from d2d._types import Array
from d2d.cost import CorruptedGaussian, RegistrationCost
from d2d.point_set import PointSet
from d2d.study.book.measured import Measured, inclination_of, rms_ratio, share_of
from d2d.study.plane.scenarios import (
    LAYOUTS,
    OUTLIERS_AND_CLUSTERS_A,
    OUTLIERS_AND_CLUSTERS_B,
    Layout,
    Scenario,
    random_scene,
)
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
STARTS: tuple[Start, Start] = ("truth", "zero")
SEARCHED = 80  # draws whose minima are searched for: without an exception, nearly all
THOUSAND = "1000 draws of the noise of this scene"
OVER_LAYOUTS = f"{THOUSAND}, and 100 on each of 200 random layouts"
BOTH = {"A": OUTLIERS_AND_CLUSTERS_A, "B": OUTLIERS_AND_CLUSTERS_B}
Condition = tuple[Scenario, RegistrationCost]


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
    """Root mean square; nan if there are no values."""
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


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
    """Evaluate a cost on random layouts of a kind of `LAYOUTS`, with seeds 0, 1, ..."""

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


def share_ending_at_truth(scenario: Scenario, cost: RegistrationCost) -> Measured:
    """Share of the runs that end at the truth, started there."""
    return share_of(at_truth(evaluated(scenario, cost).errors))


def error_ratio(over: Condition, under: Condition) -> Measured:
    """Ratio of the RMSEs of the translation in two conditions, started at the truth."""
    return rms_ratio(errors_of(*over)[0], errors_of(*under)[0])


def error_ratio_of_layouts(over: Condition, under: Condition) -> Array:
    """Ratio of RMS errors on each of 200 random layouts with the targets of such a scene."""
    above, below = (over_layouts(scenario.name, cost).rmse for scenario, cost in (over, under))
    return above / below


def inclination(scenario: Scenario, cost: RegistrationCost) -> Measured:
    """I² in dB, started at the truth."""
    return inclination_of(evaluated(scenario, cost).credibility)


def errors_of(scenario: Scenario, cost: RegistrationCost) -> tuple[Array, Array]:
    """Errors of the translation in m and the rotation in rad, started at the truth."""
    return distance_and_rotation(evaluated(scenario, cost).errors)


def ratios_in_decibels(scenario: Scenario, cost: RegistrationCost) -> Array:
    """Credibility ratio of every run in dB, started at the truth."""
    return 10.0 * np.log10(evaluated(scenario, cost).credibility.ratio)


def times_off(inclination: float) -> str:
    """The factor by which a covariance with this I² in dB is off, such as "5.9 times too large"."""
    direction = "large" if inclination < 0.0 else "small"
    return f"{10.0 ** (abs(inclination) / 10.0):.1f} times too {direction}"
