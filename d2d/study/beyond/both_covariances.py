"""Both covariances of every cost in every scene: inverse Hessian and propagation."""

import time
from functools import cache
from typing import NamedTuple

from d2d.cost import RegistrationCost
from d2d.covariance import propagate_covariance
from d2d.credibility import Credibility
from d2d.registration import register
from d2d.study.plane.evaluation import COSTS, same_draws
from d2d.study.plane.scenarios import Scenario
from d2d.study.runs import judged

ALL_COSTS = COSTS | {"P2D": RegistrationCost("p2d")}


class BothCovariances(NamedTuple):
    """How credible each covariance of the same errors is."""

    fisher: Credibility
    propagated: Credibility
    slowdown: float  # time of the propagation over that of the registration


@cache
def both_covariances(scenario: Scenario, cost: str, runs: int = 1000) -> BothCovariances:
    """Credibility of both covariances of a cost of `ALL_COSTS`, started at the true motion.

    The draws are those of `d2d.study.plane.evaluation.evaluated`.
    """
    fixed, moving = same_draws(scenario, runs)
    register(fixed[0], moving[0], ALL_COSTS[cost], scenario.theta)  # loads the compiled code
    begin = time.perf_counter()
    estimate = register(fixed, moving, ALL_COSTS[cost], scenario.theta)
    middle = time.perf_counter()
    propagated = propagate_covariance(estimate, fixed, moving, ALL_COSTS[cost])
    slowdown = (time.perf_counter() - middle) / (middle - begin)
    return BothCovariances(
        judged(estimate, scenario.theta), judged(estimate, scenario.theta, propagated), slowdown
    )
