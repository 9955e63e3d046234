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
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

from d2d import rigid
from d2d._types import Array
from d2d.cost import CorruptedGaussian
from d2d.covariance import fisher_covariance
from d2d.point_set import PointSet
from d2d.problem import check_pair
from d2d.registration import Estimate

Mixture = Literal["max", "sum", "max-sum"]

_MIXTURES = ("max", "sum", "max-sum")
DAMPING = 10.0  # 1/m^2, added to the max-sum's normalisation to make its square root less curved
_STEP = 1e-30  # of complex-step derivatives, which do not suffer from cancellation
_MIN_SQUARE = 1e-10  # smallest argument of a square root, whose slope at zero is infinite


def mixture_residuals(
    theta: ArrayLike,
    fixed: PointSet,
    moving: PointSet,
    mixture: Mixture,
    outlier: CorruptedGaussian | None = None,
) -> tuple[Any, Array]:
    """Residuals r (..., M) of the D2D likelihood, and a constant for each target (K,).

    ``sum(r**2) / 2 - sum(constants)`` is the negative logarithm of the mixture.

    Parameters
    ----------
    theta : (..., 3) array, m, m, rad
        May be complex, for complex-step derivatives.
    fixed, moving : PointSet
        One planar set each, no batch.
    mixture : "max", "sum" or "max-sum"
    outlier : CorruptedGaussian, optional

    Raises
    ------
    ValueError
        If an argument is invalid; the message names it.
    """
    _check(fixed, moving, mixture)
    parts = _components(np.asarray(theta), fixed, moving, outlier)
    logs = parts.log_scale - 0.5 * (parts.whitened**2).sum(axis=-1)
    best = np.argmax(logs.real, axis=-1)[..., np.newaxis]
    top = np.take_along_axis(logs, best, axis=-1)
    whole = (top + np.log(np.exp(logs - top).sum(axis=-1, keepdims=True)))[..., 0]
    if mixture == "sum":
        constant = np.log(np.exp(parts.log_bound).sum(axis=-1))
        return _root(constant - whole), constant
    nearest = np.take_along_axis(parts.whitened, best[..., np.newaxis], axis=-2)[..., 0, :]
    if mixture == "max":
        constant = parts.log_bound.max(axis=-1)
        rest = constant - np.take_along_axis(parts.log_scale, best, axis=-1)[..., 0]
    else:
        bound = parts.log_bound.shape[-1] * np.exp(parts.log_bound.max(axis=-1))
        constant = np.log(bound + DAMPING)
        rest = constant - whole - 0.5 * (nearest**2).sum(axis=-1)
    flat = nearest.reshape(*nearest.shape[:-2], -1)
    return np.concatenate([flat, _root(rest)], axis=-1), constant


def register_mixture(
    fixed: PointSet,
    moving: PointSet,
    mixture: Mixture,
    outlier: CorruptedGaussian | None = None,
    initial: ArrayLike | None = None,
) -> Estimate:
    """Minimise a mixture's negative logarithm by Levenberg-Marquardt (MINPACK), for one problem.

    Parameters
    ----------
    fixed, moving, mixture, outlier
        As for `mixture_residuals`.
    initial : (3,) array, m, m, rad, optional
        Where to start; zeros by default.

    Returns
    -------
    Estimate
        ``hessian`` is J'J, the approximation that such a solver uses, and ``covariance`` its
        inverse; ``iterations`` counts evaluations of the residuals.

    Raises
    ------
    ValueError
        If an argument is invalid; the message names it.
    """
    start = np.zeros(3) if initial is None else rigid.motion("initial", initial, 2)

    def residuals(theta: Array) -> Array:
        return np.asarray(mixture_residuals(theta, fixed, moving, mixture, outlier)[0])

    def jacobian(theta: Array) -> Array:
        steps = theta + 1j * _STEP * np.eye(3)
        moved, _ = mixture_residuals(steps, fixed, moving, mixture, outlier)
        return np.asarray(moved.imag.T / _STEP)

    found = least_squares(residuals, start, jacobian, method="lm", x_scale="jac")
    hessian = found.jac.T @ found.jac
    _, constants = mixture_residuals(found.x, fixed, moving, mixture, outlier)
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
    """The components j of every moving target's mixture: s_j exp(-|w_j|^2 / 2)."""

    whitened: NDArray[Any]  # (..., K, J, 2): w_j
    log_scale: NDArray[Any]  # (..., K, J): log s_j
    log_bound: Array  # (K, J): upper bound on log s_j, for any theta


def _components(
    theta: NDArray[Any], fixed: PointSet, moving: PointSet, outlier: CorruptedGaussian | None
) -> _Components:
    angle, shift = theta[..., 2], theta[..., np.newaxis, :2]
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.stack([np.stack([cosine, -sine], -1), np.stack([sine, cosine], -1)], -2)
    placed = moving.means @ np.swapaxes(turn, -1, -2) + shift
    d = placed[..., :, np.newaxis, :] - fixed.means
    turn = turn[..., np.newaxis, :, :]
    spun = turn @ moving.covariances @ np.swapaxes(turn, -1, -2)
    spread = spun[..., :, np.newaxis, :, :] + fixed.covariances
    whitened, log_root = _whiten(d, spread)
    log_weight = np.log(fixed.weights) - math.log(2.0 * math.pi)
    # Minkowski: det(A + B)^(1/2) >= det(A)^(1/2) + det(B)^(1/2)
    roots = np.sqrt(np.linalg.det(moving.covariances))[:, None] + np.sqrt(
        np.linalg.det(fixed.covariances)
    )
    inlier = _Components(whitened, log_weight - log_root, log_weight - np.log(roots))
    if outlier is None:
        return inlier
    wide, log_root = _whiten(d, np.broadcast_to(outlier.covariance, spread.shape))
    with np.errstate(divide="ignore"):  # a fraction of 0 or 1: one component has zero weight
        share_in, share_out = np.log1p(-outlier.fraction), np.log(outlier.fraction)
    scale = share_out + log_weight - log_root
    bound = np.broadcast_to(
        share_out + log_weight - 0.5 * np.linalg.slogdet(outlier.covariance)[1], roots.shape
    )
    return _Components(
        np.concatenate([inlier.whitened, wide], axis=-2),
        np.concatenate([inlier.log_scale + share_in, scale], axis=-1),
        np.concatenate([inlier.log_bound + share_in, bound], axis=-1),
    )


def _whiten(d: NDArray[Any], spread: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """L^-1 d (..., 2) with L L' = spread (..., 2, 2), and log det L (...).

    In closed form, because a complex theta gives a complex symmetric matrix, which NumPy's Cholesky
    factorisation does not support.
    """
    xx, xy, yy = spread[..., 0, 0], spread[..., 0, 1], spread[..., 1, 1]
    first = np.sqrt(xx)
    low = xy / first
    second = np.sqrt(yy - low * low)
    x = d[..., 0] / first
    y = (d[..., 1] - low * x) / second
    return np.stack([x, y], axis=-1), np.log(first * second)


def _root(half_squares: NDArray[Any]) -> NDArray[Any]:
    """Residuals r with r^2 / 2 = half_squares, kept away from zero."""
    clipped = np.where(half_squares.real < _MIN_SQUARE, _MIN_SQUARE, half_squares)
    return np.asarray(np.sqrt(2.0 * clipped))


def _check(fixed: PointSet, moving: PointSet, mixture: str) -> None:
    check_pair(fixed, moving)
    for name, points in (("fixed", fixed), ("moving", moving)):
        if points.dimension != 2 or points.batch_shape:
            raise ValueError(
                f"{name} must be a single planar set, but has dimension {points.dimension} and "
                f"the batch shape {points.batch_shape}"
            )
    if mixture not in _MIXTURES:
        raise ValueError(f"mixture must be one of {', '.join(_MIXTURES)}, but is {mixture!r}")
