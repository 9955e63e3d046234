"""The Gaussian of some observations."""

import numpy as np
from numpy.typing import ArrayLike

from d2d._types import Array


def fit(x: ArrayLike, weights: ArrayLike | None = None) -> tuple[Array, Array]:
    """Maximum-likelihood mean (..., D) and covariance (..., D, D) (thesis eq. 2.5, 2.6).

    The observations x (..., N, D) have weights (..., N), equal by default.  The covariance is
    divided by the sum of the weights, not by N - 1: with equal weights its expectation is too small
    by the factor (N - 1) / N.  It is singular where the observations span less than D dimensions.
    """
    points = np.asarray(x, dtype=np.float64)
    w = np.ones(points.shape[-2]) if weights is None else np.asarray(weights, dtype=np.float64)
    share = w / w.sum(axis=-1, keepdims=True)
    mean = np.einsum("...n,...nd->...d", share, points)
    # once more about the mean: far from the origin, rounding of the shares moves the first one
    mean += np.einsum("...n,...nd->...d", share, points - mean[..., None, :])
    centred = points - mean[..., None, :]
    return mean, np.einsum("...n,...ni,...nj->...ij", share, centred, centred)
