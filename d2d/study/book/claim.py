"""A claim of the thesis, the evidence that judges it, and the rule of judgement.

A claim is a sentence of the thesis, judged part by part where the thesis says that it holds: in its
scene or, where that is not known, in ours and on random layouts of the same kind.  A part

- *holds* if that is shown: an effect lies beyond its margin, or what is said of a draw is true in
  nearly all;
- *fails* if the contrary is shown: the effect lies short of the margin, or what is said of a draw
  is false in more than half;
- *holds if* it is true in most draws only, or in nearly all under a condition that the thesis's
  words include and that can be checked beforehand, or in some of the scenes that it speaks of;
- is *open* if the measurements show none of these.

A claim is *confirmed* if all of its parts hold and *refuted* if all of them fail.  If some fail, it
is *wrong in part*; if none does, *conditional*.  A search outside the thesis's conditions for a
case in which a claim holds, or fails, is shown beside the verdict and decides nothing.

A number is always judged with its 95 % interval (`d2d.study.book.measured`):

- A difference is *larger* or *smaller* if the whole interval lies beyond a margin, and *the same*
  if the whole interval lies within it (two one-sided tests, Schuirmann 1987).  An interval that
  contains a bound of the margin shows neither.
- The margin is the smallest effect that counts.  Ratios of errors or of standard deviations: 5 %,
  the effect of a tenth more targets, and what a thousand runs can resolve.  I^2 and NCI: 0.5 dB, a
  covariance that is 12 % off, which is 6 % of a standard deviation.  ANEES: those 12 %.  Shares: 5
  percentage points, one draw in twenty.  Offsets: a third of a standard deviation, which raises an
  RMSE by 5 %.
- *Nearly all*: the interval of the share lies above 95 %.  *Hardly any* is below 5 %, *some* is
  above it, *most* is above one half.

The margins are as old as the first measurements: they were set when some effects were known.  The
evidence says so where a verdict would change with another margin.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import Literal, NamedTuple

import numpy as np

from d2d.study.book.measured import Measured
from d2d.study.book.thesis_figures import page_of

Verdict = Literal["confirmed", "conditional", "wrong in part", "refuted"]
Finding = Literal["holds", "holds if", "open", "fails"]


class Margin(NamedTuple):
    """What is too close to no effect to count, between two bounds."""

    low: float
    high: float

    def sizes(self, value: float) -> float:
        """A value in units of the margin; that of a ratio on a logarithmic scale."""
        if self.low > 0.0:
            return math.log(max(value, 1e-9)) / math.log(self.high)
        return value / self.high


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


def shown(
    *, holds: bool | np.bool_, contrary: bool | np.bool_, within: bool | np.bool_ = False
) -> Finding:
    """What is shown of a part: that it holds, that it does within a condition, or its contrary."""
    if holds:
        return "holds"
    if within:
        return "holds if"
    return "fails" if contrary else "open"


def is_larger(number: Measured, margin: Margin) -> Finding:
    """Of a part that says that a number is larger by what counts."""
    return shown(holds=larger(number, margin), contrary=number.high <= margin.high)


def is_smaller(number: Measured, margin: Margin) -> Finding:
    """Of a part that says that a number is smaller by what counts."""
    return shown(holds=smaller(number, margin), contrary=number.low >= margin.low)


def is_same(number: Measured, margin: Margin) -> Finding:
    """Of a part that says that nothing changes by what counts."""
    contrary = larger(number, margin) or smaller(number, margin)
    return shown(holds=same(number, margin), contrary=contrary)


def is_no_larger(number: Measured, margin: Margin) -> Finding:
    """Of a part that says that a number is the same or smaller."""
    return shown(holds=number.high < margin.high, contrary=larger(number, margin))


def in_nearly_all(share: Measured, under: Measured | None = None) -> Finding:
    """Of a part that speaks of every draw.

    ``under`` is the share of the draws that meet a condition, which must be nearly all.
    """
    within = most(share) or (under is not None and nearly_all(under))
    return shown(holds=nearly_all(share), contrary=share.high < 0.5, within=within)


def in_some(share: Measured) -> Finding:
    """Of a part that says that something occurs."""
    return shown(holds=share.low > SHARE.high, contrary=share.high <= SHARE.high)


def in_every(*findings: Finding) -> Finding:
    """Of a part that speaks of several scenes, methods or measures at once."""
    return shown(
        holds=set(findings) == {"holds"},
        within=not {"holds", "holds if"}.isdisjoint(findings),
        contrary="fails" in findings,
    )


def judge(parts: Iterable[Finding]) -> Verdict:
    """The verdict on a claim of these parts."""
    all_of = set(parts)
    if all_of == {"holds"}:
        return "confirmed"
    if all_of == {"fails"}:
        return "refuted"
    return "wrong in part" if "fails" in all_of else "conditional"


def tells(
    number: Measured, rule: Callable[..., bool] | None = None, margin: Margin = SHARE
) -> Measured:
    """The number, marked as one of the two or so that tell most.

    Given the rule that judges it, it has a place on the axis of what counts: to the right of 0 it
    speaks for the claim, to the left against it, in units of the margin.
    """
    if rule is None:
        return number.told()
    if rule is nearly_all:
        return number.told(lambda share: (share - 1.0) / SHARE.high + 1.0)
    sign = {larger: 1.0, smaller: -1.0}.get(rule)
    if sign is None:  # the same
        return number.told(lambda value: 1.0 - abs(margin.sizes(value)))
    return number.told(lambda value: sign * margin.sizes(value) - 1.0)


@dataclass(frozen=True)
class Evidence:
    """What a check measured, and what follows from it.

    The ``numbers`` have names with units.  What was measured has its 95 % interval; a plain float
    is exact, a count or the value of a formula.  The one or two that tell most are marked with
    `tells`.
    """

    parts: Mapping[str, Finding]  # what is shown of each part of the claim, named in a few words
    because: str  # one sentence that gives the reason, composed from the numbers
    numbers: Mapping[str, float]
    holds: str = ""  # the condition; used if a part holds under one
    over: str = ""  # the draws, layouts or drives that were measured

    @property
    def verdict(self) -> Verdict:
        """What the rule makes of the parts."""
        return judge(self.parts.values())

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
        """Whether it is said when a part holds."""
        return "holds if" in self.parts.values()


@dataclass(frozen=True)
class Claim:
    """One row of the ledger: a sentence of the thesis, in our words."""

    id: str
    section: str
    lines: str  # of the thesis's LaTeX source
    text: str
    figure: str  # label of the book's figure that shows it, without ``fig-``
    # measures and judges, with a fixed seed; other measurements would give another verdict
    check: Callable[[], Evidence]

    @property
    def page(self) -> str:
        """The page of the book that judges it."""
        return page_of(self.section, self.id)


def claim(
    id: str, *, section: str, lines: str, figure: str
) -> Callable[[Callable[[], Evidence]], Claim]:
    """Turn the decorated check into a claim, with the check's docstring as its text."""

    def decorate(check: Callable[[], Evidence]) -> Claim:
        text = " ".join((check.__doc__ or "").split())
        return Claim(id, section, lines, text, figure, check)

    return decorate


def claims_of(modules: Iterable[ModuleType]) -> dict[str, Claim]:
    """The claims that the modules define, by id, in the order of their definition."""
    values = (value for module in modules for value in vars(module).values())
    return {value.id: value for value in values if isinstance(value, Claim)}
