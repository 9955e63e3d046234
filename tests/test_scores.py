"""Proper scores, against SciPy's densities and integrals, and by their means on drawn errors."""

from itertools import permutations

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import quad
from scipy.stats import multivariate_normal, norm

from d2d import coverage, credibility, crps, log_score, whiten
from tests.strategies import drawn_errors


def test_log_score_is_the_negative_log_density():
    """Breaks if the constant, the determinant or a factor of one half is off."""
    for dimension in (1, 2, 3, 5):
        errors, covariances = drawn_errors(0, 20, dimension)
        expected = [
            -multivariate_normal(cov=c).logpdf(e) for e, c in zip(errors, covariances, strict=True)
        ]
        assert_allclose(log_score(errors, covariances), expected, rtol=1e-9)


def test_each_component_is_taken_given_those_before_it():
    """Breaks if the order is applied backwards, or a column is returned in another place."""
    errors, covariances = drawn_errors(1, 6)
    for order in permutations(range(3)):
        parts = whiten(errors, covariances, order)
        for e, c, value, sigma in zip(errors, covariances, parts.values, parts.sigmas, strict=True):
            for place, i in enumerate(order):
                before = list(order[:place])
                gain = c[i, before] @ np.linalg.inv(c[np.ix_(before, before)])
                variance = c[i, i] - gain @ c[before, i]
                assert_allclose(sigma[i] ** 2, variance, rtol=1e-7)
                assert_allclose(value[i], (e[i] - gain @ e[before]) / np.sqrt(variance), rtol=1e-6)
        nees = credibility(errors, covariances).nees
        assert_allclose((parts.values**2).sum(axis=1), nees, rtol=1e-7)
        assert_allclose(parts.log_score.sum(axis=1), log_score(errors, covariances), rtol=1e-8)
    default, last = whiten(errors, covariances), whiten(errors, covariances, (0, 1, 2))
    assert_array_equal(default.values, last.values)
    assert_array_equal(default.sigmas, last.sigmas)


def test_crps_is_the_integral_of_squared_differences_of_distributions():
    """Breaks if a term of the closed form is off."""
    for error, sigma in [(0.0, 1.0), (0.7, 0.2), (-3.0, 2.0), (40.0, 0.5)]:
        top = max(12 * sigma, error)
        below = quad(lambda x, s: norm.cdf(x, scale=s) ** 2, -12 * sigma, error, sigma, limit=200)
        above = quad(lambda x, s: norm.sf(x, scale=s) ** 2, error, top, sigma, limit=200)
        assert_allclose(crps(error, sigma), below[0] + above[0], rtol=1e-6)
    assert crps(-1e200, 1e-150) == 1e200


def test_no_other_covariance_scores_better_than_the_true_one():
    """Breaks if a component's score rewards covariances that are too small or too large."""
    errors, covariances = drawn_errors(8, 4000)
    right = whiten(errors, covariances, (2, 1, 0))
    for factor in (0.5, 2.0):
        other = whiten(errors, factor * covariances, (2, 1, 0))
        for gain in (other.log_score - right.log_score, other.crps - right.crps):
            assert (gain.mean(axis=0) > 3.0 * gain.std(axis=0) / np.sqrt(len(gain))).all()


def test_gaussian_errors_are_covered_as_often_as_the_levels_say():
    """Breaks if the quantile is of another tail or of another dimension."""
    levels = np.array([0.1, 0.5, 0.95, 0.99])
    runs = 20_000
    scatter = np.sqrt(levels * (1.0 - levels) / runs)
    for dimension in (1, 3):
        errors, covariances = drawn_errors(10, runs, dimension)
        assert (np.abs(coverage(errors, covariances, levels) - levels) < 4.0 * scatter).all()
        inside = whiten(errors, covariances).within(levels)
        assert inside.shape == (runs, dimension, 4)
        assert (np.abs(inside.mean(axis=0) - levels) < 4.5 * scatter).all()
