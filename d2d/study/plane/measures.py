"""Measures for the claims on scenes in the plane: optima, shares of runs, errors, decibels."""

import numpy as np

from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.study.book.measured import (
    Measured,
    inclination_of,
    median_of,
    rms_ratio,
    share_of,
)
from d2d.study.plane.evaluation import (
    Start,
    at_truth,
    distance_and_rotation,
    evaluated,
    over_layouts,
)
from d2d.study.plane.optima import Minima
from d2d.study.plane.scenarios import OUTLIERS_AND_CLUSTERS_A, OUTLIERS_AND_CLUSTERS_B, Scenario

SEARCHED = 80  # draws whose minima are searched for: without an exception, nearly all
STARTS: tuple[Start, Start] = ("truth", "zero")
THOUSAND = "1000 draws of the noise of this scene"
OVER_LAYOUTS = f"{THOUSAND}, and 100 on each of 200 random layouts"
BOTH = {"A": OUTLIERS_AND_CLUSTERS_A, "B": OUTLIERS_AND_CLUSTERS_B}
Condition = tuple[Scenario, RegistrationCost]


def rivals(found: Minima) -> Array:
    """Highest density elsewhere in each draw, over that of the highest optimum at the truth."""
    drops = []
    for errors, log_heights in zip(found.errors, found.log_heights, strict=True):
        right = at_truth(errors)
        elsewhere, there = log_heights[~right], log_heights[right]
        drops.append(elsewhere.max(initial=-np.inf) - there.max(initial=-np.inf))
    return np.exp(drops)


def decades_to_second(found: Minima) -> Measured:
    """Median log10 of the density at the second optimum over that at the first."""
    return median_of(np.array([each[1] for each in found.log_heights]) / np.log(10.0))


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
    """I2 in dB, started at the truth."""
    return inclination_of(evaluated(scenario, cost).credibility)


def errors_of(scenario: Scenario, cost: RegistrationCost) -> tuple[Array, Array]:
    """Errors of the translation in m and the rotation in rad, started at the truth."""
    return distance_and_rotation(evaluated(scenario, cost).errors)


def ratios_in_decibels(scenario: Scenario, cost: RegistrationCost) -> Array:
    """Credibility ratio of every run in dB, started at the truth."""
    return 10.0 * np.log10(evaluated(scenario, cost).credibility.ratio)


def times_off(inclination: float) -> str:
    """The factor by which a covariance with this I2 in dB is off, such as "5.9 times too large"."""
    direction = "large" if inclination < 0.0 else "small"
    return f"{10.0 ** (abs(inclination) / 10.0):.1f} times too {direction}"
