"""Covariances without eigenvalues that are too small."""

import numpy as np
from numpy.typing import ArrayLike

from d2d._types import Array


def raise_eigenvalues(
    matrices: ArrayLike, floor: ArrayLike = 0.0, smallest_ratio: float = 0.0
) -> Array:
    """Raise the eigenvalues of symmetric matrices (..., D, D) that lie below a floor to that floor.

    The floor is ``floor`` (...) or ``smallest_ratio`` times each matrix's largest eigenvalue,
    whichever is larger.  For an empirical covariance S, the result has the largest likelihood of
    all covariances without an eigenvalue below ``floor``: ``-log|Sigma| - tr(Sigma^-1 S)`` is
    largest with the eigenvectors of S, and along each of them ``-log s - lambda / s`` falls beyond
    s = lambda.
    """
    given, least = (np.asarray(each, dtype=np.float64) for each in (matrices, floor))
    values, vectors = np.linalg.eigh(given)
    lowest = np.maximum(least[..., None], smallest_ratio * values[..., -1:])
    raised = (vectors * np.maximum(values, lowest)[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    symmetric = 0.5 * (raised + np.swapaxes(raised, -1, -2))
    kept = np.asarray((values >= lowest).all(axis=-1))
    return np.where(kept[..., None, None], given, symmetric)
