"""A claim of the thesis, the evidence that judges it, and the rule of judgement.

A number is always judged with its 95 % interval (`d2d.study.book.measured`):

- A difference is *larger* or *smaller* if the whole interval lies beyond a margin, and *the same*
  if the whole interval lies within it (two one-sided tests, Schuirmann 1987).  An interval that
  contains a bound of the margin shows neither, and confirms nothing.
- The margin is the smallest effect that counts.  Ratios of errors or of standard deviations: 5 %,
  the effect of a tenth more targets, and what a thousand runs can resolve.  I^2 and NCI: 0.5 dB, a
  covariance that is 12 % off, which is 6 % of a standard deviation.  ANEES: those 12 %.  Shares: 5
  percentage points, one draw in twenty.  Offsets: a third of a standard deviation, which raises an
  RMSE by 5 %.
- A statement about all draws must hold in *nearly all*: the interval of the share lies above 95 %.
  *Hardly any* is below 5 %, *some* is above it, *most* is above one half.  For a qualified verdict,
  what is said to work must work in most draws, and what is said to go wrong must do so in some.

A claim is *confirmed* if every part of it passes, in the thesis's scene and, where its layout is
not known, on random layouts; *qualified* if one part passes, or the whole under a condition that
was measured and is stated; *refuted* if no part passes, or the contrary does.  The evidence names
the draws, layouts or drives that were measured.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import Literal, NamedTuple

import numpy as np

from d2d.study.book.measured import Measured
from d2d.study.book.thesis_figures import page_of

Verdict = Literal["confirmed", "qualified", "refuted"]


class Margin(NamedTuple):
    """What is too close to no effect to count, between two bounds."""

    low: float
    high: float

    def times(self, unit: float) -> "Margin":
        """Both bounds times a unit, say a standard deviation in m."""
        return Margin(unit * self.low, unit * self.high)


RATIO = Margin(1.0 / 1.05, 1.05)  # of errors, of standard deviations
DECIBELS = Margin(-0.5, 0.5)  # of I^2 and NCI
ANEES = Margin(10.0**-0.05, 10.0**0.05)  # the same as a factor of the variance
SHARE = Margin(-0.05, 0.05)  # differences of shares
MEAN = Margin(-0.32, 0.32)  # standard deviations: an offset that raises an RMSE by 5 %


def larger(number: Measured, margin: Margin) -> bool:
    """Whether the whole interval lies above the margin."""
    return number.low > margin.high


def smaller(number: Measured, margin: Margin) -> bool:
    """Whether the whole interval lies below the margin."""
    return number.high < margin.low


def same(number: Measured, margin: Margin) -> bool:
    """Whether the whole interval lies within the margin."""
    return margin.low < number.low and number.high < margin.high


def nearly_all(share: Measured) -> bool:
    """Whether the share of exceptions is below the margin of a share."""
    return share.low > 1.0 - SHARE.high


def most(share: Measured) -> bool:
    """Whether the share is above one half."""
    return share.low > 0.5


def some(share: Measured) -> bool:
    """Whether the share is above the margin of a share."""
    return share.low > SHARE.high


def hardly_any(share: Measured) -> bool:
    """Whether the share is below the margin of a share."""
    return share.high < SHARE.high


def judge(*, confirmed: bool | np.bool_, qualified: bool | np.bool_ = False) -> Verdict:
    """The verdict of the first condition that is met, or "refuted" if neither is."""
    if confirmed:
        return "confirmed"
    return "qualified" if qualified else "refuted"


@dataclass(frozen=True)
class Evidence:
    """What a check measured, and what follows from it.

    The ``numbers`` have names with units.  What was measured has its 95 % interval; a plain float
    is exact, a count or the value of a formula.  The one or two that tell most are marked with
    `d2d.study.book.measured.telling`.
    """

    verdict: Verdict  # decided by the check from the numbers, see `judge`
    because: str  # one sentence that gives the reason, composed from the numbers
    numbers: Mapping[str, float]
    holds: str = ""  # the condition under which it does; not used if the claim is confirmed
    over: str = ""  # the draws, layouts or drives that were measured

    @property
    def telling(self) -> dict[str, Measured]:
        """The numbers that tell most: the ledger shows these, and a card shows them first."""
        return {
            name: value
            for name, value in self.numbers.items()
            if isinstance(value, Measured) and value.telling
        }

    @property
    def is_conditional(self) -> bool:
        """Whether it is said when the claim holds."""
        return self.verdict != "confirmed" and bool(self.holds)


@dataclass(frozen=True)
class Claim:
    """One row of the ledger: a claim of a section of the thesis, in our words."""

    id: str
    section: str
    text: str
    figure: str  # label of the book's figure that shows it, without ``fig-``
    # measures and judges, with a fixed seed; other measurements would give another verdict
    check: Callable[[], Evidence]

    @property
    def page(self) -> str:
        """The page of the book that judges it."""
        return page_of(self.section, self.id)


def claim(id: str, *, section: str, figure: str) -> Callable[[Callable[[], Evidence]], Claim]:
    """Turn the decorated check into a claim, with the check's docstring as its text."""

    def decorate(check: Callable[[], Evidence]) -> Claim:
        text = " ".join((check.__doc__ or "").split())
        return Claim(id, section, text, figure, check)

    return decorate


def claims_of(modules: Iterable[ModuleType]) -> dict[str, Claim]:
    """The claims that the modules define, by id, in the order of their definition.

    Raises ``ValueError`` if two claims share an id.
    """
    claims: dict[str, Claim] = {}
    for module in modules:
        for value in vars(module).values():
            if isinstance(value, Claim) and claims.setdefault(value.id, value) is not value:
                raise ValueError(f"two claims have the id {value.id!r}")
    return claims
