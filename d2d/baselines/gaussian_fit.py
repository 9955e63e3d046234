"""The Gaussian of some observations, and its covariance without eigenvalues that are too small."""

import numpy as np
from numpy.typing import ArrayLike

from d2d._types import Array


def fit(x: ArrayLike, weights: ArrayLike | None = None) -> tuple[Array, Array]:
    """Maximum-likelihood mean (..., D) and covariance (..., D, D) (thesis eq. 2.5, 2.6).

    The observations x (..., N, D) have weights (..., N), equal by default.  The covariance is
    divided by the sum of the weights, not by N − 1: with equal weights its expectation is too small
    by the factor (N − 1) / N.  It is singular where the observations span less than D dimensions.
    """
    points = np.asarray(x, dtype=np.float64)
    w = np.ones(points.shape[-2]) if weights is None else np.asarray(weights, dtype=np.float64)
    share = w / w.sum(axis=-1, keepdims=True)
    mean = (share[..., None, :] @ points)[..., 0, :]
    # once more about the mean: far from the origin, rounding of the shares moves the first one
    mean = mean + (share[..., None, :] @ (points - mean[..., None, :]))[..., 0, :]
    centred = points - mean[..., None, :]
    return mean, np.swapaxes(share[..., None] * centred, -1, -2) @ centred


def raise_eigenvalues(
    matrices: ArrayLike, floor: ArrayLike = 0.0, smallest_ratio: float = 0.0
) -> Array:
    r"""Raise the eigenvalues of symmetric matrices (..., D, D) that lie below a floor to it.

    The floor is ``floor`` (...) or ``smallest_ratio`` times each matrix's largest eigenvalue,
    whichever is larger.  For an empirical covariance S, the result is the likeliest covariance
    whose eigenvalues are not below it: :math:`-\log\det\Sigma - \operatorname{tr}(\Sigma^{-1} S)`
    is largest with the eigenvectors of S, and along each of them :math:`-\log s - \lambda/s` falls
    beyond :math:`s = \lambda`.
    """
    given, least = (np.asarray(each, dtype=np.float64) for each in (matrices, floor))
    values, vectors = np.linalg.eigh(given)
    lowest = np.maximum(least[..., None], smallest_ratio * values[..., -1:])
    raised = (vectors * np.maximum(values, lowest)[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    symmetric = 0.5 * (raised + np.swapaxes(raised, -1, -2))
    kept = np.asarray((values >= lowest).all(axis=-1))
    return np.where(kept[..., None, None], given, symmetric)
