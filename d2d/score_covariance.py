"""A second opinion on an estimate's covariance: from the scatter of the targets' scores."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from d2d import rigid
from d2d._checks import (
    broadcast_batches,
    check_covariances,
    check_flag,
    check_instance,
    check_positive_scalar,
    check_real,
)
from d2d._kernel import MOTION
from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.covariance import bind_pair, check_estimate, fisher_covariance, parts_of, taken_by
from d2d.frame import Frame, about_mean
from d2d.measurement import LinearMeasurement
from d2d.point_set import PointSet
from d2d.problem import Bound, Pair, Problem
from d2d.registration import Estimate
from d2d.sandwich import Neighbours, godambe, grouped, nearby


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
        Whether the result is nowhere below the reference: the eigenvalues below 1 of
        ``R^(-1/2) Sigma_theta R^(-1/2)``, with the reference R, become 1.

    Returns
    -------
    (..., P, P) array
        Covariance of ``theta``; nan where the estimate did not converge.

    Raises
    ------
    ValueError
        If an argument is invalid, or the cost that the estimate states is not that of the others;
        the message names it.

    Notes
    -----
    Scores add up to zero at the optimum.  The scores of a few targets, or groups, therefore scatter
    too little, and the shape of their scatter is random.  So each score is replaced by the shift of
    the optimum when its group, or neighbourhood, is left out (CR3, Bell & McCaffrey 2002), and the
    deviation from the reference is reduced by twice what chance explains (James & Stein 1961); a
    smaller deviation is dropped.  Eight independent targets thus give the reference unless they
    clearly contradict it.  `d2d.sandwich.godambe` has the formulas.

    Only errors that differ between targets, or groups, show in the scores.  What all targets share,
    such as a bias of the sensor, does not.
    """
    cost = RegistrationCost() if cost is None else cost
    check_instance("cost", cost, RegistrationCost)
    check_instance("estimate", estimate, Estimate)
    problem, _ = bind_pair(estimate.theta, fixed, moving, cost, measurement)
    return problem_sandwich(
        problem, estimate, length=length, groups=groups, reference=reference, floor=floor
    )


def problem_sandwich(
    problem: Problem,
    estimate: Estimate,
    *,
    length: float | None = None,
    groups: ArrayLike | None = None,
    reference: ArrayLike | None = None,
    floor: bool = False,
) -> Array:
    """The covariance of `sandwich_covariance` for the optimum of any problem.

    If the problem has several pairs, ``groups`` labels the moving targets of all, one pair after
    the other.  Positions are those in the sets, so a target that is in several pairs has
    correlation 1 with itself.  The inverse Hessian treats it as several independent targets; the
    propagated covariance does not, and is the better reference there.
    """
    check_flag("floor", floor)
    bound = problem.bind(rigid.motion("estimate", estimate.theta, problem.pairs[0].fixed.dimension))
    check_estimate(estimate, problem, bound)
    known = np.isfinite(estimate.covariance).all(axis=(-2, -1))
    known = np.broadcast_to(known, bound.shape).ravel()
    stands: Array | None = None
    if not _is_free(problem):
        own = estimate.covariance if reference is None else reference
        stands = _reference(own, known, bound, problem.parameters)
        found = _from_scores(problem, bound, known, length, groups, stands, floor)
        return found.reshape(*bound.shape, *found.shape[1:])
    centred, frame = _about_means(problem, bound)
    inner = centred.bind(frame.inward(_thetas(bound)).reshape(*bound.shape, 3))
    if reference is not None:
        given = _reference(reference, known, bound, 3)
        given = frame.inner_covariance(inner.thetas, given).reshape(*bound.shape, 3, 3)
        stands = _reference(given, known, bound, 3)
    found = _from_scores(centred, inner, known, length, groups, stands, floor)
    return frame.covariance(inner.thetas, found).reshape(*bound.shape, 3, 3)


def _is_free(problem: Problem) -> bool:
    """Whether the sets' origin is arbitrary: planar, with nothing measured of the motion itself."""
    fixed, _, measurement, _ = problem.pairs[0]
    return problem.kind == MOTION and measurement is None and fixed.dimension == 2


def _thetas(bound: Bound) -> Array:
    """The parameters (B, 3) in the user's frame."""
    return bound.thetas if bound.given is None else bound.given


def _about_means(problem: Problem, bound: Bound) -> tuple[Problem, Frame]:
    """The problem of a single pair, shifted to the means of its sets, and where these are.

    The effect of leaving out a target is computed to first order and depends on the origin.
    """
    fixed, there = about_mean(problem.pairs[0].fixed)
    moving, here = about_mean(problem.pairs[0].moving)
    frame = Frame(*(taken_by(origin, 1, bound, slice(None)) for origin in (there, here)))
    return replace(problem, pairs=[Pair(fixed, moving)]), frame


def _from_scores(
    problem: Problem,
    bound: Bound,
    known: NDArray[np.bool_],
    length: float | None,
    groups: ArrayLike | None,
    reference: Array | None,
    floor: bool,
) -> Array:
    """`godambe` (B, P, P) of each problem whose estimate is known; nan of the others.

    Without a ``reference`` (B, P, P) it is the inverse Hessian.
    """
    neighbours = _neighbours(problem, bound, length, groups)
    p = problem.parameters
    covariance = np.full((len(bound.thetas), p, p), np.nan)
    for part in parts_of(problem, bound):
        scores, hessians = problem.scores(bound, part.start, part.stop)
        for b in np.flatnonzero(known[part]) + part.start:
            own = scores[b - part.start], hessians[b - part.start]
            inverse = fisher_covariance(own[1].sum(axis=0))
            if not np.isfinite(inverse).all():
                raise ValueError(
                    "estimate must be an optimum of this cost, but the Hessian of its targets is "
                    "not positive definite there"
                )
            stands = inverse if reference is None else reference[b]
            covariance[b] = godambe(*own, neighbours(b), stands, floor)
    return covariance


def _reference(reference: ArrayLike, known: NDArray[np.bool_], bound: Bound, p: int) -> Array:
    """The reference (B, P, P) of each problem, positive definite wherever the estimate is known."""
    array = check_real("reference", reference)
    batch = array.shape[:-2]
    if array.shape[-2:] != (p, p) or batch not in ((), bound.shape):
        raise ValueError(
            f"reference must have the shape {(*bound.shape, p, p)} or {(p, p)}, "
            f"but has {array.shape}"
        )
    every = taken_by(array, 2, bound, slice(None))
    every[known] = check_covariances("reference", every[known])
    return every


def _neighbours(
    problem: Problem, bound: Bound, length: float | None, groups: ArrayLike | None
) -> Callable[[int], Neighbours]:
    """Which targets of each problem of a batch have correlated errors."""
    if length is not None and groups is not None:
        raise ValueError("length and groups must not both be given")
    everything = slice(None)
    if length is not None:
        scale = check_positive_scalar("length", length)
        means = [taken_by(pair.moving.means, 2, bound, everything) for pair in problem.pairs]
        positions = np.concatenate(means, axis=1)
        return lambda b: nearby(positions[b], scale)
    size = sum(pair.moving.size for pair in problem.pairs)
    labels = np.arange(size) if groups is None else _labels(groups)
    if labels.shape[-1:] != (size,):
        raise ValueError(
            f"groups must have the shape (..., {size}) to match moving, but has {labels.shape}"
        )
    if broadcast_batches("groups and the batch", labels.shape[:-1], bound.shape) != bound.shape:
        raise ValueError(
            f"groups has the batch axes {labels.shape[:-1]}, which do not fit the other "
            f"arguments' {bound.shape}"
        )
    own = taken_by(labels, 1, bound, everything)
    return lambda b: grouped(own[b])


def _labels(groups: ArrayLike) -> NDArray[Any]:
    """Labels as an array; a missing one would leave open which errors are correlated."""
    try:
        labels = np.asarray(groups)
        unknown = np.ma.is_masked(groups) or bool((labels != labels).any())
        np.unique(labels)  # labels of several kinds have no order
    except (TypeError, ValueError) as error:
        raise ValueError(f"groups must be an array of labels of one kind: {error}") from None
    if unknown:
        raise ValueError("groups must not hold nan or masked entries; label each of them alone")
    return labels
