"""Standard errors of fits whose scores are correlated in time."""

import numpy as np
from numpy.typing import ArrayLike

from d2d._types import Array
from d2d.bootstrap import block_length, block_sums


def covariance_of_sum(terms: Array, shortest: int = 1, parameters: int = 1) -> tuple[Array, int]:
    """Covariance (p, p) of the sum of terms (n, p) in time order, and the length of its blocks.

    It is that of the circular block bootstrap (`d2d.block_length`), in closed form, times
    blocks / (blocks - parameters): a fit uses up these degrees of freedom, at least the mean.
    """
    centred = terms - terms.mean(axis=0)
    block = max(block_length(centred), shortest)
    sums = block_sums(centred, block)
    blocks = len(terms) / block
    return sums.T @ sums / block * blocks / max(blocks - parameters, 1.0), block


def sqrt_standard_errors(values: ArrayLike, of_squares: ArrayLike) -> Array:
    """Standard errors of values (...) from those of their squares (delta method).

    Close to zero it is how far one standard error of the square reaches from there.
    """
    values, of_squares = np.asarray(values), np.asarray(of_squares)
    near = np.sqrt(of_squares)
    steep = 2.0 * values > near
    return np.where(steep, of_squares / np.where(steep, 2.0 * values, 1.0), near)
