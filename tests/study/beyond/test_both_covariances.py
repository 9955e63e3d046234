"""Both covariances, against the plain calls that they stand for."""

from numpy.testing import assert_allclose

from d2d import credibility, propagate_covariance, register
from d2d.study import scenarios
from d2d.study.beyond.both_covariances import both_covariances
from d2d.study.plane.evaluation import ROBUST, same_draws


def test_both_covariances_are_those_of_the_same_errors() -> None:
    """Breaks if the two are computed from different draws, or change places."""
    found = both_covariances(scenarios.OVERLAPPED, "robust", 200)
    fixed, moving = same_draws(scenarios.OVERLAPPED, 200)
    estimate = register(fixed, moving, ROBUST, scenarios.OVERLAPPED.theta)
    errors = estimate.theta - scenarios.OVERLAPPED.theta
    propagated = propagate_covariance(estimate, fixed, moving, ROBUST)
    assert_allclose(found.fisher.nees, credibility(errors, estimate.covariance).nees)
    assert_allclose(found.propagated.nees, credibility(errors, propagated).nees)
