"""Six reasons for a covariance that is too small: each is as large as it is by construction."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d import PointSet, register
from d2d.study.guides import small_covariance as small
from d2d.study.plane.evaluation import LIKELIHOOD
from d2d.study.plane.scenarios import OVERLAPPED

THETA = OVERLAPPED.theta
FIXED, MOVING = OVERLAPPED.sample(400, np.random.default_rng(3))


def test_repeated_targets_divide_the_covariance_and_nothing_else():
    """Breaks if a copy has an error of its own, or moves the optimum."""
    one = register(FIXED[:5], MOVING[:5], LIKELIHOOD, THETA)
    three = register(small.repeated(FIXED[:5], 3), small.repeated(MOVING[:5], 3), LIKELIHOOD, THETA)
    assert_allclose(three.theta, one.theta, atol=1e-6)
    assert_allclose(three.covariance, one.covariance / 3.0, rtol=1e-4)


def test_unit_weights_are_repaired_by_the_residuals():
    """Breaks if the variance of the residuals is not that of two points."""
    rng = np.random.default_rng(0)
    noisy = [
        PointSet(
            0.3 * rng.standard_normal((4000, 8, 2)) + true, np.eye(2) + np.zeros((4000, 8, 2, 2))
        )
        for true in OVERLAPPED.true_sets
    ]
    found = register(*noisy, LIKELIHOOD, THETA)
    variance = small.residual_variance(found.theta, *noisy) / 2.0
    assert variance.mean() == pytest.approx(0.09, rel=0.05)
    scaled = small.judged(found, THETA, found.covariance * variance[:, None, None])
    # with 13 degrees of freedom the variance itself is known roughly: E(1 / chi^2) = 1 / 11
    assert scaled.anees == pytest.approx(13.0 / 11.0, rel=0.05)
    assert small.judged(found, THETA).anees < 0.15


def test_halves_are_of_different_targets():
    """Breaks if both halves hold the same targets, or the first half always the same ones."""
    each = small.halves(FIXED, MOVING, LIKELIHOOD, THETA, np.arange(8))
    assert each.anees == pytest.approx(1.0, abs=0.15)
    pairs = small.halves(FIXED, MOVING, LIKELIHOOD, THETA, np.arange(8) // 2)
    assert pairs.anees == pytest.approx(1.0, abs=0.15)
    assert abs(pairs.nees - each.nees).max() > 0.1
    two = small.repeated(FIXED, 2), small.repeated(MOVING, 2)
    together = small.halves(*two, LIKELIHOOD, THETA, np.repeat(np.arange(8), 2))
    assert_allclose(together.nees, 2.0 * each.nees, rtol=0.05)


def test_a_bias_does_not_average_out():
    """Breaks if the error falls with the number of targets as the inverse Hessian does."""
    rows = small.bias_against_targets()
    first, last = rows.iloc[0], rows.iloc[-1]
    assert last.targets > 4.0 * first.targets
    assert last.stated < 0.5 * first.stated
    assert last.rmse > 2.0 * last.stated
    assert (rows.budgeted / rows.rmse).between(0.7, 1.1).all()
