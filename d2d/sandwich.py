"""The covariance of an optimum from the scatter of its targets' scores (Huber 1967, Godambe 1960).

A target's score is the gradient of its part of the cost.  At an optimum the scores add up to zero,
and their scatter shows how uncertain the optimum is, whatever the reason: the covariances of the
targets are not needed, and the errors of targets may be correlated.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from d2d._types import Array

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
