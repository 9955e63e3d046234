"""Where the thesis's evaluation may differ from this one: each difference alone."""

import numpy as np
from scipy.optimize import minimize

from d2d._checks import Array
from d2d.cost import CorruptedGaussian, RegistrationCost
from d2d.credibility import Credibility, credibility
from d2d.point_set import PointSet
from d2d.study.evaluation import ALPHA, OUTLIER_COVARIANCE, SUMMING, Start, evaluated
from d2d.study.scenarios import Scenario


def same_draws(scenario: Scenario, runs: int = 1000) -> tuple[PointSet, PointSet]:
    """The first sets that `evaluated` registers: those of `monte_carlo` with seed 0, 1000 runs."""
    child = np.random.SeedSequence(0).spawn(1)[0]
    fixed, moving = scenario.sample(1000, np.random.default_rng(child))
    return fixed[:runs], moving[:runs]


def bfgs_errors(
    scenario: Scenario,
    cost: RegistrationCost,
    initial: Start,
    runs: int = 100,
    *,
    density: bool = False,
) -> Array:
    """Errors (runs, 3) of SciPy's BFGS with our gradient, a stand-in for the thesis's optimiser.

    With ``density`` it maximises the fused density as the thesis writes it, without the logarithm.
    """
    fixed, moving = same_draws(scenario, runs)
    start = scenario.theta * (initial == "truth")

    def one(run: int) -> Array:
        def objective(theta: Array) -> tuple[float, Array]:
            value, gradient, _ = cost.derivatives(theta, fixed[run], moving[run])
            if not density:
                return float(value), gradient
            fused = float(np.exp(-value))
            return -fused, fused * gradient

        return np.asarray(minimize(objective, start, jac=True, method="BFGS").x) - scenario.theta

    return np.array([one(run) for run in range(runs)])


def plain_sum_credibility(scenario: Scenario, unit: float = 1.0) -> Credibility:
    """Of the sum if its Hessian is that of the density -f, with lengths in ``unit`` metres.

    At the optimum the Hessian of -f is f times that of -log f; f has the unit of 1 / area.
    """
    result = evaluated(scenario, SUMMING)
    fixed, moving = same_draws(scenario, len(result.errors))
    f = np.exp(-SUMMING.value(result.errors + scenario.theta, fixed, moving)) * unit**2
    return credibility(result.errors, result.covariances / f[:, np.newaxis, np.newaxis])


def unweighted_outlier(targets: int) -> RegistrationCost:
    """The robust likelihood with the outlier component as thesis eq. 6.4 prints it, without w_i.

    That component then weighs N = ``targets`` times too much.  A constant factor of a target's
    density moves no optimum, so that (1 - a) q + a N o stands for the outlier share a N / (1 - a +
    a N).
    """
    share = ALPHA * targets / (1.0 - ALPHA + ALPHA * targets)
    return RegistrationCost(outlier=CorruptedGaussian(share, OUTLIER_COVARIANCE))
