"""Fisher covariance: the inverse of a positive definite Hessian, nan of any other."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d import fisher_covariance
from tests.strategies import spd


def definite(rng: np.random.Generator, *shape: int) -> np.ndarray:
    root = rng.standard_normal((*shape, 3, 3))
    return root @ np.swapaxes(root, -1, -2) + 0.1 * np.eye(3)


@pytest.mark.parametrize("parameters", [1, 2, 3])
def test_it_is_the_symmetric_inverse(parameters):
    """Breaks if the matrix is returned as it is, or the inverse is not symmetric."""
    hessians = spd(np.random.default_rng(1), 20, parameters)
    covariances = fisher_covariance(hessians)
    assert_allclose(covariances @ hessians, np.eye(parameters)[None].repeat(20, 0), atol=1e-9)
    assert_array_equal(covariances, np.swapaxes(covariances, 1, 2))
    assert_allclose(fisher_covariance(hessians[0]), covariances[0], rtol=1e-14)


def test_units_do_not_matter():
    """Breaks if a parameter in small units is called singular: metres beside microradians."""
    units = np.diag([1e-7, 1.0, 1e7])
    hessian = definite(np.random.default_rng(2))
    covariance = fisher_covariance(units @ hessian @ units)
    assert_allclose(units @ covariance @ units, fisher_covariance(hessian), rtol=1e-6)


@pytest.mark.parametrize(
    "hessian",
    [
        np.diag([1.0, 1.0, -1.0]),
        np.diag([1.0, 1.0, 0.0]),
        -np.eye(3),
        np.zeros((3, 3)),
        np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        np.array([[1.0, 1.0], [1.0, 1.0]]),
        np.diag([1.0, np.nan, 1.0]),
        np.diag([1.0, np.inf, 1.0]),
        np.full((3, 3), np.nan),
        np.array([[0.0]]),
        np.array([[-2.0]]),
    ],
    ids=lambda value: str(value).replace("\n", ""),
)
def test_what_is_no_minimum_has_no_covariance(hessian):
    """Breaks if an indefinite, singular or undefined Hessian is inverted all the same."""
    assert np.isnan(fisher_covariance(hessian)).all()


def test_a_singular_matrix_with_rounding_errors_has_no_covariance():
    """Breaks if rounding above zero counts as definite: variances of 1e16, or a LinAlgError."""
    rng = np.random.default_rng(3)
    for _ in range(300):
        root = rng.standard_normal((3, rng.integers(1, 3)))
        assert np.isnan(fisher_covariance(root @ root.T)).all()


def test_one_bad_matrix_does_not_spoil_its_batch():
    """Breaks if a batch is refused, or its members change places, because of one of them."""
    hessians = definite(np.random.default_rng(4), 4, 5)
    hessians[1, 2] = np.nan
    hessians[3, 0] *= -1.0
    covariances = fisher_covariance(hessians)
    bad = np.zeros((4, 5), dtype=bool)
    bad[1, 2] = bad[3, 0] = True
    assert_array_equal(np.isnan(covariances).all(axis=(-2, -1)), bad)
    assert_array_equal(np.isnan(covariances).any(axis=(-2, -1)), bad)
    for index in np.argwhere(~bad):
        i = tuple(index)
        assert_allclose(covariances[i], np.linalg.inv(hessians[i]), rtol=1e-10)


def test_no_matrices_have_no_covariances():
    """Breaks if an empty batch, such as one where nothing converged, is an error."""
    assert fisher_covariance(np.zeros((0, 3, 3))).shape == (0, 3, 3)


def test_rounding_errors_of_symmetry_are_forgiven():
    """Breaks if a Hessian computed in single precision is refused, or a large entry's rounding."""
    hessian = definite(np.random.default_rng(6))
    hessian[0, 1] *= 1.0 + 1e-7
    covariance = fisher_covariance(hessian)
    assert_array_equal(covariance, covariance.T)
    assert np.isnan(fisher_covariance([[1e-20, 1.0], [1.0 + 1e-15, 1e-20]])).all()


def test_its_input_stays_as_it_is():
    """Breaks if the caller's Hessian is overwritten."""
    hessian = definite(np.random.default_rng(5))
    before = hessian.copy()
    fisher_covariance(hessian)
    assert_array_equal(hessian, before)


@pytest.mark.parametrize(
    "hessian",
    [
        1.0,
        [1.0, 2.0],
        np.ones((2, 3)),
        np.zeros((0, 0)),
        np.zeros((4, 0, 0)),
        "curved",
        None,
        [[1.0, 0.5], [0.4, 1.0]],
        [[1e-8, 0.5], [0.4, 1e8]],
        [np.eye(2), [[1.0, 1e-5], [0.0, 1.0]]],
    ],
    ids=lambda value: str(value),
)
def test_what_is_no_matrix_is_refused_by_name(hessian):
    """Breaks if the error does not say which argument was meant."""
    with pytest.raises(ValueError, match="hessian"):
        fisher_covariance(hessian)
