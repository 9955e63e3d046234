"""Whether an estimator's covariances are credible: NEES, noncredibility index, inclination."""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from d2d._checks import check_tail
from d2d._types import Array
from d2d.scores import checked_errors, normalised_squares


@dataclass(frozen=True, eq=False, repr=False)
class Credibility:
    r"""Comparison of N errors with the covariances that were estimated for them.

    Attributes
    ----------
    nees : (N,) array
        Normalised estimation error squared, :math:`e^{\mathsf T} \Sigma^{-1} e`; ideally n.
    anees : float
        Average NEES over runs and dimensions; 1 is ideal, more is optimistic.
    bounds : (2,) array
        Two-sided chi-square region of ``anees`` for a credible estimator.
    consistent : bool
        Whether ``anees`` lies within ``bounds``.
    credible_nees : (N,) array
        NEES of the same errors with their actual mean square error matrix as the covariance.
    ratio : (N,) array
        Credibility ratio :math:`\rho` = nees / credible_nees; above 1 is optimistic.
    nci : float
        Noncredibility index, the mean of :math:`10\, |\log_{10} \rho|`, in dB; 0 is ideal.
    inclination : float
        Inclination indicator I², the mean of :math:`10 \log_{10} \rho`, in dB; above 0 is
        optimistic, below 0 pessimistic.
    """

    nees: Array
    anees: float
    bounds: Array
    consistent: bool
    credible_nees: Array
    ratio: Array
    nci: float
    inclination: float

    def __repr__(self) -> str:
        low, high = self.bounds.tolist()
        found = "consistent" if self.consistent else "not consistent"
        return (
            f"Credibility({len(self.nees)} errors, ANEES {self.anees:.3g}, {found} with "
            f"[{low:.3g}, {high:.3g}], NCI {self.nci:.2g} dB, I^2 {self.inclination:+.2g} dB)"
        )


def credibility(errors: ArrayLike, covariances: ArrayLike, confidence: float = 0.95) -> Credibility:
    """Compare estimation errors with their estimated covariances.

    The errors (N, n) are estimate minus truth in N independent runs, N > n; the covariances
    (N, n, n), or (n, n) for all, are symmetric positive definite; the ``confidence`` within (0, 1)
    is the probability content of the two-sided region.  Leave out runs that did not converge, and
    report their number.

    Notes
    -----
    The NEES and its region follow Bar-Shalom, Li & Kirubarajan (2001), NCI and I² Li & Zhao
    (2006); the thesis (sec. 6.2) prints Σ instead of Σ⁻¹ in the NEES.

    Examples
    --------
    Errors twice as large as their covariance states:

    >>> import numpy as np
    >>> from d2d import credibility
    >>> errors = 2.0 * np.random.default_rng(0).standard_normal((1000, 3))
    >>> verdict = credibility(errors, np.eye(3))
    >>> verdict.consistent, round(verdict.anees), round(verdict.inclination)
    (False, 4, 6)
    """
    e, sigma = checked_errors(errors, covariances)
    runs, n = e.shape
    if not n < runs:
        raise ValueError(f"errors must hold more runs than dimensions, but has the shape {e.shape}")
    tail = check_tail(confidence)
    scale = np.abs(e).max(axis=0)  # the axes may have different units, and squares must be finite
    e = e / np.where(scale > 0.0, scale, 1.0)
    actual = e.T @ e / runs
    if not scale.all() or np.linalg.matrix_rank(actual, hermitian=True) < n:
        raise ValueError("errors must span all dimensions: their mean square matrix is singular")

    credible = normalised_squares(e, actual)
    nees = np.full(runs, np.nan)
    with np.errstate(all="ignore"), suppress(np.linalg.LinAlgError):  # which are refused
        nees = normalised_squares(e, sigma / scale[:, None] / scale)
    if not (np.isfinite(nees) & ((nees > 0.0) | (credible == 0.0))).all():
        raise ValueError("errors and covariances must be of sizes whose ratio can be told")
    # an error of exactly zero is perfectly credible: 0 / 0 counts as 1
    ratio = np.divide(nees, credible, out=np.ones_like(nees), where=credible > 0)
    decibel = 10.0 * np.log10(ratio)
    anees = float(nees.mean() / n)
    # chdtri takes the upper tail
    bounds = scipy.special.chdtri(runs * n, np.array([1.0 - tail, tail])) / (runs * n)
    return Credibility(
        nees=nees,
        anees=anees,
        bounds=bounds,
        consistent=bool(bounds[0] <= anees <= bounds[1]),
        credible_nees=credible,
        ratio=ratio,
        nci=float(np.abs(decibel).mean()),
        inclination=float(decibel.mean()),
    )
