"""Fisher covariance: the inverse of a positive definite Hessian, nan of any other."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from d2d import fisher_covariance
from tests.strategies import reals, seeds, spd


@given(seeds, st.integers(1, 4), reals(-7.0, 7.0), reals(-7.0, 7.0))
def test_it_is_the_symmetric_inverse_in_any_units(seed, size, first, last):
    """Breaks if parameters of very different units make a good Hessian look singular."""
    root = np.random.default_rng(seed).standard_normal((3, size, size))
    unit = 10.0 ** np.linspace(first, last, size)
    well = root @ np.swapaxes(root, -1, -2) + np.eye(size)
    hessian = well * np.outer(unit, unit)
    before = hessian.copy()
    covariance = fisher_covariance(hessian)
    assert_array_equal(hessian, before)
    assert_array_equal(covariance, np.swapaxes(covariance, 1, 2))
    assert_allclose(covariance * np.outer(unit, unit), np.linalg.inv(well), rtol=1e-6, atol=1e-9)


def test_what_is_no_minimum_has_no_covariance():
    """Breaks if an indefinite, singular or undefined Hessian is inverted all the same."""
    for hessian in (
        np.diag([1.0, 1.0, -1.0]),
        np.diag([1.0, 1.0, 0.0]),
        -np.eye(3),
        np.zeros((3, 3)),
        [[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        np.ones((2, 2)),
        np.diag([1.0, np.nan, 1.0]),
        np.diag([1.0, np.inf, 1.0]),
        [[0.0]],
        [[-2.0]],
    ):
        assert np.isnan(fisher_covariance(hessian)).all(), hessian


def test_a_singular_matrix_with_rounding_errors_has_no_covariance():
    """Breaks if rounding above zero counts as definite: variances of 1e16, or a LinAlgError."""
    rng = np.random.default_rng(3)
    for _ in range(300):
        root = rng.standard_normal((3, rng.integers(1, 3)))
        assert np.isnan(fisher_covariance(root @ root.T)).all()


def test_one_bad_matrix_does_not_spoil_its_batch():
    """Breaks if a batch is refused, or its members change places, because of one of them."""
    hessians = spd(np.random.default_rng(4), 20, 3).reshape(4, 5, 3, 3)
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


def test_rounding_errors_of_symmetry_are_forgiven():
    """Breaks if a Hessian computed in single precision is refused, or a large entry's rounding."""
    hessian = spd(np.random.default_rng(6), 1, 3)[0]
    hessian[0, 1] *= 1.0 + 1e-7
    covariance = fisher_covariance(hessian)
    assert_array_equal(covariance, covariance.T)
    assert np.isnan(fisher_covariance([[1e-20, 1.0], [1.0 + 1e-15, 1e-20]])).all()
    assert fisher_covariance(np.zeros((0, 3, 3))).shape == (0, 3, 3)  # where nothing converged
