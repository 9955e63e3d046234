"""An error budget by maximum likelihood, from the errors of a track against a reference."""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from d2d._bounds import Bounds
from d2d._types import Array
from d2d.bootstrap import block_length, block_sums
from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.trust.comparison import IN_UNITS, NAMES, UNITS
from d2d.scores import checked_errors, log_score

_POSSIBLE = Bounds(most=1e3)  # m/s or rad/s, of an error: what a budget can hold
_FEWEST = 4  # errors, for three constants
_STARTS = (0.01, 1.0)  # constants' variances, relative to the errors' mean squares
_TOLERANCE = 1e-8  # of the mean log score's gradient, per relative change of a variance
_QUANTILE = 1.96  # of a normal distribution, for intervals of 95 %


@dataclass(frozen=True, eq=False)
class BudgetFit:
    """Three constants of an error budget and how well the errors determine them.

    Attributes
    ----------
    budget : ErrorBudget
        Its ``v_x``, ``v_y`` and ``omega`` are the constants, in m/s, m/s, rad/s; the rest is zero.
    sigmas : (3,) array
        Standard errors of the constants, in the same units.
    bounds : (2, 3) array
        95 % confidence intervals of the constants.  One that begins at zero says that the errors do
        not tell the constant from none, and its end how large it may be.
    log_score : float
        Mean negative log density of the errors with these constants, see `d2d.log_score`.
    estimates : int
        Number of errors.
    """

    budget: ErrorBudget
    sigmas: Array
    bounds: Array
    log_score: float
    estimates: int

    def __repr__(self) -> str:
        """The constants with their intervals."""
        b = self.budget
        values = np.array([b.v_x, b.v_y, b.omega]) * IN_UNITS
        rows = zip(NAMES, values, *(self.bounds * IN_UNITS), UNITS, strict=True)
        told = ", ".join(f"{n} {v:.3f} [{low:.3f}, {high:.3f}] {u}" for n, v, low, high, u in rows)
        return f"BudgetFit({told}; {self.estimates} estimates)"


def fit_budget(errors: ArrayLike, covariances: ArrayLike) -> BudgetFit:
    """Fit the constants of an error budget to errors of estimates, by maximum likelihood.

    The propagated noise of the targets is too small by what does not average out over them.  The
    simplest model of this adds the same three variances to every covariance, whatever the number of
    targets and sensors.  Errors grow faster than that where few targets are left: with constants
    of other drives, all sensors of nuScenes have an ANEES of 1.1 and 15 targets a scan 2.2; of
    RadarScenes 0.7 and 2.0 on two drives, and 5 to 6 (`benchmarks/protocol.py`).

    Raises a ``ValueError`` that names the argument unless shapes match, there are at least four
    errors of at most 1000, all is finite, and the covariances are symmetric and positive definite.

    Parameters
    ----------
    errors : (n, 3) array
        Estimate minus reference of [v_x, v_y, omega] in m/s, m/s, rad/s, in time order; of several
        drives one after the other.  Leave out estimates that did not converge.
    covariances : (n, 3, 3) array
        What is stated of these errors without the constants, as `track` states it with an empty
        budget.

    Notes
    -----
    The constants minimise the mean log score of the covariances C_i + diag(u), u >= 0, with the
    squares u of the constants; a constant is zero if the score rises from there on.  Constants and
    noise are told apart where the noise differs between estimates.

    The standard errors allow for errors that stay the same for a while, and for errors that are not
    Gaussian (sandwich).  With B, the variance of the sum of the scores' slopes in u, from
    overlapping blocks of successive estimates (`d2d.block_length`), and the information H, whose
    entries are half the sums of the squared entries of the inverse covariances, u has the
    covariance ``H^-1 B H^-1``.  The standard error of a constant c is that of u over 2 c or, near
    zero, its root.  Intervals are computed in u.  They cannot know of errors that change from drive
    to drive, if all are of one drive.

    Examples
    --------
    Noise that differs from one estimate to the next, and errors that do not:

    >>> import numpy as np
    >>> from d2d.radar import fit_budget
    >>> rng = np.random.default_rng(0)
    >>> noise = rng.uniform(0.01, 0.1, (1000, 1))
    >>> errors = np.hypot(noise, [0.04, 0.0, 0.01]) * rng.standard_normal((1000, 3))
    >>> fit = fit_budget(errors, noise[:, :, None] ** 2 * np.eye(3))
    >>> fit.bounds.round(3)
    array([[0.037, 0.   , 0.007],
           [0.044, 0.007, 0.014]])

    From a drive with a reference, and for it or another one::

        found = compare(track(drive, budget=ErrorBudget()), drive.reference)
        fit = fit_budget(found.errors, found.covariances)
        driven = track(another, budget=fit.budget)
    """
    _POSSIBLE.array("errors", errors)
    e, noise = checked_errors(errors, covariances)
    if e.shape[1] != 3 or len(e) < _FEWEST:
        raise ValueError(
            f"errors must have the shape (n, 3) with n at least {_FEWEST}, but has {e.shape}"
        )
    variances = _most_likely(e, noise)
    of_squares = _standard_errors(e, noise, variances)
    constants = np.sqrt(variances)
    # of a root: by its derivative, or close to zero how far one standard error reaches from there
    near = np.sqrt(of_squares)
    sigmas = np.divide(of_squares, 2.0 * constants, out=near, where=2.0 * constants > near)
    margin = _QUANTILE * of_squares
    bounds = np.sqrt([np.maximum(variances - margin, 0.0), variances + margin])
    score = float(log_score(e, noise + np.diag(variances)).mean())
    v_x, v_y, omega = constants.tolist()
    budget = ErrorBudget(v_x=v_x, v_y=v_y, omega=omega, source=f"fitted to {len(e)} errors")
    return BudgetFit(budget, sigmas, bounds, score, len(e))


def _most_likely(errors: Array, noise: Array) -> Array:
    """The variances (3,) of smallest mean log score, none of them negative."""
    scale = np.mean(errors**2, axis=0) + np.diagonal(noise, axis1=1, axis2=2).mean(axis=0)

    def score(relative: Array) -> tuple[float, Array]:
        precisions, weighted = _weighted(errors, noise + np.diag(scale * relative))
        value = np.einsum("ni,ni->n", errors, weighted) - np.linalg.slogdet(precisions)[1]
        return 0.5 * float(value.mean()), scale * _slopes(precisions, weighted).mean(axis=0)

    found = [
        scipy.optimize.minimize(
            score,
            np.full(3, start),
            jac=True,
            bounds=[(0.0, None)] * 3,
            method="L-BFGS-B",
            options={"gtol": _TOLERANCE, "ftol": 0.0},
        )
        for start in _STARTS
    ]
    return np.asarray(scale * min(found, key=lambda each: float(each.fun)).x)


def _weighted(errors: Array, covariances: Array) -> tuple[Array, Array]:
    """The inverses P of the covariances, and P e (n, 3)."""
    precisions = np.asarray(np.linalg.inv(covariances), np.float64)
    return precisions, np.asarray(np.einsum("nij,nj->ni", precisions, errors))


def _slopes(precisions: Array, weighted: Array) -> Array:
    """Derivatives (n, 3) of each error's log score in the variances."""
    return np.asarray(0.5 * (np.diagonal(precisions, axis1=1, axis2=2) - weighted**2))


def _standard_errors(errors: Array, noise: Array, variances: Array) -> Array:
    """Those (3,) of the variances."""
    precisions, weighted = _weighted(errors, noise + np.diag(variances))
    slopes = _slopes(precisions, weighted)
    centred = slopes - slopes.mean(axis=0)
    block = block_length(centred)
    sums = block_sums(centred, block)
    spread = sums.T @ sums / block / (1.0 - block / len(errors))
    inverse = np.linalg.inv(0.5 * np.sum(precisions**2, axis=0))
    return np.asarray(np.sqrt(np.diagonal(inverse @ spread @ inverse)))
