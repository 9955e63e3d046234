"""The cost written like its formulas, in NumPy: every pair of a target and a component at once.

The compiled kernel computes the same without writing the pairs down.  Here they are arrays, with a
batch axis in front: (B, K, N) for B problems, K moving targets and N fixed components.  `value` is
the cost itself, `cross_derivatives` is what propagation of errors needs.  Both are for readers and
for tests.
"""

import math
from typing import NamedTuple

import numpy as np

from d2d import rigid
from d2d._types import Array
from d2d.cost import CorruptedGaussian, RegistrationCost, UniformOutlier
from d2d.measurement import LinearMeasurement
from d2d.point_set import PointSet

TURN = np.array([[0.0, -1.0], [1.0, 0.0]])  # E: d R / d phi = E R


class Pairs(NamedTuple):
    """log N(0 | d, S) of every pair of moving target and component, and parts of its derivatives.

    With the rotated mean p and covariance C of the target: d = p + t - mu_i, B = S^-1, u = B d.
    """

    log: Array  # (B, K, N), the mixture's weight included
    gradient: Array  # (B, K, N, P): [-u, L_phi]
    by_mean: Array  # (B, K, N, D): u = d L / d mu_i
    cross: Array  # (B, K, N, P, D): [B, (B v)'] = d2L / d theta d mu_i, v = E p - C_phi u


def pair_up(shifted: Array, turned: Array, spread: Array, slope: Array, fixed: PointSet) -> Pairs:
    """Every target, ``turned`` to p and ``shifted`` to p + t, paired with every fixed component.

    ``spread`` (B, K, N, D, D) is S and ``slope`` (B, K, D, D) is C_phi.
    """
    d = shifted[:, :, None] - fixed.means[:, None]
    b = np.asarray(np.linalg.inv(spread), dtype=np.float64)
    u = (b @ d[..., None])[..., 0]
    log_det = np.linalg.slogdet(2.0 * math.pi * spread)[1]
    log = np.log(fixed.weights)[:, None] - 0.5 * ((d * u).sum(axis=-1) + log_det)
    if d.shape[-1] == 1:
        return Pairs(log, -u, u, b)
    lever = (turned @ TURN.T)[:, :, None]
    bent = (slope[:, :, None] @ u[..., None])[..., 0]  # C_phi u
    by_angle = (u * (0.5 * bent - lever)).sum(axis=-1) - 0.5 * np.einsum(
        "bkixy,bkyx->bki", b, slope
    )
    turning = np.swapaxes(b @ (lever - bent)[..., None], -1, -2)
    return Pairs(
        log,
        np.concatenate([-u, by_angle[..., None]], axis=-1),
        u,
        np.concatenate([b, turning], axis=-2),
    )


def components(
    theta: Array,
    fixed: PointSet,
    moving: PointSet,
    cost: RegistrationCost,
    factor: "Factor | None",
) -> list[Pairs]:
    """The inlier pairs and, with a corrupted Gaussian, the outlier pairs, weighted by fraction."""
    dimension = fixed.dimension
    shifted = rigid.transform_means(theta, moving.means)
    turned = shifted - theta[:, None, :dimension]
    own = fixed.covariances[:, None].repeat(moving.size, axis=1)
    spread, still = own, np.zeros((*turned.shape, dimension))
    slope = still
    if cost.metric == "d2d":
        spun = rigid.transform_covariances(theta, moving.covariances)
        spread = own + spun[:, :, None]
        if dimension == 2:
            slope = TURN @ spun + spun @ TURN.T
    inlier = pair_up(shifted, turned, spread, slope, fixed)
    if factor is not None:
        inlier = inlier._replace(
            log=inlier.log + factor.log[..., None],
            gradient=inlier.gradient + factor.gradient[:, :, None],
        )
    if not isinstance(cost.outlier, CorruptedGaussian):
        return [inlier]
    wide = np.broadcast_to(cost.outlier.covariance, own.shape)
    outlier = pair_up(shifted, turned, wide, still, fixed)
    with np.errstate(divide="ignore"):  # a fraction of 0 or 1: one component has zero weight
        shares = np.log1p(-cost.outlier.fraction), np.log(cost.outlier.fraction)
    return [
        each._replace(log=each.log + share)
        for each, share in zip((inlier, outlier), shares, strict=True)
    ]


def responsibilities(parts: list[Pairs], cost: RegistrationCost) -> list[Array]:
    """gamma (B, K, N) of each component: its share of the target's density, or of all targets'."""
    alternatives = (-1,) if cost.fusion == "likelihood" else (-2, -1)
    logs = _all_logs(parts, cost)
    top = logs.max(axis=alternatives, keepdims=True)
    total = np.exp(logs - top).sum(axis=alternatives, keepdims=True)
    return [np.exp(each.log - top) / total for each in parts]


def target_log_densities(parts: list[Pairs], cost: RegistrationCost) -> Array:
    """log q_k (B, K): the components of each target summed (thesis eq. 4.3 and 6.4)."""
    return _log_sum(_all_logs(parts, cost))


def value(
    theta: Array,
    fixed: PointSet,
    moving: PointSet,
    cost: RegistrationCost,
    measurement: LinearMeasurement | None = None,
) -> Array:
    """What is minimised (B,): -sum_k log q_k, or -log sum_k q_k.

    The same as `RegistrationCost.value` for motions (B, P) and point sets of batch shape (B,).
    """
    factor = None if measurement is None else factor_of(measurement, theta)
    logs = target_log_densities(components(theta, fixed, moving, cost, factor), cost)
    if cost.fusion == "likelihood":
        return np.asarray(-logs.sum(axis=-1))
    return -_log_sum(logs)


def _all_logs(parts: list[Pairs], cost: RegistrationCost) -> Array:
    """The logarithms (B, K, M) of all terms of each target's density."""
    logs = [each.log for each in parts]
    if isinstance(cost.outlier, UniformOutlier):
        logs.append(np.full((*logs[0].shape[:2], 1), math.log(cost.outlier.density)))
    elif not isinstance(cost.outlier, CorruptedGaussian | None):
        raise ValueError(f"this module does not know the outlier model {cost.outlier!r}")
    return np.concatenate(logs, axis=-1)


def _log_sum(logs: Array) -> Array:
    top = logs.max(axis=-1, keepdims=True)
    return np.asarray(top[..., 0] + np.log(np.exp(logs - top).sum(axis=-1)))


class Factor(NamedTuple):
    """Each moving target's factor of the measurement: log N(z | h' xi, sigma^2 + q^2 (s' xi)^2)."""

    log: Array  # (..., K)
    gradient: Array  # (..., K, P)
    cross: Array  # (..., K, P): derivative of the gradient in z
    by_value: Array  # (..., K): derivative of log in z
    cross_input: Array  # (..., K, P): derivative of the gradient in the input of h, where dh = s
    by_input: Array  # (..., K): derivative of log in the input


def factor_of(measurement: LinearMeasurement, theta: Array) -> Factor:
    """The measurement's factor at theta (..., P), with its derivatives."""
    xi = rigid.logarithm(theta) if measurement.of_twist else theta
    slope = (measurement.slope @ xi[..., None])[..., 0]
    variance = measurement.sigma**2 + (measurement.sigma_input * slope) ** 2
    residual = measurement.value - (measurement.gain @ xi[..., None])[..., 0]
    e = residual / variance
    variance_by_xi = (2.0 * measurement.sigma_input**2 * slope)[..., None] * measurement.slope
    gradient = (
        e[..., None] * measurement.gain + 0.5 * (e * e - 1.0 / variance)[..., None] * variance_by_xi
    )
    cross = measurement.gain / variance[..., None] + (e / variance)[..., None] * variance_by_xi
    cross_input = e[..., None] * measurement.slope - slope[..., None] * cross
    if measurement.of_twist:
        jacobian = rigid.logarithm_jacobian(theta)
        gradient, cross, cross_input = (each @ jacobian for each in (gradient, cross, cross_input))
    log = -0.5 * (residual * e + np.log(2.0 * math.pi * variance))
    return Factor(log, gradient, cross, -e, cross_input, slope * e)


def cross_derivatives(
    theta: Array,
    fixed: PointSet,
    moving: PointSet,
    cost: RegistrationCost,
    measurement: LinearMeasurement | None = None,
) -> tuple[Array, Array, Array, Array]:
    """d2f / d theta d z: derivatives of the gradient in each measured quantity (Censi 2007).

    In the fixed means (B, N, P, D), the moving means (B, K, P, D), the measurement's values
    (B, K, P) and, through its predictions only, its inputs (B, K, P).  The covariances and the
    measurement's variance are held constant.

    Every cost has the gradient f_theta = -sum_ki gamma_ki L_theta,ki with responsibilities gamma
    that sum to one over a target's components (likelihood) or over all pairs (summing).  With the
    mean gradient g over the same pairs,

        f_theta,z = -sum_ki gamma_ki (L_theta,z + (L_theta - g) L_z').
    """
    factor = None if measurement is None else factor_of(measurement, theta)
    parts = components(theta, fixed, moving, cost, factor)
    gammas = responsibilities(parts, cost)
    mean = np.zeros((len(theta), moving.size, 1, theta.shape[-1]))
    for gamma, each in zip(gammas, parts, strict=True):
        mean += gamma[..., None, :] @ each.gradient
    if cost.fusion == "summing":
        mean = mean.sum(axis=1, keepdims=True)

    by_fixed = np.zeros((len(theta), fixed.size, theta.shape[-1], fixed.dimension))
    by_moved = np.zeros((len(theta), moving.size, theta.shape[-1], fixed.dimension))
    for gamma, each in zip(gammas, parts, strict=True):
        centred = (each.gradient - mean)[..., :, None] * each.by_mean[..., None, :]
        block = gamma[..., None, None] * (each.cross + centred)
        by_fixed -= block.sum(axis=1)
        by_moved += block.sum(axis=2)
        if fixed.dimension == 2:  # d_phi = E p depends on the target's position
            by_moved[:, :, 2] += (gamma[..., None] * each.by_mean).sum(axis=2) @ TURN
    if fixed.dimension == 2:
        by_moved = by_moved @ rigid.rotation(theta[:, 2])[:, None]

    by_value, by_input = np.zeros((2, len(theta), moving.size, theta.shape[-1]))
    if factor is not None:
        share = gammas[0].sum(axis=2)[..., None]
        centred = (gammas[0][..., None] * (parts[0].gradient - mean)).sum(axis=2)
        by_value -= share * factor.cross + centred * factor.by_value[..., None]
        by_input -= share * factor.cross_input + centred * factor.by_input[..., None]
    return by_fixed, by_moved, by_value, by_input
