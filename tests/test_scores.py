"""Proper scores, against simulation, SciPy's densities and closed forms in one dimension."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import quad
from scipy.stats import chi2, multivariate_normal, norm

from d2d import coverage, credibility, crps, log_score, whiten
from tests.strategies import spd


def draw(seed: int, runs: int, dimension: int = 3):
    """Errors drawn from covariances that differ from run to run."""
    rng = np.random.default_rng(seed)
    covariances = spd(rng, runs, dimension)
    errors = np.einsum(
        "nij,nj->ni", np.linalg.cholesky(covariances), rng.standard_normal((runs, dimension))
    )
    return errors, covariances


# ---- Log score and whitening ------------------------------------------------------------------


def test_log_score_is_the_negative_log_density():
    """Breaks if the constant, the determinant or a factor of one half is off."""
    for dimension in (1, 2, 3, 5):
        errors, covariances = draw(0, 20, dimension)
        pairs = zip(errors, covariances, strict=True)
        expected = [-multivariate_normal(cov=c).logpdf(e) for e, c in pairs]
        assert_allclose(log_score(errors, covariances), expected, rtol=1e-9)


def test_each_direction_is_taken_given_those_before_it():
    """Breaks if the order is applied backwards, or a column is returned in another place."""
    errors, covariances = draw(1, 6)
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


def test_whitened_credible_errors_are_independent_of_unit_variance():
    """Breaks if the factor is applied from the wrong side."""
    values = whiten(*draw(2, 20_000), (2, 1, 0)).values
    # a covariance of 20 000 unit normals scatters by 0.7 %, a variance by 1 %
    assert_allclose(values.T @ values / len(values), np.eye(3), atol=0.04)


def test_order_is_the_components_own_by_default():
    """Breaks if the default is another order than it says."""
    errors, covariances = draw(3, 5)
    one, two = whiten(errors, covariances), whiten(errors, covariances, (0, 1, 2))
    assert_array_equal(one.values, two.values)
    assert_array_equal(one.sigmas, two.sigmas)


# ---- CRPS -------------------------------------------------------------------------------------


def test_crps_is_the_integral_of_squared_differences_of_distributions():
    """Breaks if a term of the closed form is off."""
    for error, sigma in ((0.0, 1.0), (0.7, 0.2), (-3.0, 2.0), (40.0, 0.5)):
        own, top = norm(scale=sigma), max(12 * sigma, error)
        below = quad(lambda x, own=own: own.cdf(x) ** 2, -12 * sigma, error, limit=200)[0]
        above = quad(lambda x, own=own: own.sf(x) ** 2, error, top, limit=200)[0]
        assert_allclose(crps(error, sigma), below + above, rtol=1e-6)


# ---- Propriety --------------------------------------------------------------------------------


def test_no_other_covariance_scores_better_than_the_true_one():
    """Breaks if the score rewards covariances that are too small or too large."""
    errors, covariances = draw(8, 4000)
    turned_round = covariances * np.array([[1.0, -1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, -1.0, 1.0]])
    for wrong in (
        0.6 * covariances,
        1.6 * covariances,
        turned_round,
        np.linalg.inv(covariances),
    ):
        gain = log_score(errors, wrong) - log_score(errors, covariances)
        assert gain.mean() > 3.0 * gain.std() / np.sqrt(len(gain))


def test_conditional_scores_are_proper_too():
    """Breaks if a direction's standard deviation is not the one its error has."""
    errors, covariances = draw(9, 4000)
    right = whiten(errors, covariances, (2, 1, 0))
    for factor in (0.5, 2.0):
        other = whiten(errors, factor * covariances, (2, 1, 0))
        for one, two in ((right.log_score, other.log_score), (right.crps, other.crps)):
            gain = two - one
            assert (gain.mean(axis=0) > 3.0 * gain.std(axis=0) / np.sqrt(len(gain))).all()


# ---- Coverage ---------------------------------------------------------------------------------


@pytest.mark.parametrize("dimension", [1, 3])
def test_gaussian_errors_are_covered_as_often_as_the_levels_say(dimension):
    """Breaks if the quantile is of another tail or of another dimension."""
    levels = np.array([0.1, 0.5, 0.95, 0.99])
    runs = 20_000
    errors, covariances = draw(10, runs, dimension)
    scatter = np.sqrt(levels * (1.0 - levels) / runs)
    assert (np.abs(coverage(errors, covariances, levels) - levels) < 4.0 * scatter).all()
    inside = whiten(errors, covariances).within(levels)
    assert inside.shape == (runs, dimension, 4)
    assert (np.abs(inside.mean(axis=0) - levels) < 4.5 * scatter).all()


def test_an_ellipsoid_contains_what_its_quantile_says():
    """Breaks if the length of an error is compared with its square."""
    edge = np.sqrt(chi2.ppf(0.95, 3))
    errors = np.array([[0.999 * edge, 0.0, 0.0], [0.0, 1.001 * edge, 0.0]])
    assert_array_equal(coverage(errors, np.eye(3), 0.95), 0.5)
    assert_array_equal(coverage(2.0 * errors, 4.0 * np.eye(3), [0.95]), [0.5])
