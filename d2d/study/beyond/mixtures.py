r"""Gaussian mixtures as nonlinear least squares, the form that solvers in robotics require.

Least squares minimises half a sum of squares, so the negative logarithm of a target's mixture
:math:`\sum_j s_j \exp(-\|w_j\|^2/2)`, with whitened distances w_j, has to be written as such a sum.
Pfeifer, Lange & Protzel (2021) compare three ways:

- max: the exponent of the component that is largest at theta (Olson & Agarwal 2013,
  "max-mixtures"),
- sum: the whole negative logarithm as the square of one residual (Rosen, Kaess & Leonard 2013),
- max-sum: the exponent of the largest component, and the remainder of the negative logarithm as
  the square of one more residual (their own proposal).

The last two equal the likelihood of `d2d.RegistrationCost` up to a constant; the first drops all
but one component of each target.
"""

import math
from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from d2d import rigid
from d2d._types import Array
from d2d.cost import CorruptedGaussian
from d2d.covariance import fisher_covariance
from d2d.point_set import PointSet
from d2d.problem import Estimate

Mixture = Literal["max", "sum", "max-sum"]
Residuals = Callable[[NDArray[Any]], NDArray[Any]]

DAMPING = 10.0  # 1/m^2, added to the max-sum's normalisation to make its square root less curved
_STEP = 1e-30  # of complex-step derivatives, which do not suffer from cancellation
_MIN_SQUARE = 1e-10  # smallest argument of a square root, whose slope at zero is infinite


class _Components(NamedTuple):
    """The components j of every moving target's mixture: s_j exp(-(x_j^2 + y_j^2) / 2)."""

    x: NDArray[Any]  # (..., K, J), whitened distance
    y: NDArray[Any]  # (..., K, J)
    log_scale: NDArray[Any]  # (..., K, J): log s_j


def mixture_residuals(
    fixed: PointSet, moving: PointSet, mixture: Mixture, outlier: CorruptedGaussian | None = None
) -> tuple[Residuals, Array]:
    """Residuals of the D2D likelihood of two planar sets, and a constant for each target (K,).

    The residuals r (..., M) are a function of the motion (..., 3), complex for complex-step
    derivatives; ``sum(r**2) / 2 - sum(constants)`` is the negative logarithm of the mixture.
    """
    constants = _log_bounds(fixed, moving, mixture, outlier)

    def residuals(theta: NDArray[Any]) -> NDArray[Any]:
        parts = _components(theta, fixed, moving, outlier)
        logs = parts.log_scale - 0.5 * (parts.x**2 + parts.y**2)
        if mixture != "max":
            top = logs.real.max(axis=-1, keepdims=True)
            whole = top[..., 0] + np.log(np.exp(logs - top).sum(axis=-1))
        if mixture == "sum":
            return _root(constants - whole)
        best = np.argmax(logs.real, axis=-1)[..., np.newaxis]
        x, y, log_scale = (np.take_along_axis(part, best, axis=-1)[..., 0] for part in parts)
        rest = constants - (log_scale if mixture == "max" else whole + 0.5 * (x**2 + y**2))
        return np.concatenate([x, y, _root(rest)], axis=-1)

    return residuals, constants


def register_mixture(
    fixed: PointSet,
    moving: PointSet,
    mixture: Mixture,
    outlier: CorruptedGaussian | None = None,
    initial: ArrayLike | None = None,
) -> Estimate:
    """Minimise a mixture's negative logarithm by Levenberg-Marquardt (MINPACK), for one problem.

    The start ``initial`` (3,) is zeros by default.  In the result, ``hessian`` is J'J, as in such
    solvers, ``covariance`` its inverse, and ``iterations`` counts evaluations of the residuals.
    """
    start = np.zeros(3) if initial is None else rigid.motion("initial", initial, 2)
    residuals, constants = mixture_residuals(fixed, moving, mixture, outlier)

    def jacobian(theta: Array) -> Array:
        return np.asarray(residuals(theta + 1j * _STEP * np.eye(3)).imag.T / _STEP)

    optimum = scipy.optimize.least_squares(residuals, start, jacobian, method="lm", x_scale="jac")
    hessian = optimum.jac.T @ optimum.jac
    covariance = fisher_covariance(hessian)
    converged = bool(optimum.success and np.isfinite(covariance).all())
    return Estimate(
        theta=optimum.x,
        covariance=covariance if converged else np.full((3, 3), np.nan),
        value=np.asarray(optimum.cost - constants.sum()),
        gradient=optimum.grad,
        hessian=hessian,
        converged=np.asarray(converged),
        iterations=np.asarray(optimum.nfev),
    )


def _log_weights(fixed: PointSet, outlier: CorruptedGaussian | None) -> tuple[Array, Array]:
    """Logarithms (J,) of w_j / 2 pi times the share of inliers and of outliers."""
    share = 0.0 if outlier is None else outlier.fraction
    with np.errstate(divide="ignore"):  # a fraction of 0 or 1: one has zero weight
        log_weights = np.log(fixed.weights) - math.log(2.0 * math.pi)
        return log_weights + np.log1p(-share), log_weights + np.log(share)


def _log_bounds(
    fixed: PointSet, moving: PointSet, mixture: Mixture, outlier: CorruptedGaussian | None
) -> Array:
    """For each target (K,), a bound on the logarithm of its mixture, for any motion."""
    log_inlier, log_outlier = _log_weights(fixed, outlier)
    # Minkowski: det(A + B)^(1/2) >= det(A)^(1/2) + det(B)^(1/2)
    roots = (np.sqrt(np.linalg.det(points.covariances)) for points in (moving, fixed))
    bounds = log_inlier - np.log(np.add.outer(*roots))
    if outlier is not None:
        wide = log_outlier - 0.5 * np.linalg.slogdet(outlier.covariance)[1]
        bounds = np.concatenate([bounds, np.broadcast_to(wide, bounds.shape)], axis=-1)
    best = bounds.max(axis=-1)
    if mixture == "max":
        return np.asarray(best)
    if mixture == "sum":
        return np.asarray(np.log(np.exp(bounds).sum(axis=-1)))
    return np.asarray(np.log(bounds.shape[-1] * np.exp(best) + DAMPING))


def _components(
    theta: NDArray[Any], fixed: PointSet, moving: PointSet, outlier: CorruptedGaussian | None
) -> _Components:
    """The components at motions (..., 3), which may be complex."""
    (t_x, t_y), angle = np.moveaxis(theta[..., np.newaxis, :2], -1, 0), theta[..., 2:]
    c, s = np.cos(angle), np.sin(angle)
    x, y = moving.means.T
    d_x = (c * x - s * y + t_x)[..., np.newaxis] - fixed.means[:, 0]
    d_y = (s * x + c * y + t_y)[..., np.newaxis] - fixed.means[:, 1]
    (a, b), (_, d) = np.moveaxis(moving.covariances, 0, -1)
    xx = (c * c * a - 2.0 * c * s * b + s * s * d)[..., np.newaxis]
    xy = (c * s * (a - d) + (c * c - s * s) * b)[..., np.newaxis]
    yy = (s * s * a + 2.0 * c * s * b + c * c * d)[..., np.newaxis]
    (f_xx, f_xy), (_, f_yy) = np.moveaxis(fixed.covariances, 0, -1)
    log_inlier, log_outlier = _log_weights(fixed, outlier)
    inlier = _whitened(d_x, d_y, xx + f_xx, xy + f_xy, yy + f_yy, log_inlier)
    if outlier is None:
        return inlier
    (xx, xy), (_, yy) = outlier.covariance
    wide = _whitened(d_x, d_y, xx, xy, yy, log_outlier)
    return _Components(*(np.concatenate(both, -1) for both in zip(inlier, wide, strict=True)))


def _whitened(x: Any, y: Any, xx: Any, xy: Any, yy: Any, log_weights: Array) -> _Components:
    """Components whitened by their Cholesky factor, in closed form, for complex motions, too."""
    first = np.sqrt(xx)
    low = xy / first
    second = np.sqrt(yy - low * low)
    whitened = x / first
    log_scale = np.broadcast_to(log_weights - np.log(first * second), x.shape)
    return _Components(whitened, (y - low * whitened) / second, log_scale)


def _root(half_squares: NDArray[Any]) -> NDArray[Any]:
    """Residuals r with r^2 / 2 = half_squares, kept away from zero."""
    clipped = np.where(half_squares.real < _MIN_SQUARE, _MIN_SQUARE, half_squares)
    return np.asarray(np.sqrt(2.0 * clipped))
