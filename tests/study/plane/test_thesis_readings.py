"""Other readings of the thesis, each against what it stands for."""

import numpy as np
import pytest

from d2d import CorruptedGaussian, RegistrationCost
from d2d.study import scenarios
from d2d.study.plane.evaluation import LIKELIHOOD, ROBUST, SUMMING, evaluated, same_draws
from d2d.study.plane.thesis_readings import bfgs_errors, plain_sum_credibility, unweighted_outlier
from tests.strategies import central_difference


def test_bfgs_finds_the_same_optimum_from_the_truth() -> None:
    errors = bfgs_errors(scenarios.OVERLAPPED, ROBUST, "truth")
    ours = evaluated(scenarios.OVERLAPPED, ROBUST).errors[:100]
    np.testing.assert_allclose(errors, ours, atol=1e-4)


def test_hessian_of_the_plain_sum_by_differences() -> None:
    """The Hessian of -f is f times that of -log f at an optimum."""
    fixed, moving = same_draws(scenarios.OVERLAPPED)
    truth = scenarios.OVERLAPPED.theta
    result = evaluated(scenarios.OVERLAPPED, SUMMING)
    steps = np.full(3, 1e-3)

    def density(theta: np.ndarray) -> np.ndarray:
        return np.exp(-SUMMING.value(theta, fixed[0], moving[0]))

    best = truth + result.errors[0]
    hessian = -central_difference(lambda x: central_difference(density, x, steps), best, steps)
    nees = result.errors[0] @ hessian @ result.errors[0]
    for unit in (1.0, 2.0):  # m, of which the density has the inverse square
        found = plain_sum_credibility(scenarios.OVERLAPPED, unit)
        assert found.nees[0] == pytest.approx(nees * unit**2, rel=1e-3)


def test_unweighted_outlier_component_is_that_of_the_thesis() -> None:
    """Its target densities are proportional to (1 - a) q + a sum_i N, without w_i."""
    fixed, moving = (each[0] for each in same_draws(scenarios.OUTLIERS, 1))
    theta, count = scenarios.OUTLIERS.theta, fixed.size
    plain = LIKELIHOOD.target_densities(theta, fixed, moving)
    wide = RegistrationCost(outlier=CorruptedGaussian(1.0, 100.0 * np.eye(2)))
    printed = 0.8 * plain + 0.2 * count * wide.target_densities(theta, fixed, moving)
    ours = unweighted_outlier(count).target_densities(theta, fixed, moving)
    np.testing.assert_allclose(printed / ours, printed[0] / ours[0])
