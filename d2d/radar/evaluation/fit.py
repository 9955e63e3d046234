"""An error budget by maximum likelihood, from the errors of a track against a reference."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from d2d._checks import check_finite, check_mapping
from d2d._types import Array
from d2d.bootstrap import covariance_of_sum
from d2d.radar.scans.budget import ErrorBudget
from d2d.scores import checked_errors, log_score

_SEMIDEFINITE, _DISTINCT = 1e-9, 1e-8  # relative eigenvalues of an effect, and of all of them
_STARTS = (0.01, 1.0)  # constants' variances, relative to the usual errors' squares
_SPREAD = (0.1, 0.9)  # quantiles of the errors' squares, at which the search starts besides
_TOLERANCE = 1e-8  # of the mean log score's gradient, per relative change of a variance
_LEVEL = 1e-4  # that it may have where rounding ends the search
_QUANTILE = 1.96  # of a normal distribution, for intervals of 95 %
_FITTED = ("v_x", "v_y", "omega", "azimuth", "doppler", "scale", "lag")


@dataclass(frozen=True, eq=False)
class BudgetFit:
    """Numbers of an error budget and how well the errors determine them.

    The rest of the ``budget`` is zero.  An interval that begins at zero says that the errors do not
    tell the number from none, and its end how large it may be.
    """

    budget: ErrorBudget
    names: tuple[str, ...]  # of the p numbers that were fitted
    sigmas: Array  # (p,), their standard errors, in their own units
    bounds: Array  # (2, p), their 95 % intervals
    log_score: float  # mean negative log density of the errors, see `d2d.log_score`
    estimates: int  # number of errors

    @property
    def values(self) -> Array:
        """The numbers (p,)."""
        return np.array([getattr(self.budget, name) for name in self.names])


def fit_budget(
    errors: ArrayLike, covariances: ArrayLike, effects: Mapping[str, ArrayLike] | None = None
) -> BudgetFit:
    """Fit numbers of an error budget to errors of estimates, by maximum likelihood.

    By default, three variances are fitted that add to every covariance, whatever the number of
    targets and sensors.  With ``effects`` it is the standard deviations of causes, such as an
    azimuth bias, each of which changes every estimate in its own way.  Neither holds where few
    targets are left.

    Raises a ``ValueError`` that names the argument if shapes or values are wrong, there are fewer
    errors than numbers, or two effects are the same in all estimates.

    Parameters
    ----------
    errors : (n, 3) array
        Estimate minus reference of [v_x, v_y, omega] in m/s, m/s, rad/s, in time order; of several
        drives one after the other.  Leave out estimates that did not converge.
    covariances : (n, 3, 3) array
        What is stated of these errors without the numbers, as `track` states it with an empty
        budget.
    effects : mapping of str to (n, 3, 3) array, optional
        By ``"azimuth"``, ``"doppler"``, ``"scale"``, ``"lag"``, ``"v_x"``, ``"v_y"`` or
        ``"omega"``, what a standard deviation of one adds to each covariance: products of the
        columns of ``FilterInput.slow``, over the squared number of the budget that made them.

    Examples
    --------
    >>> import numpy as np
    >>> from d2d.radar import fit_budget
    >>> rng = np.random.default_rng(0)
    >>> noise = rng.uniform(0.01, 0.1, (1000, 1))
    >>> errors = np.hypot(noise, [0.04, 0, 0.01]) * rng.standard_normal((1000, 3))
    >>> fit = fit_budget(errors, noise[:, :, None] ** 2 * np.eye(3))
    >>> fit.bounds.round(3)
    array([[0.037, 0.   , 0.007],
           [0.044, 0.007, 0.014]])
    """
    e, noise = checked_errors(errors, covariances)
    if effects is None:
        effects = {name: np.diag(row) for name, row in zip(_FITTED, np.eye(3), strict=False)}
    names, causes = _checked_effects(effects, len(e))
    if e.shape[1] != 3 or len(e) <= len(names):
        raise ValueError(
            f"errors must have the shape (n, 3) with n at least {len(names) + 1}, but has {e.shape}"
        )
    try:
        with np.errstate(all="ignore"):  # what is not finite is refused
            model = _Model.of(e, noise, causes)
            relative = _most_likely(model)
            variances = model.scale * relative
            of_squares = model.scale * _standard_errors(model, relative, names)
            score = float(log_score(e, noise + np.einsum("p,pnij->nij", variances, causes)).mean())
            good = bool(np.isfinite([score, *variances, *of_squares]).all())
    except np.linalg.LinAlgError:
        good = False
    if not good:
        raise ValueError(
            "covariances must be of sizes that can be compared, but what is to be added to them "
            "cannot be told beside all of them"
        )
    values, margin = np.sqrt(variances), _QUANTILE * of_squares
    bounds = np.sqrt([np.maximum(variances - margin, 0.0), variances + margin])
    fitted = dict(zip(names, values.tolist(), strict=True))
    with np.errstate(all="ignore"):  # the root of a square close to zero: one standard error of it
        sigmas = np.fmin(np.sqrt(of_squares), of_squares / (2.0 * values))
    budget = ErrorBudget(**fitted, source=f"fitted to {len(e)} errors")
    return BudgetFit(budget, names, sigmas, bounds, score, len(e))


def _checked_effects(effects: Mapping[str, ArrayLike], count: int) -> tuple[tuple[str, ...], Array]:
    """The names of p effects, and the effects (p, n, 3, 3)."""
    if not check_mapping("effects", effects, object):
        raise ValueError("effects must hold at least one number of the budget")
    arrays = []
    for name, effect in effects.items():
        if name not in _FITTED:
            raise ValueError(f"effects must be of {', '.join(_FITTED)}, not {name!r}")
        each = check_finite(f"effects[{name!r}]", effect, f"({count}, 3, 3)", "(3, 3)")
        if not each.any():
            raise ValueError(f"effects[{name!r}] is zero: the errors say nothing about it")
        if np.linalg.eigvalsh(each).min() < -_SEMIDEFINITE * np.abs(each).max():
            raise ValueError(f"effects[{name!r}] must be positive semidefinite")
        arrays.append(np.broadcast_to(each, (count, 3, 3)))
    return tuple(effects), np.array(arrays)


class _Model(NamedTuple):
    """Errors whose covariances are I + ∑ⱼ uⱼ scale_j Eⱼ, after whitening by their noise."""

    errors: Array  # (n, 3)
    effects: Array  # (p, n, 3, 3), the scaled E
    scale: Array  # (p,): with u = 1, an effect alone explains a direction of the usual error
    starts: Array  # (S, p), of u

    @classmethod
    def of(cls, errors: Array, noise: Array, effects: Array) -> "_Model":
        """The model, whatever the scales of the covariances, which may differ."""
        roots = np.linalg.cholesky(noise)
        errors = np.linalg.solve(roots, errors[..., None])[..., 0]
        half = np.linalg.solve(roots, effects)
        effects = np.linalg.solve(roots, np.swapaxes(half, -1, -2))
        shares = np.diagonal(effects, axis1=-2, axis2=-1) / (1.0 + errors**2)
        seen = [share[share > 0.0] for share in shares.max(axis=-1)]
        if not all(len(share) and np.isfinite(share).all() for share in seen):
            raise ValueError("covariances must not be so small or large that their effect is lost")
        scale = np.array([1.0 / np.median(share) for share in seen])
        spread = [1.0 / (scale * [np.quantile(own, q) for own in seen]) for q in _SPREAD]
        starts = np.array([*np.multiply.outer(_STARTS, np.ones(len(scale))), *spread])
        return cls(errors, scale[:, None, None, None] * effects, scale, starts)

    def at(self, relative: Array) -> tuple[Array, Array, Array]:
        """Log scores (n,) but for a constant, slopes (n, p), inverse covariances (n, 3, 3)."""
        covariances = np.eye(3) + np.einsum("p,pnij->nij", relative, self.effects)
        precisions = np.asarray(np.linalg.inv(covariances), np.float64)
        weighted = np.einsum("nij,nj->ni", precisions, self.errors)
        scores = np.einsum("ni,ni->n", self.errors, weighted) - np.linalg.slogdet(precisions)[1]
        rest = precisions - weighted[:, :, None] * weighted[:, None, :]
        return 0.5 * scores, 0.5 * np.einsum("nij,pnij->np", rest, self.effects), precisions


def _most_likely(model: _Model) -> Array:
    """The u (p,) of smallest mean log score, none of them negative."""

    def score(relative: Array) -> tuple[float, Array]:
        scores, slopes, _ = model.at(relative)
        return float(scores.mean()), slopes.mean(axis=0)

    options: Any = {"options": {"gtol": _TOLERANCE, "ftol": 0.0}, "method": "L-BFGS-B"}
    bounds = [(0.0, None)] * len(model.scale)
    optima = [
        scipy.optimize.minimize(score, start, jac=True, bounds=bounds, **options)
        for start in model.starts
    ]
    best = np.asarray(min(optima, key=lambda optimum: float(optimum.fun)).x)
    slope = score(best)[1]
    if not (np.abs(np.where(best > 0.0, slope * best, np.minimum(slope, 0.0))) < _LEVEL).all():
        raise ValueError("errors and covariances must have a most likely budget, but none is found")
    return best


def _standard_errors(model: _Model, relative: Array, names: Sequence[str]) -> Array:
    """Standard errors (p,) of the fitted u."""
    _, slopes, precisions = model.at(relative)
    spread, _ = covariance_of_sum(slopes)
    shares = precisions @ model.effects
    information = 0.5 * np.einsum("pnij,qnji->pq", shares, shares)
    scale = np.sqrt(np.diagonal(information))
    if not (np.isfinite(information).all() and scale.all()):
        return np.full(len(scale), np.nan)
    units = np.outer(scale, scale)
    values, vectors = np.linalg.eigh(information / units)
    if values[0] < _DISTINCT:
        alike = [name for name, part in zip(names, vectors[:, 0], strict=True) if abs(part) > 0.1]
        raise ValueError(
            f"effects must differ between the estimates, but {' and '.join(alike)} have the same "
            "in all of them: leave one out"
        )
    inverse = np.linalg.inv(information / units) / units
    return np.asarray(np.sqrt(np.diagonal(inverse @ spread @ inverse)))
