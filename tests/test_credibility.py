"""Credibility indices, against drawn errors of known covariance and SciPy's quantiles."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import chi2

from d2d import credibility
from tests.strategies import drawn_errors


def draw_alike(seed: int, runs: int = 1000) -> tuple[np.ndarray, np.ndarray]:
    """Errors drawn from one covariance, of very different size along its axes."""
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    covariance = turn @ np.diag([1.0, 100.0, 1e-4]) @ turn.T
    covariance = 0.5 * (covariance + covariance.T)
    return rng.multivariate_normal(np.zeros(3), covariance, runs), covariance


def test_true_covariances_are_credible():
    """Breaks if Sigma stands for its inverse, n is left out or log is not to base 10."""
    indices = []
    for seed in range(20):
        errors, covariance = draw_alike(seed)
        result = credibility(errors, covariance)
        decibel = 10.0 * np.log10(result.ratio)
        assert_allclose(result.nci, np.abs(decibel).mean(), rtol=1e-12)
        assert_allclose(result.inclination, decibel.mean(), rtol=1e-10)
        # the mean of 3000 squares scatters by sqrt(2 / 3000) = 2.6 %; five of those
        assert_allclose(result.anees, 1.0, atol=0.13)
        assert abs(result.inclination) < 0.35  # dB, three of the same
        expected = np.einsum("ni,ij,nj->n", errors, np.linalg.inv(covariance), errors)
        assert_allclose(result.nees, expected, rtol=1e-9)
        assert_allclose(result.anees, expected.mean() / 3, rtol=1e-9)
        indices.append(result.nci)
    assert_allclose(np.mean(indices), 0.15, atol=0.05)


def test_a_covariance_too_large_shifts_the_inclination_by_its_decibels():
    """Breaks if I^2 is not linear in the covariance's decibels, or its sign is turned round."""
    errors, covariances = drawn_errors(7, 1000)
    honest = credibility(errors, covariances)
    assert honest.consistent
    for factor in (0.01, 0.5, 2.0, 4.0, 1000.0):
        result = credibility(errors, factor * covariances)
        shift = result.inclination - honest.inclination
        assert_allclose(shift, -10.0 * np.log10(factor), rtol=1e-12)
        assert_allclose(result.anees, honest.anees / factor, rtol=1e-12)
        assert_allclose(result.ratio, honest.ratio / factor, rtol=1e-12)
        assert_array_equal(result.credible_nees, honest.credible_nees)
        assert not result.consistent
        assert result.nci >= abs(result.inclination) - 1e-12


def test_bounds_are_those_of_chi_square():
    """Breaks if the degrees of freedom or the tails are wrong."""
    for runs, dimension in ((4, 3), (50, 1), (1000, 3)):
        errors, covariances = drawn_errors(8, runs, dimension)
        for confidence in (0.5, 0.9, 0.95, 0.999):
            result = credibility(errors, covariances, confidence)
            tail = 0.5 * (1.0 - confidence)
            expected = chi2.ppf([tail, 1.0 - tail], runs * dimension) / (runs * dimension)
            assert_allclose(result.bounds, expected, rtol=1e-9)
            assert result.consistent == (expected[0] <= result.anees <= expected[1])


def test_credible_errors_are_measured_against_their_own_mean_square():
    """Breaks if the mean is subtracted: a bias is an error too."""
    errors = drawn_errors(10, 1000)[0] + np.array([5.0, 0.0, -2.0])
    result = credibility(errors, np.eye(3))
    actual = errors.T @ errors / len(errors)
    expected = np.einsum("ni,ij,nj->n", errors, np.linalg.inv(actual), errors)
    assert_allclose(result.credible_nees, expected, rtol=1e-9)
    assert_allclose(result.credible_nees.mean(), 3.0, rtol=1e-12)
    assert_allclose(result.ratio, result.nees / expected, rtol=1e-9)


def test_an_error_of_exactly_zero_counts_as_credible():
    """Breaks if 0 / 0 makes the indices nan."""
    errors = drawn_errors(13, 20)[0]
    errors[4] = 0.0
    result = credibility(errors, np.eye(3))
    assert result.ratio[4] == 1.0
    assert np.isfinite([result.nci, result.inclination]).all()


@pytest.mark.parametrize("power", [-69, -30, 0, 30, 69])
def test_scales_do_not_matter(power):
    """Breaks if squares of small or large errors leave the range of floating point numbers."""
    errors = np.random.default_rng(0).standard_normal((50, 3))
    expected = credibility(errors, np.eye(3))
    found = credibility(10.0**power * errors, np.eye(3) * 10.0**power * 10.0**power)
    assert found.nci == pytest.approx(expected.nci)
    with pytest.raises(ValueError, match=r"^(errors|covariances) "):
        credibility(1e160 * errors, 1e-160 * np.eye(3))
    with pytest.raises(ValueError, match=r"^(errors|covariances) "):
        credibility(1e-200 * errors, np.eye(3))
