"""The covariance of an estimate: Fisher information and propagation of the measurement errors."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from d2d import rigid
from d2d._checks import (
    broadcast_batches,
    check_covariances,
    check_finite,
    check_flag,
    check_instance,
    check_positive,
    check_real,
    check_scalar,
    symmetrise,
)
from d2d._kernel import SINGULAR
from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.dense import factor_of
from d2d.measurement import LinearMeasurement
from d2d.point_set import PointSet
from d2d.problem import Bound, CrossDerivatives, Problem, members
from d2d.registration import Estimate
from d2d.sandwich import Neighbours, godambe, grouped, nearby

_TARGETS_AT_ONCE = 50_000  # of both sets: about 20 MB of intermediate arrays


def fisher_covariance(hessian: ArrayLike) -> Array:
    """Inverse of the Hessian of a negative log-likelihood (thesis sec. 5.2, Cramér-Rao bound).

    Parameters
    ----------
    hessian : (..., P, P) array
        Hessian at the optimum.

    Returns
    -------
    (..., P, P) array
        Inverse of the observed information; nan where the Hessian is not positive definite, because
        such a point is not an optimum and has no covariance.

    Raises
    ------
    ValueError
        If ``hessian`` is not an array of square matrices that are symmetric to within rounding.
    """
    matrices = check_real("hessian", hessian)
    if matrices.ndim < 2 or matrices.shape[-1] != matrices.shape[-2] or not matrices.shape[-1]:
        raise ValueError(
            f"hessian must have the shape (..., P, P) with P > 0, but has {matrices.shape}"
        )
    scale = np.sqrt(np.abs(np.diagonal(matrices, axis1=-2, axis2=-1)))
    outer = scale[..., :, None] * scale[..., None, :]
    good = np.asarray((np.isfinite(matrices) & (outer > 0)).all(axis=(-2, -1)))
    covariance = np.full(matrices.shape, np.nan)
    unit = matrices[good] / outer[good]  # independent of the parameters' units
    symmetrise("hessian", unit)
    definite = np.linalg.eigvalsh(unit)[..., 0] > SINGULAR
    good[good] = definite
    inverse = np.linalg.inv(unit[definite]) / outer[good]
    covariance[good] = 0.5 * (inverse + np.swapaxes(inverse, -1, -2))
    return covariance


def propagate_covariance(
    estimate: Estimate,
    fixed: PointSet,
    moving: PointSet,
    cost: RegistrationCost | None = None,
    *,
    measurement: LinearMeasurement | None = None,
    position_slope: ArrayLike | None = None,
) -> Array:
    """Covariance of the optimum by propagation of the measurement errors (Censi 2007).

    The optimum is where the gradient vanishes, f_theta(theta, z) = 0, with z all measured
    coordinates of both sets.  By the implicit function theorem d theta / d z = -H^-1 f_theta,z,
    and to first order (thesis sec. 5.2)::

        Sigma_theta = H^-1 (d2f / d theta d z) Sigma_z (d2f / d theta d z)' H^-1

    Parameters
    ----------
    estimate : Estimate
        The result of `register` with the same sets, cost and measurement.
    fixed, moving : PointSet
        Their covariances are the diagonal blocks of Sigma_z, even if the metric ignores those of
        ``moving``.
    cost : RegistrationCost, optional
        By default, the D2D likelihood without an outlier component.
    measurement : LinearMeasurement, optional
        Its values are part of z, with the variance that it states.  Their errors are independent of
        those of the positions unless ``position_slope`` is given.
    position_slope : (..., K, D) array, optional
        Derivative of each moving target's position in the measurement's input, in m per unit of
        the input.  If given, a single error of the input, of standard deviation ``sigma_input``,
        moves the target along this slope and the predicted value along the measurement's own
        slope.  The target's covariance must already contain the part caused by this error.

    Returns
    -------
    (..., P, P) array
        Covariance of ``theta``; nan where the estimate did not converge.

    Raises
    ------
    ValueError
        If an argument is invalid; the message names it.

    Notes
    -----
    Unlike the inverse Hessian, this does not assume that f is a negative log-likelihood: it holds
    for any cost with an optimum, and does not change when f is multiplied by a constant.

    For targets measured in polar coordinates, the covariances J Sigma J' of `PointSet.from_polar`
    give, to first order, the same result as propagation from range and azimuth.  The covariances
    are taken as known, although those of polar measurements depend on the measured point; chapter 5
    measures the effect of this and that of the first-order approximation itself.

    The estimate itself treats positions and measurement as independent (thesis eq. 7.14), and so
    does the inverse Hessian, with or without ``position_slope``.
    """
    cost = RegistrationCost() if cost is None else cost
    check_instance("cost", cost, RegistrationCost)
    check_instance("estimate", estimate, Estimate)
    problem, bound = _bound(estimate.theta, fixed, moving, cost, measurement)
    slope = None
    if position_slope is not None:
        slope = _checked_slope(position_slope, moving, measurement, bound.shape)
    p = problem.parameters
    middle = np.empty((len(bound.thetas), p, p))
    for part in _parts(problem, bound):
        cross = problem.cross_derivatives(bound, part.start, part.stop)
        middle[part] = _spread(cross.fixed, _own(fixed.covariances, 3, bound, part))
        middle[part] += _spread(cross.moving, _own(moving.covariances, 3, bound, part))
        if measurement is not None:
            measured = _own_measurement(measurement, bound, part)
            middle[part] += (
                _independent(cross, measured, bound.thetas[part, :p])
                if slope is None
                else _shared(cross, measured, _own(slope, 2, bound, part))
            )
    if bound.frame is None:
        return _sandwich(estimate.covariance, middle.reshape(*bound.shape, p, p))
    own = np.broadcast_to(estimate.covariance, (*bound.shape, p, p)).reshape(-1, p, p)
    inner = bound.frame.inner_covariance(bound.thetas, own)
    outer = bound.frame.covariance(bound.thetas, _sandwich(inner, middle))
    return outer.reshape(*bound.shape, p, p)


def _sandwich(inverse: Array, middle: Array) -> Array:
    """H^-1 M H^-1, exactly symmetric."""
    product = inverse @ middle @ inverse
    return np.asarray(0.5 * (product + np.swapaxes(product, -1, -2)))


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
        err together, others independently.  Without ``length`` and ``groups``, all are independent.
    reference : (..., P, P) array, optional
        The covariance that stands unless the scores speak clearly against it; by default the
        inverse Hessian.  For costs whose inverse Hessian is no covariance, such as the sum, that of
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
        If an argument is invalid; the message names it.

    Notes
    -----
    Scores add up to zero at the optimum, so that those of a few targets, or groups, scatter too
    little, and by chance in any shape.  So each score is taken as what leaving out its group, or
    neighbourhood, moves the optimum by (CR3, Bell & McCaffrey 2002), and the deviation from the
    reference is reduced by twice what chance explains (James & Stein 1961), to none if it is no
    larger.  Eight independent targets thus give the reference unless they speak clearly against
    it.  `d2d.sandwich.godambe` has the formulas.

    Only errors that differ between targets, or groups, show in the scores.  What all targets share,
    such as a bias of the sensor, does not.
    """
    cost = RegistrationCost() if cost is None else cost
    check_instance("cost", cost, RegistrationCost)
    check_instance("estimate", estimate, Estimate)
    problem, _ = _bound(estimate.theta, fixed, moving, cost, measurement)
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

    Of one with several pairs, ``groups`` labels the moving targets of all, one pair after the
    other.  Positions are taken as they are in their sets, so that a target of several pairs is
    correlated with itself by 1.  The inverse Hessian takes it as several independent ones; the
    propagated covariance does not and is the better reference there.
    """
    check_flag("floor", floor)
    bound = problem.bind(rigid.motion("estimate", estimate.theta, problem.pairs[0].fixed.dimension))
    neighbours = _neighbours(problem, bound, length, groups)
    p = problem.parameters
    known = np.isfinite(estimate.covariance).all(axis=(-2, -1))
    known = np.broadcast_to(known, bound.shape).ravel()
    prior = _reference(estimate.covariance if reference is None else reference, known, bound, p)
    covariance = np.full((len(bound.thetas), p, p), np.nan)
    for part in _parts(problem, bound):
        scores, hessians = problem.scores(bound, part.start, part.stop)
        for b in range(part.start, part.stop):
            if known[b]:
                own = scores[b - part.start], hessians[b - part.start]
                covariance[b] = godambe(*own, neighbours(b), prior[b], floor)
    return covariance.reshape(*bound.shape, p, p)


def _reference(reference: ArrayLike, known: NDArray[np.bool_], bound: Bound, p: int) -> Array:
    """The reference (B, P, P) of each problem, positive definite wherever the estimate is known."""
    array = check_real("reference", reference)
    batch = array.shape[:-2]
    if array.shape[-2:] != (p, p) or batch not in ((), bound.shape):
        raise ValueError(
            f"reference must have the shape {(*bound.shape, p, p)} or {(p, p)}, "
            f"but has {array.shape}"
        )
    every = _own(array, 2, bound, slice(None))
    every[known] = check_covariances("reference", every[known])
    return every


def _neighbours(
    problem: Problem, bound: Bound, length: float | None, groups: ArrayLike | None
) -> Callable[[int], Neighbours]:
    """Which targets of each problem of a batch err together."""
    if length is not None and groups is not None:
        raise ValueError("length and groups must not both be given")
    everything = slice(None)
    if length is not None:
        scale = float(check_positive("length", check_scalar("length", length)))
        means = [_own(pair.moving.means, 2, bound, everything) for pair in problem.pairs]
        positions = np.concatenate(means, axis=1)
        return lambda b: nearby(positions[b], scale)
    size = sum(pair.moving.size for pair in problem.pairs)
    labels = np.arange(size) if groups is None else np.asarray(groups)
    if labels.shape[-1:] != (size,):
        raise ValueError(
            f"groups must have the shape (..., {size}) to match moving, but has {labels.shape}"
        )
    if broadcast_batches("groups and the batch", labels.shape[:-1], bound.shape) != bound.shape:
        raise ValueError(
            f"groups has the batch axes {labels.shape[:-1]}, which do not fit the other "
            f"arguments' {bound.shape}"
        )
    own = _own(labels, 1, bound, everything)
    return lambda b: grouped(own[b])


def _bound(
    theta: ArrayLike,
    fixed: PointSet,
    moving: PointSet,
    cost: RegistrationCost,
    measurement: LinearMeasurement | None,
) -> tuple[Problem, Bound]:
    problem = cost.problem(fixed, moving, measurement)
    return problem, problem.bind(rigid.motion("theta", theta, fixed.dimension))


def _parts(problem: Problem, bound: Bound) -> Iterator[slice]:
    """The problems of a batch, a bounded number of targets at a time."""
    count = len(bound.thetas)
    step = max(1, _TARGETS_AT_ONCE // sum(p.fixed.size + p.moving.size for p in problem.pairs))
    return (slice(start, min(start + step, count)) for start in range(0, count, step))


def _own(array: NDArray[Any], axes: int, bound: Bound, part: slice) -> NDArray[Any]:
    """What each problem of a part (C, ...) takes of a batch of arrays with that many axes."""
    batch, own = array.shape[:-axes], array.shape[-axes:]
    return np.asarray(array.reshape(-1, *own)[members(batch, bound.shape)[part]])


def _own_measurement(
    measurement: LinearMeasurement, bound: Bound, part: slice
) -> LinearMeasurement:
    return LinearMeasurement._of(
        _own(measurement.value, 1, bound, part),
        _own(measurement.sigma, 1, bound, part),
        _own(measurement.sigma_input, 1, bound, part),
        _own(measurement.gain, 2, bound, part),
        _own(measurement.slope, 2, bound, part),
        measurement.of_twist,
    )


def _spread(cross: Array, covariances: Array) -> Array:
    """Covariance (..., P, P) of the gradient: G Sigma G', with G (..., N, P, D), summed over N."""
    rooted = cross @ np.linalg.cholesky(covariances)
    flat = np.swapaxes(rooted, -3, -2).reshape(*rooted.shape[:-3], rooted.shape[-2], -1)
    return np.asarray(flat @ np.swapaxes(flat, -1, -2))


def _gram(rows: Array) -> Array:
    """A' A (..., P, P) of the rows (..., K, P)."""
    return np.asarray(np.swapaxes(rows, -1, -2) @ rows)


def _independent(cross: CrossDerivatives, measurement: LinearMeasurement, theta: Array) -> Array:
    """The measurement's share (..., P, P) of the gradient's covariance, with independent inputs."""
    sigma = np.sqrt(factor_of(measurement, theta).variance)
    return _gram(cross.measured * sigma[..., None])


def _shared(cross: CrossDerivatives, measurement: LinearMeasurement, slope: Array) -> Array:
    """As `_independent`, but an input's error also moves its target along ``slope`` (..., K, D).

    The error changes the gradient by a through the position and by b through the prediction.  The
    positions' share already contains a a', so (a + b)(a + b)' - a a' is added.
    """
    own = _gram(cross.measured * measurement.sigma[..., None])
    sigma = measurement.sigma_input[..., None]
    by_position = (cross.moving @ slope[..., None])[..., 0] * sigma
    both = by_position + cross.input * sigma
    return own + _gram(both) - _gram(by_position)


def _checked_slope(
    slope: ArrayLike,
    moving: PointSet,
    measurement: LinearMeasurement | None,
    shape: tuple[int, ...],
) -> Array:
    """``position_slope`` (..., K, D), checked to be possible with the targets' covariances."""
    if measurement is None:
        raise ValueError("position_slope needs a measurement")
    array = check_finite("position_slope", slope)
    if array.shape[-2:] != moving.means.shape[-2:]:
        raise ValueError(
            f"position_slope must have the shape (..., {moving.size}, {moving.dimension}) to match "
            f"moving, but has {array.shape}"
        )
    if broadcast_batches("position_slope and the batch", array.shape[:-2], shape) != shape:
        raise ValueError(
            f"position_slope has the batch axes {array.shape[:-2]}, which do not fit the other "
            f"arguments' {shape}"
        )
    error = measurement.sigma_input[..., None] * array
    solved = np.linalg.solve(moving.covariances, error[..., None])[..., 0]
    if ((error * solved).sum(axis=-1) > 1.0 + 1e-6).any():
        raise ValueError(
            "position_slope times sigma_input must not exceed the errors that the covariances of "
            "moving allow for"
        )
    return array


def cross_derivatives(
    theta: ArrayLike,
    fixed: PointSet,
    moving: PointSet,
    cost: RegistrationCost,
    *,
    measurement: LinearMeasurement | None = None,
) -> CrossDerivatives:
    """Exact derivatives of the cost's gradient at theta (..., P) in each measured coordinate.

    The covariances and the measurement's variance are held constant, although they were computed
    at the measured point.  The arguments' batch axes broadcast.  An invalid argument raises a
    ``ValueError`` that names it.
    """
    problem, bound = _bound(theta, fixed, moving, cost, measurement)
    cross = problem.cross_derivatives(bound, 0, len(bound.thetas))
    if bound.frame is not None:
        across = np.swapaxes(bound.frame.slope(bound.thetas), -1, -2)
        p = problem.parameters
        across = across[:, np.newaxis, :p, :p]
        cross = cross._replace(fixed=across @ cross.fixed, moving=across @ cross.moving)
    return CrossDerivatives(*(block.reshape(*bound.shape, *block.shape[1:]) for block in cross))
