"""A second opinion on an estimate's covariance: from the scatter of the targets' scores."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from d2d import rigid
from d2d._checks import check_instance, check_shape, is_masked
from d2d._kernel import layout, rows
from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.covariance import check_estimate, fisher_covariance, propagated, select
from d2d.measurement import LinearMeasurement
from d2d.point_set import PointSet
from d2d.problem import Bound, Estimate, Problem

# A target whose neighbourhood holds nearly all the information about a direction cannot be left
# out; the step is then taken to be at most ten times that of the first order.
_MAX_LEVERAGE = 0.9
_CHANCE = 2.0  # standard deviations of the scatter that chance explains


def sandwich_covariance(
    estimate: Estimate,
    fixed: PointSet,
    moving: PointSet,
    cost: RegistrationCost | None = None,
    *,
    measurement: LinearMeasurement | None = None,
    groups: ArrayLike | None = None,
) -> Array:
    r"""Covariance of an optimum from the scatter of the targets' scores (Huber 1967, Godambe 1960).

    A second opinion, which needs neither the targets' covariances nor their independence,

    .. math:: \Sigma_\theta = H^{-1} \Bigl(\sum_{kl} \kappa_{kl}\, s_k s_l^{\mathsf T}\Bigr) H^{-1},

    with the score :math:`s_k`, the gradient of target k's part of the cost, and
    :math:`\kappa_{kl} = 1` for targets of one group, whose errors are correlated, else 0.

    The covariance (..., P, P) of ``theta`` is nan where the estimate did not converge.  It is the
    inverse Hessian unless the scores clearly contradict that.  Raises a ``ValueError`` if the
    estimate is one of other arguments.

    Parameters
    ----------
    estimate : Estimate
        The result of `register` with the same sets, cost and measurement.
    fixed, moving, cost, measurement
        As for `register`.
    groups : (..., K) array, optional
        Labels of the moving targets.  Those with the same label, such as the targets of one object,
        are correlated, others are independent; so a label for targets of no object, such as -1,
        makes one object of them.  By default, all are independent.

    Notes
    -----
    Scores of a few targets, or groups, scatter too little, and the shape of their scatter is
    random: `godambe` says what is done about both.  What all targets share, such as a bias of the
    sensor, does not show in them.
    """
    cost = RegistrationCost() if cost is None else cost
    check_instance("cost", cost, RegistrationCost)
    check_instance("estimate", estimate, Estimate)
    problem = cost.problem(fixed, moving, measurement)
    theta = rigid.motion("estimate", estimate.theta, fixed.dimension)
    bound = problem.bind(theta)
    check_estimate(estimate, problem, bound)
    known = np.isfinite(estimate.covariance).all(axis=(-2, -1))
    known = np.broadcast_to(known, bound.shape).ravel()
    labels, p = _labels(moving, bound, groups), problem.parameters
    outward, covariance = np.eye(p), np.full((len(known), p, p), np.nan)
    if measurement is None and fixed.dimension == 2:
        # Nothing measured of the motion itself: the origin is arbitrary, but the effect of leaving
        # out a target is computed to first order and depends on it.
        bound, outward = problem.about_means(bound)
    scores, hessians = target_scores(problem, bound)
    for b in np.flatnonzero(known).tolist():
        if not np.isfinite(fisher_covariance(hessians[b].sum(axis=0))).all():
            raise ValueError(
                "estimate must be an optimum of this cost, but the Hessian of its targets is not "
                "positive definite there"
            )
        covariance[b] = godambe(scores[b], hessians[b], labels[b])
    return propagated(outward, covariance.reshape(*bound.shape, p, p))


def target_scores(problem: Problem, bound: Bound) -> tuple[Array, Array]:
    """Contributions of each target to the gradient (B, K, P) and the Hessian (B, K, P, P)."""
    wanted = (rows.LOG_DENSITY, *rows.GRADIENT, *rows.CURVATURE)
    terms = np.swapaxes(problem.of_targets(bound, wanted), -2, -1)
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


def _labels(moving: PointSet, bound: Bound, groups: ArrayLike | None) -> NDArray[Any]:
    """The labels (B, K) of the targets of each problem of a batch."""
    labels = np.arange(moving.size) if groups is None else np.asarray(groups)
    check_shape("groups", labels, f"(..., {moving.size})", like="moving")
    kinds = {type(label) for label in labels.ravel().tolist()} if labels.dtype == object else set()
    if is_masked(groups) or labels.dtype.kind not in "biufUSO" or not kinds <= {str}:
        raise ValueError("groups must be numbers or strings, without masked or missing ones")
    if (labels != labels).any():
        raise ValueError("groups must not hold nan; give each such target a label of its own")
    return select(np.broadcast_to(labels, (*bound.shape, moving.size)), 1, bound)


def godambe(scores: Array, hessians: Array, labels: NDArray[Any]) -> Array:
    r"""The covariance (P, P) of `sandwich_covariance` from scores (K, P) and Hessians (K, P, P).

    Targets with the same label (K,) have :math:`\kappa_{kl} = 1`, others 0.  All is computed in
    parameters in which :math:`H = \sum_k H_k`, which must be positive definite, is the identity.

    - Each score is replaced by the Newton step of the optimum when the target's group is left out,
      :math:`(I - \sum_l \kappa_{kl} H_l)^{-1} s_k`: the jackknife that leaves out a group (CR3).
      With the root of that matrix instead, the result W is right on average wherever the inverse
      Hessian is (CR2, Bell & McCaffrey 2002).
    - The part of the deviation :math:`W - I` that chance explains is removed by the factor
      :math:`(1 - c^2 / \|W - I\|^2)_+` (James & Stein 1961), with c twice the standard deviation
      of W of :math:`1 / \sum_{kl} b_k b_l \kappa_{kl}` groups, which the targets are worth with
      their information :math:`b_k = \operatorname{tr}(H^{-1} H_k) / P`.
    """
    p = scores.shape[-1]
    group = np.unique(labels, return_inverse=True)[1]

    def totals(values: Array) -> Array:
        """Sums (K, ...) over all targets of each target's group."""
        sums = np.zeros((group.max() + 1, *values.shape[1:]))
        np.add.at(sums, group, values)
        return np.asarray(sums[group])

    back = np.linalg.inv(np.linalg.cholesky(hessians.sum(axis=0)))
    information = back @ hessians @ back.T
    together = totals(information)
    leverage, axes = np.linalg.eigh(0.5 * (together + np.swapaxes(together, 1, 2)))
    along = np.einsum("kij,ki->kj", axes, scores @ back.T)
    rest = 1.0 - np.minimum(leverage, _MAX_LEVERAGE)
    steps = [along * rest**power for power in (-0.5, -1.0)]
    both = np.concatenate([np.einsum("kij,kj->ki", axes, step) for step in steps], axis=1)
    scatter = both.T @ totals(both)
    scatter = 0.5 * (scatter + scatter.T)
    unbiased, jackknife = (scatter[i : i + p, i : i + p] - np.eye(p) for i in (0, p))
    share = np.trace(information, axis1=1, axis2=2) / p
    chance = _CHANCE**2 * p * (p + 1) * float(share @ totals(share))
    seen = float((unbiased * unbiased).sum())
    kept = 1.0 - chance / seen if seen > chance else 0.0
    found = back.T @ (np.eye(p) + kept * jackknife) @ back
    return np.asarray(0.5 * (found + found.T))
