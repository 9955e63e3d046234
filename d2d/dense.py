"""The cost written like its formulas, in NumPy: every pair of a target and a component at once.

The compiled kernel computes it without writing the pairs down.  Here they are arrays, with a batch
axis in front: (B, K, N) for B problems, K moving targets and N fixed components.  It is for readers
and for tests.
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
    r""":math:`\log \mathcal N(0 \mid d, S)` of every pair of target and component, with gradient.

    With the rotated mean p and covariance C: :math:`d = p + t - \mu_i` and :math:`u = S^{-1} d`.
    """

    log: Array  # (B, K, N), the mixture's weight included
    gradient: Array  # (B, K, N, P): [-u, L_phi]


def pair_up(shifted: Array, turned: Array, spread: Array, slope: Array, fixed: PointSet) -> Pairs:
    r"""Pair every target, ``turned`` to p and ``shifted`` to p + t, with every fixed component.

    ``spread`` (B, K, N, D, D) is S and ``slope`` (B, K, D, D) is :math:`C_\varphi`.
    """
    d = shifted[:, :, None] - fixed.means[:, None]
    b = np.asarray(np.linalg.inv(spread), dtype=np.float64)
    u = (b @ d[..., None])[..., 0]
    log_det = np.linalg.slogdet(2.0 * math.pi * spread)[1]
    log = np.log(fixed.weights)[:, None] - 0.5 * ((d * u).sum(axis=-1) + log_det)
    if d.shape[-1] == 1:
        return Pairs(log, -u)
    lever = (turned @ TURN.T)[:, :, None]
    bent = (slope[:, :, None] @ u[..., None])[..., 0]  # C_phi u
    trace = np.einsum("bkixy,bkyx->bki", b, slope)  # of B C_phi
    by_angle = (u * (0.5 * bent - lever)).sum(axis=-1) - 0.5 * trace
    return Pairs(log, np.concatenate([-u, by_angle[..., None]], axis=-1))


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
    r"""Each component's share (B, K, N) of its target's density, or of the sum of all targets'."""
    alternatives = (-1,) if cost.fusion == "likelihood" else (-2, -1)
    logs = _all_logs(parts, cost)
    top = logs.max(axis=alternatives, keepdims=True)
    total = np.exp(logs - top).sum(axis=alternatives, keepdims=True)
    return [np.exp(each.log - top) / total for each in parts]


def target_log_densities(parts: list[Pairs], cost: RegistrationCost) -> Array:
    r""":math:`\log q_k` (B, K): the components of each target summed (thesis eq. 4.3 and 6.4)."""
    return _log_sum(_all_logs(parts, cost))


def value(
    theta: Array,
    fixed: PointSet,
    moving: PointSet,
    cost: RegistrationCost,
    measurement: LinearMeasurement | None = None,
) -> Array:
    r"""Value (B,) of the objective, :math:`-\sum_k \log q_k` or :math:`-\log \sum_k q_k`.

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
    """Each moving target's factor of the measurement: log N(z | hᵀ ξ, σ² + q² (sᵀ ξ)²)."""

    log: Array  # (..., K)
    gradient: Array  # (..., K, P)


def factor_of(measurement: LinearMeasurement, theta: Array) -> Factor:
    """The measurement's factor at theta (..., P), with its gradient."""
    xi = rigid.logarithm(theta) if measurement.of_twist else theta
    slope = (measurement.slope @ xi[..., None])[..., 0]
    variance = measurement.sigma**2 + (measurement.sigma_input * slope) ** 2
    residual = measurement.value - (measurement.gain @ xi[..., None])[..., 0]
    e = residual / variance
    variance_by_xi = (2.0 * measurement.sigma_input**2 * slope)[..., None] * measurement.slope
    gradient = (
        e[..., None] * measurement.gain + 0.5 * (e * e - 1.0 / variance)[..., None] * variance_by_xi
    )
    if measurement.of_twist:
        gradient = gradient @ rigid.logarithm_derivatives(theta)[1]
    return Factor(-0.5 * (residual * e + np.log(2.0 * math.pi * variance)), gradient)
