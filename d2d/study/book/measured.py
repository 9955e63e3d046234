"""Measured numbers with their 95 % intervals."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from d2d._types import Array
from d2d.bootstrap import block_bootstrap
from d2d.credibility import Credibility, credibility

CONFIDENCE = 0.95
RESAMPLES = 500


class Measured(float):
    """A number with the bounds of its 95 % interval; a headline may have a place on an axis."""

    low: float
    high: float
    headline: bool
    margin_units: tuple[float, ...]

    def __new__(
        cls,
        value: float,
        low: float,
        high: float,
        headline: bool = False,
        margin_units: tuple[float, ...] = (),
    ) -> "Measured":
        """Attach bounds to a value."""
        self = super().__new__(cls, value)
        self.low, self.high = float(low), float(high)
        self.headline, self.margin_units = headline, margin_units
        return self

    def as_headline(self, to_units: Callable[[float], float] | None = None) -> "Measured":
        """Return the number as a headline, with a place on the axis if ``to_units`` gives one."""
        places = [to_units(value) for value in (self, self.low, self.high)] if to_units else []
        on_axis = (min(places), places[0], max(places)) if places else ()
        return Measured(self, self.low, self.high, True, on_axis)

    def between(self, spec: str) -> str:
        """Return both bounds in that format: "1.32 to 1.43", say."""
        return f"{self.low:{spec}} to {self.high:{spec}}"


def with_bounds(value: float) -> tuple[float, ...]:
    """Return a number, and the bounds of its interval if it has one."""
    return (value, value.low, value.high) if isinstance(value, Measured) else (value,)


def complement(share: Measured) -> Measured:
    """Return the share of all other cases."""
    return Measured(1.0 - share, 1.0 - share.high, 1.0 - share.low)


def largest(measure: Callable[..., Measured], *conditions: tuple[Any, ...]) -> Measured:
    """Return the largest of a measure over conditions, each the measure's arguments.

    Each condition has an interval that misses its number with probability 0.05 / conditions
    (Bonferroni); then the largest lies between the largest lower and the largest upper bound.
    """
    return _picked(max, measure, conditions)


def smallest(measure: Callable[..., Measured], *conditions: tuple[Any, ...]) -> Measured:
    """Return the smallest of a measure over conditions, with an interval as in `largest`."""
    return _picked(min, measure, conditions)


def _picked(
    pick: Callable[..., Any], measure: Callable[..., Measured], conditions: Sequence[Any]
) -> Measured:
    numbers = [measure(*condition, comparisons=len(conditions)) for condition in conditions]
    return Measured(
        pick(numbers), pick(each.low for each in numbers), pick(each.high for each in numbers)
    )


def _upper(comparisons: int) -> float:
    """Probability below the upper bound of one of several intervals that hold at once."""
    return 1.0 - 0.5 * (1.0 - CONFIDENCE) / comparisons


def share_of(condition: ArrayLike, *, comparisons: int = 1) -> Measured:
    """Share of independent cases (N,) in which a condition is met, with Wilson's interval.

    It has a width even at 0 and 1: after N cases the share of exceptions may be as high as 4 / N.
    """
    met = np.asarray(condition, dtype=np.float64).ravel()
    if not met.size:
        return Measured(0.5, 0.0, 1.0)
    return share_counted(float(met.mean()), len(met), comparisons=comparisons)


def share_over(shares: ArrayLike, cases: float) -> Measured:
    """Mean of the shares (G,) of independent groups, with ``cases`` each, with Wilson's interval.

    They count as the number of independent cases with the same variance between the groups.
    """
    each = np.asarray(shares, dtype=np.float64).ravel()
    share, groups = float(each.mean()), len(each)
    variance = float(each.var(ddof=1)) / groups
    effective = share * (1.0 - share) / variance if variance > 0.0 else 0.0
    return share_counted(share, float(np.clip(effective, groups, groups * cases)))


def share_counted(share: float, cases: float, *, comparisons: int = 1) -> Measured:
    """A share of so many cases, with Wilson's interval; N correlated rows are N / block cases."""
    z2 = scipy.special.ndtri(_upper(comparisons)) ** 2 / cases
    middle = (share + 0.5 * z2) / (1.0 + z2)
    half = np.sqrt(z2 * (share * (1.0 - share) + 0.25 * z2)) / (1.0 + z2)
    low, high = max(middle - half, 0.0), min(middle + half, 1.0)
    return Measured(share, min(low, share), max(high, share))


def share_difference(of: ArrayLike, minus: ArrayLike, *, comparisons: int = 1) -> Measured:
    """Difference of the shares of the same independent cases (N,) that meet two conditions.

    The interval of Bonett & Price (2012), which like Wilson's has a width if no case differs.
    """
    differences = np.asarray(of, dtype=np.float64) - np.asarray(minus, dtype=np.float64)
    count = len(differences) + 2
    gained = (np.sum(differences > 0.0) + 1) / count
    lost = (np.sum(differences < 0.0) + 1) / count
    variance = (gained + lost - (gained - lost) ** 2) / count
    half = scipy.special.ndtri(_upper(comparisons)) * np.sqrt(variance)
    low, high = max(gained - lost - half, -1.0), min(gained - lost + half, 1.0)
    return Measured(float(differences.mean()), low, high)


def mean_of(values: ArrayLike, *, comparisons: int = 1) -> Measured:
    """Mean of independent values (N,), with Student's interval."""
    each = np.asarray(values, dtype=np.float64).ravel()
    mean = float(each.mean())
    error = each.std(ddof=1) / np.sqrt(len(each))
    half = scipy.special.stdtrit(len(each) - 1, _upper(comparisons)) * error
    return Measured(mean, mean - half, mean + half)


def geometric_mean_of(values: ArrayLike) -> Measured:
    """Geometric mean of independent positive values (N,), with Student's interval of the log."""
    logs = mean_of(np.log(values))
    return Measured(np.exp(logs), np.exp(logs.low), np.exp(logs.high))


def bootstrapped(
    statistic: Callable[..., ArrayLike],
    *arrays: Array | NDArray[np.bool_],
    block: int = 1,
    vectorized: bool = False,
    comparisons: int = 1,
) -> Measured:
    """A statistic of cases (N, ...), with the interval of `d2d.block_bootstrap`.

    ``block`` and ``vectorized`` are as there; the cases are independent unless ``block`` exceeds 1.
    """
    rng = np.random.default_rng(0)
    low, high = block_bootstrap(
        statistic,
        arrays,
        block,
        rng,
        confidence=1.0 - (1.0 - CONFIDENCE) / comparisons,
        resamples=RESAMPLES * comparisons,
        vectorized=vectorized,
    )
    whole = statistic(*arrays, axis=0) if vectorized else statistic(*arrays)
    return Measured(float(np.asarray(whole)), float(low), float(high))


def _all_of(drawn: Array, axis: int) -> Array:
    """All values (..., N n) of data sets (..., N, n) whose rows lie along an axis."""
    return drawn.reshape(*drawn.shape[:axis], -1)


def quantile_of(values: Array, fraction: float, *, comparisons: int = 1) -> Measured:
    """Quantile of independent values (N,), say one for each layout, or of all in rows (N, n)."""
    return bootstrapped(
        lambda drawn, axis: np.quantile(_all_of(drawn, axis), fraction, axis=-1),
        values,
        vectorized=True,
        comparisons=comparisons,
    )


def median_of(values: Array, *, comparisons: int = 1) -> Measured:
    """Median of independent values (N,), or of all values in independent rows (N, n)."""
    return quantile_of(values, 0.5, comparisons=comparisons)


def rms_of(errors: Array, *, comparisons: int = 1) -> Measured:
    """Root mean square of independent errors (N,)."""
    return bootstrapped(
        lambda squares, axis: np.sqrt(squares.mean(axis)),
        errors**2,
        vectorized=True,
        comparisons=comparisons,
    )


def rms_ratio(over: Array, under: Array, block: int = 1, *, comparisons: int = 1) -> Measured:
    """Ratio of the root mean squares of two series (N,), or rows (N, n), from the same draws."""
    return bootstrapped(
        lambda a, b, axis: np.sqrt(_all_of(a, axis).mean(-1) / _all_of(b, axis).mean(-1)),
        over**2,
        under**2,
        block=block,
        vectorized=True,
        comparisons=comparisons,
    )


def anees_of(runs: Credibility) -> Measured:
    """ANEES of independent runs."""
    return mean_of(runs.nees * (runs.anees / runs.nees.mean()))


def nci_of(errors: Array, covariances: Array) -> Measured:
    """NCI of independent runs, in dB."""
    return bootstrapped(lambda e, c: credibility(e, c).nci, errors, covariances)


def inclination_of(runs: Credibility) -> Measured:
    """I^2 of independent runs, in dB."""
    return mean_of(_inclinations(runs))


def inclination_change(after: Credibility, before: Credibility) -> Measured:
    """Difference of two I^2 of the same runs, in dB."""
    return mean_of(_inclinations(after) - _inclinations(before))


def _inclinations(runs: Credibility) -> Array:
    """One term (N,) in dB for each run, whose mean is I^2 and whose scatter is that of I^2.

    The actual covariance in the credibility ratio is estimated from the same runs, which to first
    order adds credible NEES / dimension - 1, with the mean 0, to the logarithm of each ratio.
    """
    credible = runs.credible_nees
    terms = np.log(runs.ratio) + credible / credible.mean() - 1.0
    return np.asarray(10.0 / np.log(10.0) * terms)
