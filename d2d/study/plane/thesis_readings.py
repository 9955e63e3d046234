"""Ways in which the thesis's evaluation may differ from this one, each tried on its own."""

import numpy as np
import scipy

from d2d._types import Array
from d2d.cost import CorruptedGaussian, RegistrationCost
from d2d.credibility import Credibility, credibility
from d2d.study.plane.evaluation import (
    ALPHA,
    OUTLIER_COVARIANCE,
    SUMMING,
    Start,
    evaluated,
    same_draws,
)
from d2d.study.plane.scenarios import Scenario


def bfgs_errors(
    scenario: Scenario, cost: RegistrationCost, initial: Start, *, density: bool = False
) -> Array:
    """Errors (100, 3) of SciPy's BFGS, on the logarithm, or with ``density`` on the density."""
    runs = 100
    fixed, moving = same_draws(scenario, runs)
    start = scenario.theta * (initial == "truth")

    def error(run: int) -> Array:
        def objective(theta: Array) -> tuple[float, Array]:
            value, gradient, _ = cost.derivatives(theta, fixed[run], moving[run])
            if not density:
                return float(value), gradient
            fused = float(np.exp(-value))
            return -fused, fused * gradient

        found = scipy.optimize.minimize(objective, start, jac=True, method="BFGS")
        return np.asarray(found.x - scenario.theta)

    return np.array([error(run) for run in range(runs)])


def plain_sum_credibility(scenario: Scenario, unit: float = 1.0) -> Credibility:
    """Credibility of the sum if its Hessian is that of -f, with f the fused density.

    At the optimum it is f times that of -log f; f is per area, with lengths in ``unit`` metres.
    """
    result = evaluated(scenario, SUMMING)
    fixed, moving = same_draws(scenario, len(result.errors))
    f = np.exp(-SUMMING.value(result.errors + scenario.theta, fixed, moving)) * unit**2
    return credibility(result.errors, result.covariances / f[:, np.newaxis, np.newaxis])


def unweighted_outlier(targets: int) -> RegistrationCost:
    """The robust likelihood with the outlier component as thesis eq. 6.4 prints it, without w_i.

    It then weighs N = ``targets`` times too much: equivalent to the share a N / (1 - a + a N).
    """
    share = ALPHA * targets / (1.0 - ALPHA + ALPHA * targets)
    return RegistrationCost(outlier=CorruptedGaussian(share, OUTLIER_COVARIANCE))
