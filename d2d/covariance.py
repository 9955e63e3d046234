"""The covariance of an estimate: Fisher information and propagation of the measurement errors."""

import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from d2d import rigid
from d2d._checks import check_instance, check_real, check_shape, symmetrise
from d2d._kernel import layout
from d2d._kernel.compile import read_only
from d2d._kernel.errors import add_positions
from d2d._kernel.newton import SINGULAR
from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.measurement import LinearMeasurement
from d2d.point_set import PointSet
from d2d.problem import Bound, Estimate, Problem, flat_index

# Length over width of a target, above which a standard deviation of the rotation turns it by more
# than its width: at 175 the mean NEES is twice too large, at 90 it is right.
LONG = 150.0
_SAME = 1e-6  # relative; only rounding makes a cost differ from itself
_TARGETS_AT_ONCE = 50_000  # of both sets: about 20 MB of intermediate arrays


def fisher_covariance(hessian: ArrayLike) -> Array:
    """Inverse of the Hessian of a negative log-likelihood (thesis sec. 5.2, Cramér-Rao bound).

    From the Hessians (..., P, P) at optima; nan where one is not positive definite.
    """
    matrices = check_real("hessian", hessian)
    check_shape("hessian", matrices, "(..., P, P)", empty=0 not in matrices.shape[-2:])
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
) -> Array:
    r"""Covariance of the optimum by propagation of the measurement errors (Censi 2007).

    At the optimum the gradient vanishes, :math:`f_\theta(\theta, z) = 0`, with z all measured
    coordinates of both sets.  The implicit function theorem gives its derivative by z,
    :math:`-H^{-1} f_{\theta z}`, and to first order (thesis sec. 5.2) the covariance

    .. math:: \Sigma_\theta = H^{-1} f_{\theta z}\, \Sigma_z\, f_{\theta z}^{\mathsf T} H^{-1}.

    The covariance (..., P, P) of ``theta`` is nan where the estimate did not converge.  Raises a
    ``ValueError`` if the estimate is one of other arguments, and warns of covariances that are more
    than 150 times as long as wide.

    Parameters
    ----------
    estimate : Estimate
        The result of `register` with the same sets, cost and measurement.
    fixed, moving : PointSet
        Their covariances are the diagonal blocks of :math:`\Sigma_z`, even if the metric ignores
        those of ``moving``.
    cost : RegistrationCost, optional
        By default, the D2D likelihood without an outlier component.
    measurement : LinearMeasurement, optional
        Its values are part of z, with the variance that it states.  Their errors are taken to be
        independent of those of the positions.

    Notes
    -----
    Unlike the inverse Hessian, this does not assume that f is a negative log-likelihood: it holds
    for any cost with an optimum, and does not change when f is multiplied by a constant.

    The covariances are taken as known, although those of polar measurements depend on the measured
    point; the book's appendix C measures the effect of this, and of the first order.
    """
    cost = RegistrationCost() if cost is None else cost
    check_instance("cost", cost, RegistrationCost)
    check_instance("estimate", estimate, Estimate)
    problem = cost.problem(fixed, moving, measurement)
    theta = rigid.motion("estimate", estimate.theta, fixed.dimension)
    bound = problem.bind(theta)
    check_estimate(estimate, problem, bound)
    _warn_of_long_targets(fixed, moving)
    if measurement is not None:
        return _definite(estimate.covariance, _noise(problem, bound))
    bound, outward = problem.about_means(bound)
    inward = 2.0 * np.eye(problem.parameters) - outward
    known = np.isfinite(estimate.covariance).all(axis=(-2, -1), keepdims=True)
    inverse = propagated(inward, np.where(known, estimate.covariance, np.nan))
    return propagated(outward, _definite(inverse, _noise(problem, bound)))


def _warn_of_long_targets(fixed: PointSet, moving: PointSet) -> None:
    """Warn where targets are so long that the cost is not quadratic over a standard deviation."""
    extremes = np.concatenate([fixed._layout.extremes, moving._layout.extremes])
    aspect = float(extremes[:, layout.LARGEST_ASPECT].max(initial=1.0))
    if fixed.dimension == 2 and aspect > LONG:
        warnings.warn(
            f"covariances up to {aspect:.0f} times as long as wide, above {LONG:.0f}, make the "
            "stated rotation too certain: their orientation is taken for exact",
            RuntimeWarning,
            stacklevel=3,
        )


def propagated(jacobian: Array, covariance: Array) -> Array:
    """The covariance J C Jᵀ (..., P, P) of a linear function, exactly symmetric."""
    moved = jacobian @ covariance @ np.swapaxes(jacobian, -1, -2)
    return np.asarray(0.5 * (moved + np.swapaxes(moved, -1, -2)))


def _definite(inverse: Array, noise: Array) -> Array:
    """H^-1 (f_z Sigma_z f_z') H^-1 (..., P, P), with the covariance of the gradient as noise.

    If the rounding of nearly singular matrices leaves a negative variance, it is computed as a
    product of roots, which has none.
    """
    product = propagated(inverse, noise)
    negative = (np.diagonal(product, axis1=-2, axis2=-1) < 0.0).any(axis=-1)
    if negative.any():
        size = np.sqrt(np.diagonal(noise[negative], axis1=-2, axis2=-1))
        size = np.where(size > 0.0, size, 1.0)
        values, axes = np.linalg.eigh(noise[negative] / (size[:, :, None] * size[:, None, :]))
        inverse = np.broadcast_to(inverse, product.shape)[negative]
        root = inverse @ (size[:, :, None] * axes * np.sqrt(np.clip(values, 0.0, None))[:, None])
        product[negative] = root @ np.swapaxes(root, -1, -2)
    return product


def _noise(problem: Problem, bound: Bound) -> Array:
    """The covariance (..., P, P) of the gradient."""
    fixed, moving, measurement, _ = problem.pairs[0]
    count = len(bound.thetas)
    p, noise = problem.parameters, np.zeros((count, 3, 3))
    step = max(1, _TARGETS_AT_ONCE // (fixed.size + moving.size))
    for start in range(0, count, step):
        part = slice(start, min(start + step, count))
        cross = problem.cross_derivatives(bound, part.start, part.stop)
        for position, points in ((cross.fixed, fixed), (cross.moving, moving)):
            covariances = np.zeros((*points.covariances.shape[:-2], 2, 2))
            covariances[..., : points.dimension, : points.dimension] = points.covariances
            own = select(covariances, 3, bound, part)
            add_positions(position, read_only(own, *own.shape), noise[part])
        if measurement is not None:
            sigma = _measurement_sigma(measurement, bound, part)
            scaled = sigma[..., None] * cross.measured
            noise[part] += np.swapaxes(scaled, 1, 2) @ scaled
    return noise[:, :p, :p].reshape(*bound.shape, p, p)


def _measurement_sigma(measurement: LinearMeasurement, bound: Bound, part: slice) -> Array:
    """Standard deviation (C, K) of each measured value, with the effect of its input's error."""
    theta = bound.thetas[part, : measurement.parameters]
    xi = rigid.logarithm(theta) if measurement.of_twist else theta
    predicted = (select(measurement.slope, 2, bound, part) @ xi[..., None])[..., 0]
    sigma = select(measurement.sigma, 1, bound, part)
    by_input = select(measurement.sigma_input, 1, bound, part)
    return np.asarray(np.hypot(sigma, by_input * predicted))


def check_estimate(estimate: Estimate, problem: Problem, bound: Bound) -> None:
    """Raise a ValueError if the estimate is not an optimum of this cost for these sets.

    Its cost and Hessian are then not the problem's at its parameters.
    """
    value, _, hessian = problem.derivatives(bound)
    off = np.abs(value - estimate.value) > _SAME * (1.0 + np.abs(value))
    root = np.sqrt(np.abs(np.diagonal(hessian, axis1=-2, axis2=-1)))
    bent = np.abs(hessian - estimate.hessian) > _SAME * root[..., :, None] * root[..., None, :]
    off = off | bent.any(axis=(-2, -1))
    off = off & np.isfinite(estimate.covariance).all(axis=(-2, -1))
    if off.any():
        raise ValueError(
            "estimate must be of the same sets or scans, cost, measurement and options as the other"
            f" arguments, but its cost is {np.broadcast_to(estimate.value, off.shape)[off][0]:.9g} "
            f"and theirs {value[off][0]:.9g}, or the Hessians differ"
        )


def select(array: NDArray[Any], axes: int, bound: Bound, part: slice = slice(None)) -> NDArray[Any]:
    """The arrays, with that many axes, that each problem of a part (C, ...) reads from a batch."""
    batch, own = array.shape[:-axes], array.shape[-axes:]
    return np.asarray(array.reshape(-1, *own)[flat_index(batch, bound.shape)[part]])
