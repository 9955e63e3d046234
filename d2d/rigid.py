"""Rigid motions of the line and the plane, applied to means and covariances.

A motion is given by its parameter vector, ``[t_x]`` (m) in 1D or ``[t_x, t_y, phi_z]`` (m, m, rad)
in 2D, with :math:`T(m) = R m + t`.  All functions broadcast over leading batch axes.
"""

import numpy as np
from numpy.typing import ArrayLike

from d2d._checks import ANGLE, Bounds, broadcast_batches, check_finite, check_shape
from d2d._kernel import entries, layout
from d2d._types import Array

BOUNDS = Bounds(most=layout.MAX_LENGTH)  # in m; no angle is near
PARAMETERS = {1: 1, 2: 3}  # number of parameters of a rigid motion, by dimension


def motion(name: str, theta: ArrayLike, dimension: int) -> Array:
    """The parameters (..., P) of a motion, checked to be finite and to match the dimension."""
    parameters = BOUNDS.array(name, theta)
    check_shape(name, parameters, f"(..., {PARAMETERS[dimension]})")
    return parameters


def start(name: str, theta: ArrayLike, dimension: int) -> Array:
    """The parameters (..., P) of a `motion` whose angle is in rad, within −2π and 2π."""
    parameters = motion(name, theta, dimension)
    if dimension == 2 and parameters.ndim == 1:  # the common case, in half the time
        ANGLE.number(name, parameters.item(2))
    elif dimension == 2:
        ANGLE.array(name, parameters[..., 2])
    return parameters


def about(point: Array, theta: Array) -> Array:
    """Motions (..., 3) that turn about a point (..., 2) and then shift, as motions of the plane."""
    kept = theta[..., :2] + point - (rotation(theta[..., 2]) @ point[..., None])[..., 0]
    return np.concatenate([kept, np.broadcast_to(theta[..., 2:], (*kept.shape[:-1], 1))], axis=-1)


def rotation(angle: ArrayLike) -> Array:
    """Rotation matrices (..., 2, 2) of angles (...) in rad, counter-clockwise positive."""
    angle = np.asarray(angle, dtype=np.float64)
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([cosine, -sine], -1), np.stack([sine, cosine], -1)], -2)


def transform_means(theta: ArrayLike, means: ArrayLike) -> Array:
    """Move points (..., N, D) by theta (..., P): :math:`T(m) = R m + t` (thesis eq. 7.2)."""
    points = check_finite("means", means, "(..., N, 1)", "(..., N, 2)")
    parameters = motion("theta", theta, points.shape[-1])
    broadcast_batches("theta and means", parameters.shape[:-1], points.shape[:-2])
    if points.shape[-1] == 1:
        return points + parameters[..., None, :]
    turned = points @ np.swapaxes(rotation(parameters[..., 2]), -1, -2)
    return turned + parameters[..., None, :2]


def transform_covariances(theta: ArrayLike, covariances: ArrayLike) -> Array:
    r"""Rotate covariances (..., N, D, D) by theta (..., P): :math:`R \Sigma R^{\mathsf T}`."""
    matrices = check_finite("covariances", covariances, "(..., N, 1, 1)", "(..., N, 2, 2)")
    parameters = motion("theta", theta, matrices.shape[-1])
    broadcast_batches("theta and covariances", parameters.shape[:-1], matrices.shape[:-3])
    if matrices.shape[-1] == 1:
        return matrices + np.zeros((*parameters.shape[:-1], 1, 1, 1))
    turn = rotation(parameters[..., 2])[..., None, :, :]
    return turn @ matrices @ np.swapaxes(turn, -1, -2)


def compose(first: ArrayLike, second: ArrayLike) -> Array:
    """The motion that applies ``second``, then ``first``: T(m, compose(a, b)) = T(T(m, b), a)."""
    a = check_finite("first", first, "(..., 1)", "(..., 3)")
    b = check_finite("second", second, f"(..., {a.shape[-1]})", like="first")
    broadcast_batches("first and second", a.shape[:-1], b.shape[:-1])
    if a.shape[-1] == 1:
        return a + b
    moved = transform_means(a, b[..., None, :2])[..., 0, :]
    return np.concatenate([moved, (a[..., 2:] + b[..., 2:])], axis=-1)


def inverse(theta: ArrayLike) -> Array:
    """The inverse motion: compose(inverse(theta), theta) is zero."""
    parameters = check_finite("theta", theta, "(..., 1)", "(..., 3)")
    if parameters.shape[-1] == 1:
        return -parameters
    back = rotation(-parameters[..., 2])
    shift = -np.einsum("...ij,...j->...i", back, parameters[..., :2])
    return np.concatenate([shift, -parameters[..., 2:]], axis=-1)


def exponential(twist: ArrayLike) -> Array:
    r"""The motion (..., 3) after unit time at constant body velocity ``twist`` [v_x, v_y, omega].

    With E that turns by 90°, :math:`t = (\sin(\omega)\, v + (1 - \cos\omega)\, E v) / \omega`.
    """
    return exponential_derivatives(twist)[0]


def exponential_derivatives(twist: ArrayLike) -> tuple[Array, Array, Array]:
    """The `exponential` (..., 3), with first (..., 3, 3) and second derivatives (..., 3, 3, 3).

    ``first[i, j]`` is the derivative of motion parameter i in twist parameter j, and
    ``second[i, j, k]`` that in j and k.
    """
    return _charted(motion("twist", twist, 2), False)


def logarithm(theta: ArrayLike) -> Array:
    """The twist (..., 3) of a motion: exponential(logarithm(theta)) = theta if ``|phi| < 2π``."""
    return logarithm_derivatives(theta)[0]


def logarithm_derivatives(theta: ArrayLike) -> tuple[Array, Array, Array]:
    """The `logarithm` (..., 3), with derivatives as those of `exponential_derivatives`."""
    return _charted(motion("theta", theta, 2), True)


def _charted(points: Array, inverse: bool) -> tuple[Array, Array, Array]:
    """Evaluate the charts of ``d2d._kernel.charts``, where the formulas and derivatives are."""
    batch, count = points.shape[:-1], points.size // 3
    image, first = np.empty((count, 3)), np.empty((count, 3, 3))
    second = np.empty((count, 3, 3, 3))
    entries.chart_batch(points.reshape(count, 3), inverse, image, first, second)
    return image.reshape(*batch, 3), first.reshape(*batch, 3, 3), second.reshape(*batch, 3, 3, 3)
