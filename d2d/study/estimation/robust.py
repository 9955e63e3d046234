"""The robust likelihood from inside: the terms of its derivatives, and costs as robust kernels."""

from typing import NamedTuple

import numpy as np

from d2d._types import Array
from d2d.cost import CorruptedGaussian
from d2d.point_set import PointSet


class Terms(NamedTuple):
    """Terms of the robust D2D likelihood and its derivatives, over translations (T,)."""

    value: Array  # the cost
    inliers: Array  # (1/m) the inlier components' part of the gradient
    outliers: Array  # (1/m) the outlier components' part of it
    curvature: Array  # (1/m^2) mean curvature of the pairs, the first term of the Hessian
    spread: Array  # (1/m^2) variance of their pulls, which the Hessian subtracts


def line_terms(
    translations: Array, fixed: PointSet, moving: PointSet, outlier: CorruptedGaussian
) -> Terms:
    """The terms at translations (T,), in m, of two sets on a line, summed over moving targets."""
    d = translations[:, None, None] + moving.means - fixed.means.T  # (T, K, N)
    inner = moving.covariances[:, :, 0] + fixed.covariances[:, 0, 0]
    spread = np.concatenate([inner, np.full_like(inner, outlier.covariance[0, 0])], axis=1)
    share = (1.0 - outlier.fraction, outlier.fraction)
    weights = np.concatenate([part * fixed.weights for part in share])
    pulls = np.concatenate([d, d], axis=-1) / spread
    densities = weights * np.exp(-0.5 * pulls**2 * spread) / np.sqrt(2.0 * np.pi * spread)
    q = densities.sum(axis=-1, keepdims=True)
    gamma = densities / q
    pulled, n = gamma * pulls, fixed.size
    mean = pulled.sum(axis=-1)
    return Terms(
        -np.log(q).sum(axis=(-2, -1)),
        pulled[..., :n].sum(axis=(-2, -1)),
        pulled[..., n:].sum(axis=(-2, -1)),
        (gamma / spread).sum(axis=(-2, -1)),
        ((pulled * pulls).sum(axis=-1) - mean**2).sum(axis=-1),
    )


class Kernel(NamedTuple):
    """An M-estimator's kernel over normalised residuals (R,)."""

    loss: Array  # rho(r)
    influence: Array  # psi(r) = d rho / d r
    weight: Array  # psi(r) / r


def kernels(residuals: Array, ratio: float) -> dict[str, Kernel]:
    """The kernels that the three costs apply to the residuals r = d / s (R,) of a single pair.

    ``ratio`` is the height of the outlier component over that of the inliers,
    alpha o / ((1 - alpha) q(0)).
    """
    squares = residuals**2
    peak = np.exp(-0.5 * squares)  # q over its highest value
    inlier = peak / (peak + ratio)
    return {
        "summing": Kernel(1.0 - peak, residuals * peak, peak),
        "likelihood": Kernel(0.5 * squares, residuals, np.ones_like(residuals)),
        "robust": Kernel(
            np.log1p(ratio) - np.log(peak + ratio), residuals * inlier, np.asarray(inlier)
        ),
    }
