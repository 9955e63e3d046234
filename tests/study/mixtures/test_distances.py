"""How exactly squared distances are computed."""

import numpy as np
import pytest

from d2d.study.mixtures.distances import distance_errors, exact_distance


def test_exact_distance_of_simple_numbers() -> None:
    """Breaks if an entry of the inverse of a 2 x 2 matrix is wrong."""
    covariance, offset = np.array([[2.0, 0.5], [0.5, 1.0]]), np.array([1.0, -3.0])
    expected = offset @ np.linalg.inv(covariance) @ offset
    assert exact_distance(covariance, offset) == pytest.approx(expected, rel=1e-14)


def test_along_a_thin_ellipse_only_the_inverse_loses_digits() -> None:
    """Breaks if the factor is no longer used for the second number, or both are the same."""
    by_inverse, by_factor = distance_errors(1e-12, np.random.default_rng(1))
    assert by_factor < 1e-14
    assert by_inverse > 1e-8
