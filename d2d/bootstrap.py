"""Confidence intervals of statistics of a time series, by the circular block bootstrap."""

import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from d2d._checks import check_count, check_finite, check_flag, check_instance, check_tail, is_masked
from d2d._types import Array

_DRAWN = 500_000  # values of an array that are drawn at a time, which limits the memory


def block_bootstrap(
    statistic: Callable[..., ArrayLike],
    arrays: Sequence[ArrayLike],
    block: int,
    rng: np.random.Generator,
    *,
    confidence: float = 0.95,
    resamples: int = 1000,
    vectorized: bool = False,
) -> Array:
    """Confidence interval of a statistic whose data are correlated in time.

    The data are drawn anew in blocks of neighbouring rows, which keeps their correlation, from the
    series joined end to end (Politis & Romano 1992).  The interval contains the middle
    ``confidence`` of the values that the statistic has on the drawn data.

    Parameters
    ----------
    statistic : callable
        ``statistic(*arrays)`` gives a number or an array (...) of finite numbers.
    arrays : sequence of (N, ...) arrays
        In time order; the same rows are drawn from all of them.
    block : int
        Rows in a block, 1 to N.  It should be several times as long as errors stay correlated;
        `block_length` suggests one.  With 1, rows are treated as independent.
    rng : numpy.random.Generator
    confidence : float
        Probability content of the interval, within (0, 1).
    resamples : int
        How often the data are drawn.
    vectorized : bool
        Whether the statistic takes many data sets in one call, as in `scipy.stats.bootstrap`: it
        is called with the arrays (R, N, ...) of R data sets and ``axis=1``, and gives (R, ...).

    Returns
    -------
    (2, ...) array
        Lower and upper bounds.

    Notes
    -----
    With fewer than some twenty blocks the interval is too narrow, and variations slower than the
    whole series do not widen it at all.  A share of exactly 0 or 1 has an interval of no width.

    Examples
    --------
    One hundred numbers, each ten times in a row, do not determine a mean as well as a thousand:

    >>> import numpy as np
    >>> from d2d import block_bootstrap
    >>> rng = np.random.default_rng(0)
    >>> series = np.repeat(rng.standard_normal(100), 10)
    >>> for block in (1, 30):
    ...     low, high = block_bootstrap(np.mean, [series], block, rng)
    ...     print(f"{high - low:.2f}")
    0.12
    0.37
    """
    if not callable(statistic):
        raise ValueError(f"statistic must be callable, but is a {type(statistic).__name__}")
    if not isinstance(arrays, Iterable):
        raise ValueError(f"arrays must be a sequence of arrays, but is a {type(arrays).__name__}")
    given = [*arrays]
    if is_masked(given):
        raise ValueError("arrays must not hold masked entries; remove them first")
    data = [*map(np.asarray, given)]
    if not data or any(array.ndim < 1 for array in data) or not len(data[0]):
        raise ValueError("arrays must be a sequence of arrays (N, ...) with at least one row")
    rows, lengths = len(data[0]), [len(array) for array in data]
    if set(lengths) != {rows}:
        raise ValueError(f"arrays must have the same number of rows, but have {lengths}")
    if check_count("block", block) > rows:
        raise ValueError(f"block must be at most the number of rows, {rows}, but is {block}")
    check_instance("rng", rng, np.random.Generator)
    check_count("resamples", resamples)
    tail, many = check_tail(confidence), check_flag("vectorized", vectorized)
    batch = max(1, _DRAWN // max(rows, *(array.size for array in data)))
    values: list[Array] = []
    for first in range(0, resamples, batch):
        count = min(batch, resamples - first)
        starts = rng.integers(rows, size=(count, math.ceil(rows / block), 1))
        drawn = (starts + np.arange(block)).reshape(count, -1)[:, :rows]
        sets = [array.take(drawn, axis=0, mode="wrap") for array in data]
        if many:
            found = np.asarray(statistic(*sets, axis=1))
        else:
            found = np.asarray([statistic(*each) for each in zip(*sets, strict=True)])
        if found.shape[:1] != (count,):
            raise ValueError(
                f"statistic must give one value for each of {count} data sets if vectorized, but "
                f"gave an array of the shape {found.shape}"
            )
        values.append(found)
    drawings = check_finite("the values of statistic", np.concatenate(values))
    return np.asarray(np.quantile(drawings, [tail, 1.0 - tail], axis=0))


def block_length(series: ArrayLike) -> int:
    r"""Block length with which `block_bootstrap` best estimates the variance of a series' mean.

    The series (N,) or (N, n) is in time order; with several columns, the one that needs the longest
    blocks decides.  The length is 1 for a series without correlation, and at most
    :math:`3\sqrt N` and :math:`N/3`.

    Notes
    -----
    The rule of Politis & White (2004) as corrected by Patton, Politis & White (2009): with the
    autocovariances R(k), weighted by a flat-top window w(k) whose width is twice the lag after
    which five or more of them are insignificant,

    .. math:: (3N/2)^{1/3} (G/S)^{2/3}, \quad G = \sum_k w(k) |k| R(k), \; S = \sum_k w(k) R(k).

    A first-order autoregression with coefficient a has :math:`G/S = 2a/(1 - a^2)`.
    """
    values = check_finite("series", series, "(N,)", "(N, n)", empty=False)
    rows = len(values)
    longest = max(1, min(math.ceil(3.0 * math.sqrt(rows)), rows // 3))
    lengths = [_block_length(column) for column in values.reshape(rows, -1).T]
    return int(min(max(lengths), longest))


def _block_length(series: Array) -> int:
    """The rule of `block_length` for one series (N,), without its upper bound."""
    rows = len(series)
    centred = series - series.mean()
    centred /= np.abs(centred).max() or 1.0
    run = max(5, math.ceil(math.sqrt(math.log10(rows))))
    lags = min(math.ceil(math.sqrt(rows)) + run, rows - 1)
    covariance = np.array([centred[: rows - k] @ centred[k:] for k in range(lags + 1)]) / rows
    if covariance[0] <= 0.0:
        return 1
    negligible = 2.0 * math.sqrt(math.log10(rows) / rows) * covariance[0]
    quiet = np.abs(covariance[1:]) < negligible
    last = next((m for m in range(lags - run + 1) if quiet[m : m + run].all()), None)
    if last is None:  # then the largest significant lag
        last = int(np.flatnonzero(np.append(True, ~quiet))[-1])
    width = min(2 * last, lags)
    k = np.arange(1, width + 1)
    weighted = np.clip(2.0 * (1.0 - k / width), 0.0, 1.0) * covariance[1 : width + 1]
    total = covariance[0] + 2.0 * weighted.sum()
    slow = 2.0 * (k * weighted).sum()
    if total <= 0.0:
        return 1
    length: float = (1.5 * rows) ** (1.0 / 3.0) * (abs(slow) / total) ** (2.0 / 3.0)
    return max(1, math.ceil(length))


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
