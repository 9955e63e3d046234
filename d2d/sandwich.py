"""A second opinion on an estimate's covariance: from the scatter of the targets' scores.

A target's score is the gradient of its part of the cost (Huber 1967, Godambe 1960).  At an optimum
the scores add up to zero, and their scatter shows how uncertain the optimum is, whatever the
reason: the covariances of the targets are not needed, and their errors may be correlated.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from d2d import rigid
from d2d._checks import check_covariances, check_instance, check_positive_scalar, check_real
from d2d._kernel import layout
from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.covariance import check_estimate, fisher_covariance, select
from d2d.frame import Frame, is_far
from d2d.measurement import LinearMeasurement
from d2d.point_set import PointSet
from d2d.problem import Bound, Problem
from d2d.registration import Estimate

# A target whose neighbourhood holds nearly all the information about a direction cannot be left
# out; the step is then taken to be at most ten times that of the first order.
_MAX_LEVERAGE = 0.9
_CHANCE = 2.0  # standard deviations of the scatter that chance explains
_ROWS_AT_ONCE = 32  # of the matrix of all targets' correlations
_REACH = 7.0  # lengths, beyond which a correlation is below 3e-11

Sums = Callable[[Array], Array]


class Neighbours(NamedTuple):
    """Sums (K, M) of values (K, M) over each target's neighbours, itself included.

    Weighted by the correlation of the two targets' errors, or by its square.
    """

    weighted: Sums
    squared: Sums


def grouped(labels: NDArray[Any]) -> Neighbours:
    """Targets with the same label (K,) have fully correlated errors, others independent ones."""
    which = np.unique(labels, return_inverse=True)[1]

    def sums(values: Array) -> Array:
        totals = np.zeros((which.max() + 1, *values.shape[1:]))
        np.add.at(totals, which, values)
        return np.asarray(totals[which])

    return Neighbours(sums, sums)


def nearby(positions: Array, length: float) -> Neighbours:
    """The errors at positions (K, D) are correlated by exp(-d^2 / (2 length^2)).

    This is positive definite in any dimension.  Its square is the same with another length.
    """
    order = np.argsort(positions[:, 0], kind="stable")

    def summing(scale: float) -> Sums:
        scaled = positions[order] / scale
        along = scaled[:, 0]

        def sums(values: Array) -> Array:
            total, ordered = np.empty(values.shape), values[order]
            for first in range(0, len(values), _ROWS_AT_ONCE):
                rows = slice(first, first + _ROWS_AT_ONCE)
                reach = along[rows][0] - _REACH, along[rows][-1] + _REACH
                columns = slice(*np.searchsorted(along, reach))
                square = np.zeros((len(along[rows]), len(along[columns])))
                for axis in scaled.T:
                    square += (axis[rows, None] - axis[columns]) ** 2
                total[order[rows]] = np.exp(-0.5 * square) @ ordered[columns]
            return total

        return sums

    return Neighbours(summing(length), summing(length / math.sqrt(2.0)))


def sandwich_covariance(
    estimate: Estimate,
    fixed: PointSet,
    moving: PointSet,
    cost: RegistrationCost | None = None,
    *,
    measurement: LinearMeasurement | None = None,
    length: float | None = None,
    groups: ArrayLike | None = None,
    reference: ArrayLike | None = None,
    floor: bool = False,
) -> Array:
    """Covariance of the optimum from the scatter of the targets' scores (Huber 1967, Godambe 1960).

    A second opinion, which needs neither the targets' covariances nor their independence::

        Sigma_theta = H^-1 (sum_kl kappa_kl s_k s_l') H^-1

    with the score s_k, the gradient of target k's part of the cost, and the correlation kappa_kl of
    the errors of two targets.

    The covariance (..., P, P) of ``theta`` is nan where the estimate did not converge.  Raises a
    ``ValueError`` if an argument is invalid, or the cost that the estimate states is not that of
    the others.

    Parameters
    ----------
    estimate : Estimate
        The result of `register` with the same sets, cost and measurement.
    fixed, moving, cost, measurement
        As for `register`.
    length : float, optional
        Errors of moving targets at a distance d are correlated by exp(-d^2 / (2 length^2)), in m.
    groups : (..., K) array, optional
        Labels of the moving targets.  Those with the same label, such as the targets of one object,
        are correlated, others are independent; so a label for targets of no object, such as -1,
        makes one object of them.  Without ``length`` and ``groups``, all are independent.
    reference : (..., P, P) array, optional
        The covariance that is kept unless the scores clearly contradict it; by default the inverse
        Hessian.  For costs whose inverse Hessian is not a covariance, such as the sum, take that of
        `propagate_covariance`.
    floor : bool
        Whether the covariance may only grow beyond the reference R: the eigenvalues below 1 of
        ``R^(-1/2) Sigma_theta R^(-1/2)`` become 1.

    Notes
    -----
    Scores add up to zero at the optimum.  The scores of a few targets, or groups, therefore scatter
    too little, and the shape of their scatter is random.  So each score is replaced by the shift of
    the optimum when its group, or neighbourhood, is left out (CR3, Bell & McCaffrey 2002), and the
    deviation from the reference is reduced by twice what chance explains (James & Stein 1961); a
    smaller deviation is dropped.  Eight independent targets thus give the reference unless they
    clearly contradict it.  `godambe` has the formulas.

    Only errors that differ between targets, or groups, show in the scores.  What all targets share,
    such as a bias of the sensor, does not.
    """
    cost = RegistrationCost() if cost is None else cost
    check_instance("cost", cost, RegistrationCost)
    check_instance("estimate", estimate, Estimate)
    problem = cost.problem(fixed, moving, measurement)
    theta = rigid.motion("estimate", estimate.theta, fixed.dimension)
    bound = problem.bind(theta)
    # Nothing measured of the motion itself: the origin is arbitrary, but the effect of leaving out
    # a target is computed to first order and depends on it.
    free = measurement is None and fixed.dimension == 2
    check_estimate(estimate, problem, bound, hessians=not is_far(fixed, moving, measurement))
    known = np.isfinite(estimate.covariance).all(axis=(-2, -1))
    known = np.broadcast_to(known, bound.shape).ravel()
    neighbours = _neighbours(moving, bound, length, groups)
    given = None if reference is None else _reference(reference, known, bound, problem.parameters)
    if not free:
        return _from_scores(problem, bound, known, neighbours, given, floor)
    frame = Frame(fixed.means.mean(axis=-2), moving.means.mean(axis=-2))
    problem = cost.problem(*frame.shifted(fixed, moving))
    bound = problem.bind(frame.inward(theta))
    if given is not None:
        inner = frame.covariance_inward(theta, given.reshape(*bound.shape, 3, 3))
        given = _reference(inner, known, bound, 3)
    found = _from_scores(problem, bound, known, neighbours, given, floor)
    return frame.covariance_outward(theta, found)


def _from_scores(
    problem: Problem,
    bound: Bound,
    known: NDArray[np.bool_],
    neighbours: Callable[[int], Neighbours],
    reference: Array | None,
    floor: bool,
) -> Array:
    """`godambe` (..., P, P) of each problem whose estimate is known; nan of the others.

    Without a ``reference`` (B, P, P) it is the inverse Hessian.
    """
    p = problem.parameters
    covariance = np.full((len(bound.thetas), p, p), np.nan)
    scores, hessians = target_scores(problem, bound)
    for b in np.flatnonzero(known).tolist():
        inverse = fisher_covariance(hessians[b].sum(axis=0))
        if not np.isfinite(inverse).all():
            raise ValueError(
                "estimate must be an optimum of this cost, but the Hessian of its targets is not "
                "positive definite there"
            )
        stands = inverse if reference is None else reference[b]
        covariance[b] = godambe(scores[b], hessians[b], neighbours(b), stands, floor)
    return covariance.reshape(*bound.shape, p, p)


def target_scores(problem: Problem, bound: Bound) -> tuple[Array, Array]:
    """What each target adds to the gradient (B, K, P) and Hessian (B, K, P, P) of the cost."""
    rows = (layout.LOG_DENSITY, *layout.GRADIENT, *layout.CURVATURE)
    terms = np.swapaxes(problem.of_targets(bound, rows), -2, -1)
    terms = terms.reshape(-1, *terms.shape[-2:])
    g, second = terms[..., 1:4], terms[..., 4:].reshape(*terms.shape[:2], 3, 3)
    outer = g[..., :, None] * g[..., None, :]
    if problem.form.fusion == layout.SUMMING:
        share = np.exp(terms[..., 0] - terms[..., 0].max(axis=1, keepdims=True))
        share /= share.sum(axis=1, keepdims=True)
        mean = (share[..., None] * g).sum(axis=1)[:, None]
        outer = 0.5 * (g[..., :, None] * mean[..., None, :])
        outer = outer + np.swapaxes(outer, -1, -2)
        g, second = share[..., None] * g, share[..., None, None] * second
        outer = share[..., None, None] * outer
    p = problem.parameters
    return -g[..., :p], (outer - second)[..., :p, :p]


def _reference(reference: ArrayLike, known: NDArray[np.bool_], bound: Bound, p: int) -> Array:
    """The reference (B, P, P) of each problem, positive definite wherever the estimate is known."""
    array = check_real("reference", reference)
    if array.shape[-2:] != (p, p) or array.shape[:-2] not in ((), bound.shape):
        raise ValueError(
            f"reference must have the shape {(*bound.shape, p, p)} or {(p, p)}, "
            f"but has {array.shape}"
        )
    every = select(array, 2, bound)
    every[known] = check_covariances("reference", every[known])
    return every


def _neighbours(
    moving: PointSet, bound: Bound, length: float | None, groups: ArrayLike | None
) -> Callable[[int], Neighbours]:
    """Which targets of each problem of a batch have correlated errors."""
    if length is not None and groups is not None:
        raise ValueError("length and groups must not both be given")
    if length is not None:
        scale = check_positive_scalar("length", length)
        positions = select(moving.means, 2, bound)
        return lambda b: nearby(positions[b], scale)
    labels = np.arange(moving.size) if groups is None else np.asarray(groups)
    if labels.shape[-1:] != (moving.size,):
        raise ValueError(
            f"groups must have the shape (..., {moving.size}) to match moving, but has "
            f"{labels.shape}"
        )
    if (labels != labels).any():
        raise ValueError("groups must not hold nan; give each such target a label of its own")
    own = select(np.broadcast_to(labels, (*bound.shape, moving.size)), 1, bound)
    return lambda b: grouped(own[b])


def godambe(
    scores: Array, hessians: Array, neighbours: Neighbours, reference: Array, floor: bool
) -> Array:
    """H^-1 (sum_kl kappa_kl s_k s_l') H^-1 (P, P) of scores (K, P) and Hessians (K, P, P).

    - In parameters in which H = sum_k H_k is the identity, each score is replaced by the Newton
      step of the optimum when the target's neighbourhood is left out,
      (I - sum_l kappa_kl H_l)^-1 s_k.  For groups this is the jackknife that leaves out one group
      at a time (CR3).  With the root of that matrix instead, the result is right on average
      wherever the inverse Hessian is (CR2, Bell & McCaffrey 2002).
    - In parameters in which ``reference`` (P, P) is the identity, the part of the deviation W - I
      that chance explains is removed by the factor
      ``(1 - c^2 / |W - I|^2)_+`` (James & Stein 1961).  Here c is twice the standard deviation of W
      of as many independent groups as the targets are worth, n = 1 / sum_kl b_k b_l kappa_kl^2,
      with their information b_k = tr(H^-1 H_k) / P.
    - With ``floor``, eigenvalues below 1 become 1 there.

    H and ``reference`` must be positive definite.
    """
    p = scores.shape[-1]
    back = np.linalg.inv(np.linalg.cholesky(hessians.sum(axis=0)))
    information = back @ hessians @ back.T
    together = neighbours.weighted(information.reshape(-1, p * p)).reshape(-1, p, p)
    leverage, axes = np.linalg.eigh(0.5 * (together + np.swapaxes(together, 1, 2)))
    along = np.einsum("kij,ki->kj", axes, scores @ back.T)
    rest = 1.0 - np.minimum(leverage, _MAX_LEVERAGE)
    root = np.linalg.cholesky(reference)
    to_reference = back @ np.linalg.inv(root).T

    def corrected(power: float) -> Array:
        return np.asarray(np.einsum("kij,kj->ki", axes, along * rest**power) @ to_reference)

    both = np.concatenate([corrected(-0.5), corrected(-1.0)], axis=1)
    scatter = both.T @ neighbours.weighted(both)
    scatter = 0.5 * (scatter + scatter.T)
    unbiased, jackknife = (scatter[i : i + p, i : i + p] - np.eye(p) for i in (0, p))
    share = np.trace(information, axis1=1, axis2=2)[:, None] / p
    chance = _CHANCE**2 * p * (p + 1) * float((share * neighbours.squared(share)).sum())
    seen = float((unbiased * unbiased).sum())
    kept = 1.0 - chance / seen if seen > chance else 0.0
    values, vectors = np.linalg.eigh(np.eye(p) + kept * jackknife)
    if floor:
        values = np.maximum(values, 1.0)
    whole = root @ vectors
    return np.asarray((whole * values) @ whole.T)
