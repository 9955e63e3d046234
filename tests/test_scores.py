"""Proper scores, against simulation, SciPy's densities and closed forms in one dimension."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import quad
from scipy.stats import chi2, multivariate_normal, norm

from d2d import coverage, credibility, crps, energy_score, log_score, whiten
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


@pytest.mark.parametrize("dimension", [1, 2, 3, 5])
def test_log_score_is_the_negative_log_density(dimension):
    """Breaks if the constant, the determinant or a factor of one half is off."""
    errors, covariances = draw(0, 20, dimension)
    expected = [
        -multivariate_normal(cov=c).logpdf(e) for e, c in zip(errors, covariances, strict=True)
    ]
    assert_allclose(log_score(errors, covariances), expected, rtol=1e-9)


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_each_direction_is_taken_given_those_before_it(order):
    """Breaks if the order is applied backwards, or a column is returned in another place."""
    errors, covariances = draw(1, 6)
    parts = whiten(errors, covariances, order)
    for e, c, value, sigma in zip(errors, covariances, parts.values, parts.sigmas, strict=True):
        for place, i in enumerate(order):
            before = list(order[:place])
            gain = c[i, before] @ np.linalg.inv(c[np.ix_(before, before)])
            variance = c[i, i] - gain @ c[before, i]
            assert_allclose(sigma[i] ** 2, variance, rtol=1e-7)
            assert_allclose(value[i], (e[i] - gain @ e[before]) / np.sqrt(variance), rtol=1e-6)
    assert_allclose((parts.values**2).sum(axis=1), credibility(errors, covariances).nees, rtol=1e-7)
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


# ---- CRPS and energy score --------------------------------------------------------------------


@pytest.mark.parametrize(("error", "sigma"), [(0.0, 1.0), (0.7, 0.2), (-3.0, 2.0), (40.0, 0.5)])
def test_crps_is_the_integral_of_squared_differences_of_distributions(error, sigma):
    """Breaks if a term of the closed form is off."""
    below = quad(lambda x: norm.cdf(x, scale=sigma) ** 2, -12 * sigma, error, limit=200)[0]
    top = max(12 * sigma, error)
    above = quad(lambda x: norm.sf(x, scale=sigma) ** 2, error, top, limit=200)[0]
    assert_allclose(crps(error, sigma), below + above, rtol=1e-6)


def test_energy_score_in_one_dimension_is_the_crps():
    """Breaks if the quadrature misses a tail, or an expectation has another factor."""
    rng = np.random.default_rng(4)
    errors, variances = 3.0 * rng.standard_normal(200), 10.0 ** rng.uniform(-8, 3, 200)
    found = energy_score(errors[:, None], variances[:, None, None])
    assert_allclose(found, crps(errors, np.sqrt(variances)), rtol=1e-7)


def test_energy_score_is_that_of_its_definition():
    """Breaks if the axes of a covariance and the errors are turned against each other."""
    errors, covariances = draw(5, 4)
    rng = np.random.default_rng(6)
    for e, c, found in zip(errors, covariances, energy_score(errors, covariances), strict=True):
        x, other = rng.multivariate_normal(np.zeros(3), c, (2, 200_000))
        terms = np.linalg.norm(x - e, axis=1) - 0.5 * np.linalg.norm(x - other, axis=1)
        assert abs(terms.mean() - found) < 5.0 * terms.std() / np.sqrt(len(terms))


def test_energy_score_in_three_equal_directions_is_that_of_the_chi_distribution():
    """Breaks if the quadrature is less exact than it says."""
    # E |Z| = sqrt(8 / pi) in three dimensions
    length = np.sqrt(8.0 / np.pi)
    found = energy_score(np.zeros((1, 3)), 4.0 * np.eye(3))
    assert_allclose(found, 2.0 * length * (1.0 - np.sqrt(0.5)), rtol=1e-8)


def test_energy_score_scales_with_the_unit():
    """Breaks if the nodes of the quadrature have a length of their own."""
    errors, covariances = draw(7, 10)
    one = energy_score(errors, covariances)
    assert_allclose(energy_score(1e6 * errors, 1e12 * covariances), 1e6 * one, rtol=1e-8)


# ---- Propriety --------------------------------------------------------------------------------


@pytest.mark.parametrize("score", [log_score, energy_score])
@pytest.mark.parametrize(
    "wrong",
    [
        lambda c: 0.6 * c,
        lambda c: 1.6 * c,
        lambda c: c * np.array([[1.0, -1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, -1.0, 1.0]]),
        lambda c: np.linalg.inv(c),
    ],
    ids=["too small", "too large", "correlations turned round", "inverse"],
)
def test_no_other_covariance_scores_better_than_the_true_one(score, wrong):
    """Breaks if a score rewards covariances that are too small or too large."""
    errors, covariances = draw(8, 4000)
    gain = score(errors, wrong(covariances)) - score(errors, covariances)
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


# ---- Bad input --------------------------------------------------------------------------------

ERRORS = draw(11, 6, 2)[0]


@pytest.mark.parametrize("score", [whiten, log_score, energy_score, coverage])
@pytest.mark.parametrize(
    ("errors", "covariances", "name"),
    [
        (ERRORS[0], np.eye(2), "errors"),
        (ERRORS[:0], np.eye(2), "errors"),
        (ERRORS * np.nan, np.eye(2), "errors"),
        (ERRORS, np.eye(3), "covariances"),
        (ERRORS, np.eye(2)[None].repeat(5, axis=0), "covariances"),
        (ERRORS, np.diag([1.0, -1.0]), "covariances"),
        (ERRORS, np.diag([1.0, np.nan]), "covariances"),
    ],
)
def test_errors_and_covariances_that_do_not_fit_are_refused(score, errors, covariances, name):
    """Breaks if estimates that did not converge give a score."""
    with pytest.raises(ValueError, match=name):
        score(errors, covariances)


@pytest.mark.parametrize("order", [(0,), (0, 0), (1, 2), (0.5, 1), "10", None, 3, [[0, 1]]])
def test_order_must_be_a_permutation(order):
    """Breaks if a direction is counted twice or left out."""
    if order is None:
        whiten(ERRORS, np.eye(2), order)
    else:
        with pytest.raises(ValueError, match="order"):
            whiten(ERRORS, np.eye(2), order)


@pytest.mark.parametrize("levels", [0.0, 1.0, [0.5, 1.5], np.nan, [[0.5]], "most", None])
def test_levels_must_lie_within_zero_and_one(levels):
    """Breaks if a share in percent is taken for a level."""
    with pytest.raises(ValueError, match="levels"):
        coverage(ERRORS, np.eye(2), levels)


def test_standard_deviations_must_be_positive_and_fit():
    """Breaks if a variance of zero gives a score of nan."""
    with pytest.raises(ValueError, match="sigmas"):
        crps(1.0, 0.0)
    with pytest.raises(ValueError, match="broadcast"):
        crps(np.ones(3), np.ones(2))
