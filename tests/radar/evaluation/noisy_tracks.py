"""Made-up tracks whose errors have the covariances that they state."""

from dataclasses import replace

import numpy as np

from d2d.radar import Track

SCALE = np.array([0.1, 0.2, 0.02])  # of the standard deviations
EMPTY = Track(*np.zeros((2, 0)), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0, dtype=bool))


def truth(times: np.ndarray) -> np.ndarray:
    """Velocities (n, 3), linear in time."""
    return np.column_stack([10.0 + 2.0 * times, 0.1 * times, 0.2 - 0.01 * times])


def noisy(seed: int, times: np.ndarray, factor: float = 1.0) -> Track:
    """The truth with Gaussian errors of ``factor`` times the covariances."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((len(times), 3, 5)) * SCALE[:, None]
    covariance = root @ np.swapaxes(root, -1, -2)
    errors = np.linalg.cholesky(covariance) @ rng.standard_normal((len(times), 3, 1))
    intervals, good = np.diff(times, prepend=times[0] - 0.1), np.ones(len(times), dtype=bool)
    theta = truth(times) + np.sqrt(factor) * errors[..., 0]
    return Track(times, intervals, theta, covariance, good)


def failed(driven: Track, rows: int | slice) -> Track:
    """The track with estimates that did not converge, and predictions that are far off."""
    theta, covariance = driven.theta.copy(), driven.covariance.copy()
    converged = driven.converged.copy()
    theta[rows], covariance[rows], converged[rows] = 1e6, np.nan, False
    return replace(driven, theta=theta, covariance=covariance, converged=converged)
