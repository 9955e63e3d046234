"""Gaussian mixtures as nonlinear least squares, the form that solvers in robotics require.

Least squares minimises half a sum of squares, so the negative logarithm of a target's mixture
``sum_j s_j exp(-|w_j|^2 / 2)``, with whitened distances w_j, has to be written as such a sum.
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


def mixture_residuals(
    fixed: PointSet,
    moving: PointSet,
    mixture: Mixture,
    outlier: CorruptedGaussian | None = None,
) -> tuple[Residuals, Array]:
    """Residuals of the D2D likelihood of two planar sets, and a constant for each target (K,).

    The residuals r are a function of the motion (..., 3), which may be complex for complex-step
    derivatives, and have the shape (..., M).  ``sum(r**2) / 2 - sum(constants)`` is the negative
    logarithm of the mixture.
    """
    pairs = _Pairs(fixed, moving, outlier)
    constants = pairs.constants(mixture)

    def residuals(theta: NDArray[Any]) -> NDArray[Any]:
        parts = pairs.at(theta)
        logs = parts.log_scale - 0.5 * (parts.x**2 + parts.y**2)
        if mixture != "max":
            top = logs.real.max(axis=-1, keepdims=True)
            whole = top[..., 0] + np.log(np.exp(logs - top).sum(axis=-1))
        if mixture == "sum":
            return _root(constants - whole)
        best = np.argmax(logs.real, axis=-1)[..., np.newaxis]
        x, y, log_scale = (np.take_along_axis(each, best, axis=-1)[..., 0] for each in parts)
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

    The sets, the mixture and the outlier model are those of `mixture_residuals`; ``initial`` (3,)
    is zeros by default.  In the result, ``hessian`` is J'J, the approximation that such a solver
    uses, ``covariance`` its inverse, and ``iterations`` counts evaluations of the residuals.
    """
    start = np.zeros(3) if initial is None else rigid.motion("initial", initial, 2)
    residuals, constants = mixture_residuals(fixed, moving, mixture, outlier)

    def jacobian(theta: Array) -> Array:
        return np.asarray(residuals(theta + 1j * _STEP * np.eye(3)).imag.T / _STEP)

    found = scipy.optimize.least_squares(residuals, start, jacobian, method="lm", x_scale="jac")
    hessian = found.jac.T @ found.jac
    covariance = fisher_covariance(hessian)
    converged = bool(found.success and np.isfinite(covariance).all())
    return Estimate(
        theta=found.x,
        covariance=covariance if converged else np.full((3, 3), np.nan),
        value=np.asarray(found.cost - constants.sum()),
        gradient=found.grad,
        hessian=hessian,
        converged=np.asarray(converged),
        iterations=np.asarray(found.nfev),
    )


class _Components(NamedTuple):
    """The components j of every moving target's mixture: s_j exp(-(x_j^2 + y_j^2) / 2)."""

    x: NDArray[Any]  # (..., K, J), whitened distance
    y: NDArray[Any]  # (..., K, J)
    log_scale: NDArray[Any]  # (..., K, J): log s_j


class _Pairs:
    """The pairs of a moving target and a component of its mixture, at any motion."""

    def __init__(
        self, fixed: PointSet, moving: PointSet, outlier: CorruptedGaussian | None
    ) -> None:
        self.fixed, self.moving, self.outlier = fixed, moving, outlier
        self.log_weight = np.log(fixed.weights) - math.log(2.0 * math.pi)
        # Minkowski: det(A + B)^(1/2) >= det(A)^(1/2) + det(B)^(1/2)
        own, other = (np.sqrt(np.linalg.det(each.covariances)) for each in (moving, fixed))
        self.log_bound = self.log_weight - np.log(own[:, None] + other)  # (K, J): of log s_j
        if outlier is not None:
            with np.errstate(divide="ignore"):  # a fraction of 0 or 1: one has zero weight
                share_in, share_out = np.log1p(-outlier.fraction), np.log(outlier.fraction)
            widths = np.diagonal(np.linalg.cholesky(outlier.covariance))
            wide = share_out + self.log_weight - np.log(widths).sum()
            self.log_wide = np.broadcast_to(wide, self.log_bound.shape)
            self.log_weight = self.log_weight + share_in
            self.log_bound = np.concatenate([self.log_bound + share_in, self.log_wide], axis=-1)

    def constants(self, mixture: Mixture) -> Array:
        """For each target (K,), a bound on the logarithm of its mixture, for any motion."""
        best = self.log_bound.max(axis=-1)
        if mixture == "max":
            return np.asarray(best)
        if mixture == "sum":
            return np.asarray(np.log(np.exp(self.log_bound).sum(axis=-1)))
        return np.asarray(np.log(self.log_bound.shape[-1] * np.exp(best) + DAMPING))

    def at(self, theta: NDArray[Any]) -> _Components:
        """The components at motions (..., 3), which may be complex."""
        (t_x, t_y), angle = np.moveaxis(theta[..., np.newaxis, :2], -1, 0), theta[..., 2:]
        c, s = np.cos(angle), np.sin(angle)
        x, y = self.moving.means.T
        d_x = (c * x - s * y + t_x)[..., np.newaxis] - self.fixed.means[:, 0]
        d_y = (s * x + c * y + t_y)[..., np.newaxis] - self.fixed.means[:, 1]
        (a, b), (_, d) = np.moveaxis(self.moving.covariances, 0, -1)
        xx = (c * c * a - 2.0 * c * s * b + s * s * d)[..., np.newaxis]
        xy = (c * s * (a - d) + (c * c - s * s) * b)[..., np.newaxis]
        yy = (s * s * a + 2.0 * c * s * b + c * c * d)[..., np.newaxis]
        (f_xx, f_xy), (_, f_yy) = np.moveaxis(self.fixed.covariances, 0, -1)
        inlier = _whitened(d_x, d_y, xx + f_xx, xy + f_xy, yy + f_yy)
        inlier = inlier._replace(log_scale=inlier.log_scale + self.log_weight)
        if self.outlier is None:
            return inlier
        (xx, xy), (_, yy) = self.outlier.covariance
        log_wide = np.broadcast_to(self.log_wide, d_x.shape)
        wide = _whitened(d_x, d_y, xx, xy, yy)._replace(log_scale=log_wide)
        return _Components(*(np.concatenate(both, -1) for both in zip(inlier, wide, strict=True)))


def _whitened(x: Any, y: Any, xx: Any, xy: Any, yy: Any) -> _Components:
    """Distances divided by the Cholesky factor of their covariances, and -log of its determinant.

    In closed form, because NumPy's factorisation does not support the complex symmetric matrices
    that a complex motion gives.
    """
    first = np.sqrt(xx)
    low = xy / first
    second = np.sqrt(yy - low * low)
    whitened = x / first
    return _Components(whitened, (y - low * whitened) / second, -np.log(first * second))


def _root(half_squares: NDArray[Any]) -> NDArray[Any]:
    """Residuals r with r^2 / 2 = half_squares, kept away from zero."""
    clipped = np.where(half_squares.real < _MIN_SQUARE, _MIN_SQUARE, half_squares)
    return np.asarray(np.sqrt(2.0 * clipped))
