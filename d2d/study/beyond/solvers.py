"""Other solvers from the literature, on the draws of `d2d.study.plane.evaluation.evaluated`."""

import time
from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from d2d._types import Array
from d2d.cost import CorruptedGaussian, RegistrationCost
from d2d.point_set import PointSet
from d2d.problem import Estimate
from d2d.registration import register
from d2d.study.beyond.mixtures import register_mixture
from d2d.study.plane.evaluation import ALPHA, OUTLIER_COVARIANCE, ROBUST, at_truth, same_draws
from d2d.study.plane.scenarios import Scenario
from d2d.study.runs import MonteCarlo, stacked

OUTLIER = CorruptedGaussian(ALPHA, OUTLIER_COVARIANCE)

Solver = Callable[[PointSet, PointSet, Array], Estimate]
"""From one fixed set, one moving set and a start (3,) to an estimate."""

SOLVERS: dict[str, Solver] = {
    "likelihood": lambda f, m, start: register(f, m, ROBUST, start),
    "max-mixture": lambda f, m, start: register_mixture(f, m, "max", OUTLIER, start),
    "sum-mixture": lambda f, m, start: register_mixture(f, m, "sum", OUTLIER, start),
    "max-sum-mixture": lambda f, m, start: register_mixture(f, m, "max-sum", OUTLIER, start),
}


def annealed_share(
    scenario: Scenario,
    scales: Sequence[float],
    *,
    inflate_outlier: bool = False,
    robust: bool = True,
    runs: int = 500,
) -> float:
    """Share of the draws that a schedule takes from zero motion to the truth.

    Unlike `d2d.register`, ``inflate_outlier`` widens the outlier component of ``robust``, too.
    """
    fixed, moving = same_draws(scenario, runs)
    theta = np.zeros(3)
    for scale in scales:
        width = scale if inflate_outlier else 1.0
        wide = CorruptedGaussian(ALPHA, width**2 * OUTLIER_COVARIANCE)
        cost = RegistrationCost(outlier=wide if robust else None)
        theta = register(fixed.inflated(scale), moving.inflated(scale), cost, theta).theta
    return float(at_truth(theta - scenario.theta).mean())


class Compared(NamedTuple):
    """The runs of one solver, and the mean time of a run in s."""

    result: MonteCarlo
    seconds: float


@cache
def solved(scenario: Scenario, name: str, off: float = 0.0, runs: int = 60) -> Compared:
    """Register the first draws of a scene one by one; ``off`` is 0 at the truth, 1 at zero."""
    fixed, moving = same_draws(scenario, runs)
    start = scenario.theta * (1.0 - off)
    SOLVERS[name](fixed[0], moving[0], start)  # loads the compiled code
    begin = time.perf_counter()
    estimates = [SOLVERS[name](fixed[run], moving[run], start) for run in range(runs)]
    seconds = (time.perf_counter() - begin) / runs
    return Compared(MonteCarlo.of(stacked(estimates), scenario.theta), seconds)
