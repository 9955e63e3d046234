"""Proper scores of estimates with covariances: how well each error fits what was stated.

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

from d2d._checks import check_covariances, check_finite, check_positive
from d2d._types import Array

LEVELS = (0.5, 0.95, 0.99)


@dataclass(frozen=True, eq=False)
class Whitened:
    """Errors (N, n) taken apart into independent directions.

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
        """The parts (N, n) of each direction in `log_score`; they add up to it."""
        return np.asarray(
            0.5 * self.values**2 + np.log(self.sigmas) + 0.5 * math.log(2.0 * math.pi)
        )

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
    """Take errors apart into directions that a credible covariance makes independent.

    The first component in the order is divided by its standard deviation.  From each further one,
    its expected value given the components before it is subtracted; then it is divided by the
    standard deviation that remains.  This is L^-1 e with the Cholesky factor L of the covariance,
    its rows and columns in that order.

    Parameters
    ----------
    errors : (N, n) array
        Estimate minus truth.
    covariances : (N, n, n) or (n, n) array
        Estimated covariances, symmetric positive definite.
    order : sequence of int, optional
        A permutation of 0 ... n - 1, which is the default.  For [v_x, v_y, omega], (2, 1, 0) takes
        omega first, then v_y given omega, then v_x given both.

    Returns
    -------
    Whitened

    Raises
    ------
    ValueError
        If the shapes do not match, a value is nan or inf, a covariance is not positive definite, or
        ``order`` is not a permutation; the message names the argument.
    """
    e, sigma = checked_errors(errors, covariances)
    n = e.shape[1]
    places = np.arange(n) if order is None else _permutation(order, n)
    root = np.linalg.cholesky(sigma[:, places[:, np.newaxis], places])
    values, sigmas = np.empty_like(e), np.empty_like(e)
    values[:, places] = np.linalg.solve(root, e[:, places, np.newaxis])[..., 0]
    sigmas[:, places] = np.diagonal(root, axis1=-2, axis2=-1)
    return Whitened(values, sigmas)


def log_score(errors: ArrayLike, covariances: ArrayLike) -> Array:
    """Negative log density of each error under its stated covariance, the logarithmic score.

    Parameters
    ----------
    errors : (N, n) array
        Estimate minus truth.
    covariances : (N, n, n) or (n, n) array
        Estimated covariances, symmetric positive definite.

    Returns
    -------
    (N,) array
        -log N(e | 0, Sigma); smaller is better.  It is in nats and depends on the units of the
        errors by a constant only.  The parts of each direction are `Whitened.log_score`.

    Raises
    ------
    ValueError
        If the shapes do not match, a value is nan or inf, or a covariance is not positive definite;
        the message names the argument.

    Examples
    --------
    The mean is smallest for the true standard deviation, here 1:

    >>> import numpy as np
    >>> from d2d import log_score
    >>> errors = np.random.default_rng(0).standard_normal((1000, 1))
    >>> [float(log_score(errors, [[s**2]]).mean().round(2)) for s in (0.5, 1.0, 2.0)]
    [2.14, 1.4, 1.73]
    """
    return np.asarray(whiten(errors, covariances).log_score.sum(axis=-1))


def crps(errors: ArrayLike, sigmas: ArrayLike) -> Array:
    """Continuous ranked probability score of a Gaussian in one dimension, in the errors' unit.

    Parameters
    ----------
    errors, sigmas : arrays that broadcast to (...)
        Estimate minus truth, and the stated standard deviation, positive.

    Returns
    -------
    (...) array
        Smaller is better; 0.234 sigma for an error of zero, and about ``|e| - 0.564 sigma`` for a
        large one.

    Raises
    ------
    ValueError
        If a value is nan or inf, a standard deviation is not positive, or the shapes do not
        broadcast; the message names the argument.

    Notes
    -----
    In closed form with z = e / sigma (Gneiting & Raftery 2007, sec. 4.2)::

        sigma (z (2 Phi(z) - 1) + 2 phi(z)
               - 1 / sqrt(pi))
    """
    e, s = check_finite("errors", errors), check_positive("sigmas", sigmas)
    try:
        z = e / s
    except ValueError:
        raise ValueError(
            f"errors and sigmas must broadcast, but have the shapes {e.shape} and {s.shape}"
        ) from None
    density = np.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
    return np.asarray(
        s * (z * (2.0 * scipy.special.ndtr(z) - 1.0) + 2.0 * density - 1.0 / math.sqrt(math.pi))
    )


def energy_score(errors: ArrayLike, covariances: ArrayLike) -> Array:
    """Energy score of each error, the CRPS in several dimensions.

    Parameters
    ----------
    errors : (N, n) array
        Estimate minus truth, in one unit along all axes, because their lengths are compared.
    covariances : (N, n, n) or (n, n) array
        Estimated covariances, symmetric positive definite.

    Returns
    -------
    (N,) array, in the errors' unit
        ``E|X - e| - E|X - X'| / 2`` with X and X' independent draws of N(0, Sigma); smaller is
        better.

    Raises
    ------
    ValueError
        If the shapes do not match, a value is nan or inf, or a covariance is not positive definite;
        the message names the argument.

    Notes
    -----
    Gneiting & Raftery (2007), sec. 4.3, who estimate the expectations by simulation.  Here they are
    computed to a relative error below 1e-8.  With ``|y|`` as an integral over exp(-s y^2), the
    mean length of a Gaussian vector Y, of mean m and with variances l_i along the axes of its
    covariance, is a single integral in any dimension::

        E|Y| = 1 / (2 sqrt(pi)) * integral over s > 0 of (1 - phi(s)) s^(-3/2) ds
        phi(s) = E exp(-s Y'Y) = product over i of exp(-s m_i^2 / (1 + 2 s l_i)) / sqrt(1 + 2 s l_i)

    In log s the trapezoidal rule converges exponentially.
    """
    e, sigma = checked_errors(errors, covariances)
    variances, axes = np.linalg.eigh(sigma)
    along = np.einsum("nji,nj->ni", axes, e)
    own = _mean_length(np.zeros((1, e.shape[1])), 2.0 * variances)
    return _mean_length(along, variances) - 0.5 * own


# Nodes in log s: the tails beyond are below exp(-30), and the error of the rule with these steps is
# about exp(-2 pi (pi / 2) / 0.5) = 3e-9.
_LOG_NODES = np.arange(-60.0, 60.5, 0.5)


def _mean_length(means: Array, variances: Array) -> Array:
    """E|Y| (N,) of Gaussian vectors with independent components, means and variances (N, n)."""
    size = (means**2 + variances).sum(axis=-1, keepdims=True)  # E Y'Y, so that s is about 1 / size
    squares, spread = means**2 / size, 2.0 * variances / size
    total = np.zeros(len(squares))
    for node in _LOG_NODES:
        s = math.exp(node)
        widened = 1.0 + s * spread
        exponent = -s * squares / widened - 0.5 * np.log(widened)
        total -= math.exp(-0.5 * node) * np.expm1(exponent.sum(axis=-1))
    step = _LOG_NODES[1] - _LOG_NODES[0]
    return np.asarray(np.sqrt(size[:, 0]) * total * step / (2.0 * math.sqrt(math.pi)))


def coverage(errors: ArrayLike, covariances: ArrayLike, levels: ArrayLike = LEVELS) -> Array:
    """Share of the errors that lie within the ellipsoids that should contain them.

    Parameters
    ----------
    errors : (N, n) array
        Estimate minus truth; at least one.
    covariances : (N, n, n) or (n, n) array
        Estimated covariances, symmetric positive definite.
    levels : (L,) array or number
        Probability contents of the ellipsoids, within (0, 1).

    Returns
    -------
    (L,) array or number
        A credible estimator has the levels themselves.  The shares of each direction are the mean
        of `Whitened.within`; for an interval, use `block_bootstrap`.

    Raises
    ------
    ValueError
        If the shapes do not match, a value is nan or inf, a covariance is not positive definite, or
        a level is not within (0, 1); the message names the argument.

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
    """e' Sigma^-1 e (N,) of errors (N, n), the NEES."""
    solved = np.linalg.solve(
        np.broadcast_to(covariances, (*errors.shape, errors.shape[1])), errors[..., None]
    )
    return np.asarray(np.einsum("ni,ni->n", errors, solved[..., 0]))


def checked_errors(errors: ArrayLike, covariances: ArrayLike) -> tuple[Array, Array]:
    """Errors (N, n) and their covariances (N, n, n), or a ValueError that names the argument."""
    e = check_finite("errors", errors)
    if e.ndim != 2 or not e.size:
        raise ValueError(f"errors must have the shape (N, n) with N, n > 0, but has {e.shape}")
    runs, n = e.shape
    sigma = check_covariances("covariances", covariances)
    if sigma.shape not in ((runs, n, n), (n, n)):
        raise ValueError(
            f"covariances must have the shape ({runs}, {n}, {n}) or ({n}, {n}) to match errors, "
            f"but has {sigma.shape}"
        )
    return e, np.broadcast_to(sigma, (runs, n, n))


def _quantiles(levels: ArrayLike, n: int) -> Array:
    """Quantiles of chi-square with n degrees of freedom at the checked levels."""
    contents = check_finite("levels", levels)
    if contents.ndim > 1 or not ((contents > 0.0) & (contents < 1.0)).all():
        raise ValueError(f"levels must be one or more numbers within (0, 1), but is {levels!r}")
    return np.asarray(scipy.special.chdtri(n, 1.0 - contents))


def _permutation(order: Sequence[int], n: int) -> np.ndarray[tuple[int], np.dtype[np.int_]]:
    try:
        places = np.array([int(place) for place in order])
        fits = sorted(places.tolist()) == list(range(n)) and list(order) == places.tolist()
    except (TypeError, ValueError, np.ma.MaskError):
        fits = False
    if not fits:
        raise ValueError(f"order must be a permutation of the {n} components, but is {order!r}")
    return places
