"""How exactly a squared Mahalanobis distance is computed, by the inverse and by a factor."""

from fractions import Fraction

import numpy as np

from d2d import rigid
from d2d._types import Array

DIRECTIONS = 200


def exact_distance(covariance: Array, offset: Array) -> float:
    """The squared distance of an offset (2,) under a covariance (2, 2), in exact fractions."""
    (a, b), (_, c) = ([Fraction(float(entry)) for entry in row] for row in covariance)
    x, y = (Fraction(float(entry)) for entry in offset)
    return float((c * x * x - 2 * b * x * y + a * y * y) / (a * c - b * b))


def distance_errors(
    ratio: float, rng: np.random.Generator, angle: float = 0.0
) -> tuple[float, float]:
    """Median relative errors of squared distances, by the inverse and by the Cholesky factor.

    The covariances have eigenvalues of 1 m^2 and of ``ratio`` m^2, and long axes in 200 random
    directions.  The offset is 1 m long, at an ``angle`` (rad) from the long axis.  If the ratio is
    so small that rounding leaves no positive definite matrix, NumPy raises a ``LinAlgError``.
    """
    errors = np.empty((DIRECTIONS, 2))
    for n, turn in enumerate(rng.uniform(0.0, np.pi, DIRECTIONS)):
        axes = rigid.rotation(turn)
        covariance = axes @ np.diag([1.0, ratio]) @ axes.T
        covariance = 0.5 * (covariance + covariance.T)
        offset = axes @ np.array([np.cos(angle), np.sin(angle)])
        whitened = np.linalg.solve(np.linalg.cholesky(covariance), offset)
        squared = offset @ np.linalg.inv(covariance) @ offset, whitened @ whitened
        errors[n] = np.abs(np.array(squared) / exact_distance(covariance, offset) - 1.0)
    by_inverse, by_factor = np.median(errors, axis=0)
    return float(by_inverse), float(by_factor)
