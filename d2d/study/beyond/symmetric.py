"""The likelihood in both directions: each scan in turn is the mixture that explains the other.

The likelihood -sum_k log q_k penalises moving targets without a counterpart, but not fixed ones.
Adding the other direction treats both scans alike, as symmetric objectives do for ICP
(Rusinkiewicz 2019).
"""

import numpy as np
import scipy
from numpy.typing import ArrayLike

from d2d import rigid
from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.covariance import fisher_covariance
from d2d.point_set import PointSet
from d2d.problem import Estimate

_TOLERANCE = 1e-6  # of the gradient, in units of the cost per metre, at which SciPy stops
# Rounding may keep the gradient above it.  Convergence is therefore judged by the Newton decrement,
# the squared distance to the optimum in standard deviations.
_DECREMENT = 1e-10


def symmetric_derivatives(
    theta: ArrayLike, fixed: PointSet, moving: PointSet, cost: RegistrationCost
) -> tuple[Array, Array, Array]:
    """Mean cost (...) of both directions, with exact gradient (..., 3) and Hessian (..., 3, 3).

    The cost is (f(theta; F, M) + f(theta^-1; M, F)) / 2, the mean.  Both directions use the same
    measurements, and the Hessian of their total would count the information twice.  The motion
    (..., 3) and the batches of the planar sets broadcast.  An outlier covariance is taken in the
    frame of whichever scan is the mixture.
    """
    motion = rigid.motion("theta", theta, 2)
    value, gradient, hessian = cost.derivatives(motion, fixed, moving)
    back = rigid.inverse(motion)
    other, slope, bend = cost.derivatives(back, moving, fixed)
    # chain rule: back = (-R(-phi) t, -phi); the second derivative of its translation in phi is
    # minus that translation
    unturn = rigid.rotation(-motion[..., 2])
    turned = unturn @ np.array([[0.0, 1.0], [-1.0, 0.0]])  # d R(-phi) / d phi
    jacobian = np.zeros_like(bend)
    jacobian[..., :2, :2] = -unturn
    jacobian[..., :2, 2] = -np.einsum("...ij,...j->...i", turned, motion[..., :2])
    jacobian[..., 2, 2] = -1.0
    across = np.swapaxes(jacobian, -1, -2)
    curved = across @ bend @ jacobian
    mixed = -np.einsum("...i,...ij->...j", slope[..., :2], turned)
    curved[..., :2, 2] += mixed
    curved[..., 2, :2] += mixed
    curved[..., 2, 2] -= np.einsum("...i,...i->...", slope[..., :2], back[..., :2])
    return (
        np.asarray(0.5 * (value + other)),
        0.5 * (gradient + np.einsum("...ij,...j->...i", across, slope)),
        0.5 * (hessian + curved),
    )


def register_symmetric(
    fixed: PointSet,
    moving: PointSet,
    cost: RegistrationCost,
    initial: ArrayLike | None = None,
) -> Estimate:
    """Minimise the mean cost of both directions by SciPy's trust-region Newton method.

    Solves one problem.  The parameters are those of `symmetric_derivatives`, with the start
    ``initial`` (3,), zeros by default.  ``covariance`` is the inverse Hessian, nan if not
    converged; ``iterations`` counts evaluations of the cost.
    """
    start = np.zeros(3) if initial is None else rigid.motion("initial", initial, 2)
    # scale the angle to a length: the distance that it moves a target at mean range
    lever = float(np.hypot(*moving.means.T).mean())
    unit = np.array([1.0, 1.0, 1.0 / lever])

    def objective(x: Array) -> tuple[float, Array]:
        value, gradient, _ = symmetric_derivatives(x * unit, fixed, moving, cost)
        return float(value), gradient * unit

    def curvature(x: Array) -> Array:
        return np.asarray(
            symmetric_derivatives(x * unit, fixed, moving, cost)[2] * np.outer(unit, unit)
        )

    optimum = scipy.optimize.minimize(
        objective,
        start / unit,
        jac=True,
        hess=curvature,
        method="trust-exact",
        options={"gtol": _TOLERANCE},
    )
    theta = optimum.x * unit
    value, gradient, hessian = symmetric_derivatives(theta, fixed, moving, cost)
    covariance = fisher_covariance(hessian)
    converged = bool(gradient @ covariance @ gradient <= _DECREMENT)  # False where it is nan
    return Estimate(
        theta=theta,
        covariance=covariance if converged else np.full((3, 3), np.nan),
        value=value,
        gradient=gradient,
        hessian=hessian,
        converged=np.asarray(converged),
        iterations=np.asarray(optimum.nfev),
    )
