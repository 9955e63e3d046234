"""What the claims on scenes in the plane measure: optima, shares of runs, errors, decibels."""

import numpy as np

from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.study.plane.evaluation import (
    Start,
    at_truth,
    distance_and_rotation,
    evaluated,
)
from d2d.study.plane.optima import Minima
from d2d.study.plane.scenarios import (
    OUTLIERS_AND_CLUSTERS_A,
    OUTLIERS_AND_CLUSTERS_B,
    Scenario,
)

PESSIMISTIC = -3.0  # dB: the covariance is twice too large or worse
SAME_ERROR = 1.1  # a ratio of errors within 10 % of one
BOTH = {"A": OUTLIERS_AND_CLUSTERS_A, "B": OUTLIERS_AND_CLUSTERS_B}
MinimaOfDraws = tuple[Minima, ...]
"""The local minima of a cost, for each of several draws."""


def mean_count_near(draws: MinimaOfDraws) -> float:
    """Mean number of minima within 10 m and 45 degrees of the truth."""
    return float(np.mean([each.near for each in draws]))


def counts_visible(draws: MinimaOfDraws) -> list[int]:
    """Number of minima of each draw above 1 % of the highest density."""
    return [each.visible for each in draws]


def has_one_visible(draws: MinimaOfDraws) -> bool:
    """Whether every draw has only one minimum above 1 % of the highest density."""
    return set(counts_visible(draws)) == {1}


def share_lowest_at_truth(draws: MinimaOfDraws) -> float:
    """Share of the draws whose lowest minimum is at the truth."""
    return float(np.mean([each.right for each in draws]))


def strongest_rival(draws: MinimaOfDraws) -> float:
    """Highest density of an optimum elsewhere, over that of the highest at the truth."""
    drops = []
    for each in draws:
        right = at_truth(each.errors)
        elsewhere, there = each.log_heights[~right], each.log_heights[right]
        drops.append(elsewhere.max(initial=-np.inf) - there.max(initial=-np.inf))
    return float(np.exp(max(drops)))


def decades_to_second(draws: MinimaOfDraws) -> float:
    """Median log10 of the density at the second optimum over that at the first."""
    return float(np.median([each.log_heights[1] for each in draws]) / np.log(10.0))


def share_ending_at_truth(
    scenario: Scenario, cost: RegistrationCost, initial: Start = "truth"
) -> float:
    """Share of the runs that end at the truth."""
    return float(at_truth(evaluated(scenario, cost, initial).errors).mean())


def errors_of(scenario: Scenario, cost: RegistrationCost) -> tuple[Array, Array]:
    """Errors of the translation in m and the rotation in rad, started at the truth."""
    return distance_and_rotation(evaluated(scenario, cost).errors)


def ratios_in_decibels(scenario: Scenario, cost: RegistrationCost) -> Array:
    """Credibility ratio of every run in dB, started at the truth."""
    return 10.0 * np.log10(evaluated(scenario, cost).credibility.ratio)


def times_off(inclination: float) -> str:
    """By which factor a covariance with an I2 in dB is off: "5.9 times too large", say."""
    direction = "large" if inclination < 0.0 else "small"
    return f"{10.0 ** (abs(inclination) / 10.0):.1f} times too {direction}"
