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


def test_off_the_axis_neither_is_exact() -> None:
    """Breaks if the angle is not that between the offset and the long axis."""
    by_inverse, by_factor = distance_errors(1e-12, np.random.default_rng(1), np.deg2rad(30.0))
    assert by_factor > 1e-8
    assert by_inverse > 1e-8


def test_round_ellipses_lose_nothing() -> None:
    """Breaks if the exact distance is another quantity than the two that are compared with it."""
    assert max(distance_errors(1.0, np.random.default_rng(1), 0.7)) < 1e-14
