"""Covariances of sums whose terms are correlated in time."""

import numpy as np

from d2d._types import Array
from d2d.bootstrap import block_length


def covariance_of_sum(terms: Array, parameters: int = 1) -> tuple[Array, int]:
    """Covariance (p, p) of the sum of terms (n, p) in time order, and the length of its blocks.

    It is that of the circular block bootstrap (`d2d.block_length`), in closed form, times
    blocks / (blocks - parameters): a fit uses up these degrees of freedom, at least the mean.
    """
    centred = terms - terms.mean(axis=0)
    block = block_length(centred)
    sums = block_sums(centred, block)
    blocks = len(terms) / block
    return sums.T @ sums / block * blocks / max(blocks - parameters, 1.0), block


def block_sums(series: Array, block: int) -> Array:
    """Sums of every ``block`` successive rows of a series (N, ...), which is joined end to end.

    Their squares, added up and divided by ``block``, are the variance that the sum of a centred
    series has over the drawings of `d2d.block_bootstrap`.
    """
    ring = np.concatenate([np.zeros_like(series[:1]), series, series[: block - 1]])
    totals = ring.cumsum(axis=0)
    return np.asarray(totals[block:] - totals[:-block])
