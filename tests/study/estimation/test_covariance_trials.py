"""What the covariances claim, against what is known of it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d import credibility, propagate_covariance, register
from d2d.study import scenarios
from d2d.study.estimation import covariance_trials
from d2d.study.plane.evaluation import ROBUST, same_draws


def test_the_kurtosis_of_errors_is_not_their_scale():
    """Breaks if the stated covariance, or any scale or correlation, has a part in it."""
    rng = np.random.default_rng(2)
    normal = rng.standard_normal((20_000, 3))
    mixed = 7.0 * normal @ np.array([[1.0, 0.3, 0.0], [0.0, 0.01, 0.2], [0.1, 0.0, 2.0]]) + 5.0
    found, same = map(covariance_trials.kurtosis_of, (normal, mixed))
    assert same == pytest.approx(found)
    assert found == pytest.approx(1.0, abs=0.03)
    heavy = covariance_trials.kurtosis_of(normal * rng.gamma(3.0, size=(20_000, 1)))
    assert heavy > 1.3


@pytest.mark.parametrize("count", [1, 3])
def test_a_shared_partner_counts_once_for_every_target(count):
    """Breaks if the Hessian knew of it, or if error propagation did not."""
    found = covariance_trials.shared_partner(count)
    assert found.fisher == pytest.approx(found.expected, rel=0.06)
    assert found.propagated == pytest.approx(1.0, abs=0.05)


def test_both_covariances_are_those_of_the_same_errors():
    """Breaks if the two are computed from different draws, or change places."""
    found = covariance_trials.in_scene(scenarios.OVERLAPPED, "robust", 200)
    fixed, moving = same_draws(scenarios.OVERLAPPED, 200)
    estimate = register(fixed, moving, ROBUST, scenarios.OVERLAPPED.theta)
    errors = estimate.theta - scenarios.OVERLAPPED.theta
    propagated = propagate_covariance(estimate, fixed, moving, ROBUST)
    assert_allclose(
        found.credibility("inverse Hessian").nees, credibility(errors, estimate.covariance).nees
    )
    assert_allclose(found.credibility("propagated").nees, credibility(errors, propagated).nees)
