"""Proper scores: how well errors fit the covariances that were stated for them.

A score is proper if no other distribution has a smaller mean score than the one that the errors are
drawn from (Gneiting & Raftery 2007).  Unlike the NEES, it cannot be improved by a covariance that
is too large.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from d2d._checks import Bounds, check_covariances, check_finite, check_positive, check_shape
from d2d._types import Array

LEVELS = (0.5, 0.95, 0.99)
# Bounds within which the squares of products are finite, in any unit.
_ERROR, _VARIANCE = Bounds(most=1e70), Bounds(least=1e-140, most=1e140)


@dataclass(frozen=True, eq=False)
class Whitened:
    """Errors whose components have been made uncorrelated, each with unit variance; see `whiten`.

    Attributes
    ----------
    values : (N, n) array
        Whitened errors; for a credible estimator independent, with mean 0 and variance 1.  Their
        squares add up to the NEES.  Column i belongs to component i, whatever the order.
    sigmas : (N, n) array
        Standard deviation of each component, given those before it in the order, in its own unit.
    """

    values: Array
    sigmas: Array

    @property
    def log_score(self) -> Array:
        """Contributions (N, n) of the components to `log_score`, which is their sum."""
        constant = 0.5 * math.log(2.0 * math.pi)
        return np.asarray(0.5 * self.values**2 + np.log(self.sigmas) + constant)

    @property
    def crps(self) -> Array:
        """The `crps` (N, n) of each component, given those before it in the order."""
        return crps(self.values * self.sigmas, self.sigmas)

    def within(self, levels: ArrayLike = LEVELS) -> Array:
        """Whether (N, n, L) each whitened error lies within the central interval of each level."""
        return np.asarray(self.values[..., np.newaxis] ** 2 <= _quantiles(levels, 1))


def whiten(
    errors: ArrayLike, covariances: ArrayLike, order: Sequence[int] | None = None
) -> Whitened:
    """Whiten errors: if their covariances are true, the results are independent standard normals.

    The first component in the order is divided by its standard deviation.  From each further one,
    its expected value given the components before it is subtracted, and the rest is divided by the
    standard deviation that remains.  This is L⁻¹ e with the Cholesky factor L of the covariance,
    whose rows and columns are in that order.

    Parameters
    ----------
    errors : (N, n) array
        Estimate minus truth.
    covariances : (N, n, n) or (n, n) array
        Estimated covariances, symmetric positive definite.
    order : sequence of int, optional
        A permutation of 0 ... n − 1, which is the default.  For [v_x, v_y, omega], (2, 1, 0) takes
        omega first, then v_y given omega, then v_x given both.
    """
    e, sigma = checked_errors(errors, covariances)
    n = e.shape[1]
    places = np.arange(n) if order is None else np.asarray(order)
    if places.ndim != 1 or places.dtype.kind not in "iu" or sorted(places) != [*range(n)]:
        raise ValueError(f"order must be a permutation of 0 to {n - 1}, but is {order!r}")
    root = np.linalg.cholesky(sigma[:, places[:, np.newaxis], places])
    values, sigmas = np.empty_like(e), np.empty_like(e)
    values[:, places] = np.linalg.solve(root, e[:, places, np.newaxis])[..., 0]
    sigmas[:, places] = np.diagonal(root, axis1=-2, axis2=-1)
    return Whitened(values, sigmas)


def log_score(errors: ArrayLike, covariances: ArrayLike) -> Array:
    r"""The logarithmic score: negative log density of each error under its stated covariance.

    That is :math:`-\log \mathcal N(e \mid 0, \Sigma)` (N,) in nats; smaller is better.  Another
    unit of the errors adds a constant.  `Whitened.log_score` has the part of each component.

    The errors and covariances are those of `whiten`.

    Examples
    --------
    The mean is smallest for the true variance, here 1:

    >>> import numpy as np
    >>> from d2d import log_score
    >>> errors = np.random.default_rng(0).standard_normal((1000, 1))
    >>> [float(log_score(errors, [[v]]).mean().round(2)) for v in (0.25, 1, 4)]
    [2.14, 1.4, 1.73]
    """
    return np.asarray(whiten(errors, covariances).log_score.sum(axis=-1))


def crps(errors: ArrayLike, sigmas: ArrayLike) -> Array:
    r"""Continuous ranked probability score of a Gaussian in one dimension, in the errors' unit.

    The errors, estimate minus truth, and the stated standard deviations, positive, broadcast to the
    shape (...) of the scores.  Smaller is better: :math:`0.234\,\sigma` for an error of zero, and
    about :math:`|e| - 0.564\,\sigma` for a large one.

    In closed form with :math:`z = e/\sigma` it is (Gneiting & Raftery 2007, sec. 4.2)

    .. math:: \sigma \bigl(z\,(2\Phi(z) - 1) + 2\varphi(z) - 1/\sqrt{\pi}\bigr).
    """
    e, s = check_finite("errors", errors), check_positive("sigmas", sigmas)
    with np.errstate(over="ignore"):  # a ratio beyond float64 has the limit
        z = e / s
        density = np.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
    beside = s * (2.0 * density - 1.0 / math.sqrt(math.pi))
    return np.asarray(e * (2.0 * scipy.special.ndtr(z) - 1.0) + beside)


def coverage(errors: ArrayLike, covariances: ArrayLike, levels: ArrayLike = LEVELS) -> Array:
    """Share of the errors that lie within the ellipsoids that their covariances state.

    The errors and covariances are those of `whiten`, and ``levels`` (L,), or a number, are the
    probability contents of the ellipsoids, within (0, 1).  The shares (L,) equal the levels if the
    estimator is credible.  The mean of `Whitened.within` is the share for each component;
    `block_bootstrap` gives an interval.

    Examples
    --------
    >>> import numpy as np
    >>> from d2d import coverage
    >>> errors = np.random.default_rng(0).standard_normal((10_000, 3))
    >>> for factor in (1.0, 0.25):
    ...     print(coverage(errors, factor * np.eye(3)).round(2))
    [0.5  0.95 0.99]
    [0.1  0.42 0.59]
    """
    return np.asarray(within(errors, covariances, levels).mean(axis=0))


def within(errors: ArrayLike, covariances: ArrayLike, levels: ArrayLike = LEVELS) -> Array:
    """Whether (N, L) each error lies within the ellipsoid of each level; see `coverage`."""
    e, sigma = checked_errors(errors, covariances)
    squares = normalised_squares(e, sigma)
    bounds = _quantiles(levels, e.shape[1])
    return np.asarray(squares.reshape(-1, *(1,) * bounds.ndim) <= bounds)


def normalised_squares(errors: Array, covariances: Array) -> Array:
    """The NEES eᵀ Σ⁻¹ e (N,) of errors (N, n) with covariances (N, n, n) or (n, n)."""
    solved = np.linalg.solve(covariances, errors[..., np.newaxis])[..., 0]
    return np.asarray(np.einsum("ni,ni->n", errors, solved))


def checked_errors(errors: ArrayLike, covariances: ArrayLike) -> tuple[Array, Array]:
    """Errors (N, n) and covariances (N, n, n), from those that a user gave."""
    e = _ERROR.array("errors", errors)
    check_shape("errors", e, "(N, n)", empty=False)
    runs, n = e.shape
    sigma = check_covariances("covariances", covariances)
    check_shape("covariances", sigma, f"({runs}, {n}, {n})", f"({n}, {n})", like="errors")
    _VARIANCE.array("covariances", np.diagonal(sigma, axis1=-2, axis2=-1))
    return e, np.broadcast_to(sigma, (runs, n, n))


def _quantiles(levels: ArrayLike, n: int) -> Array:
    """Quantiles of the chi-square distribution with n degrees of freedom."""
    contents = check_finite("levels", levels)
    if contents.ndim > 1 or not ((contents > 0.0) & (contents < 1.0)).all():
        raise ValueError(f"levels must be one or more numbers within (0, 1), but is {levels!r}")
    return np.asarray(scipy.special.chdtri(n, 1.0 - contents))
