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


def shown(
    *, holds: bool | np.bool_, contrary: bool | np.bool_, within: bool | np.bool_ = False
) -> Finding:
    """What is shown of a part: that it holds, that it does within a condition, or its contrary."""
    if holds:
        return "holds"
    if within:
        return "holds if"
    return "fails" if contrary else "open"


def in_every(*findings: Finding) -> Finding:
    """Of a part that speaks of several scenes, methods or measures at once."""
    return shown(
        holds=set(findings) == {"holds"},
        within=not {"holds", "holds if"}.isdisjoint(findings),
        contrary="fails" in findings,
    )


class Rule(NamedTuple):
    """What is shown of a part that says the same of one number or of several.

    On the axis of what counts, a number that speaks for the claim has a ``place`` above 0.
    """

    of_one: Callable[[Measured], Finding]
    place: Callable[[float], float]

    def __call__(self, *numbers: Measured, under: Measured | None = None) -> Finding:
        """Judge the numbers; ``under`` is one that meets a condition, and must pass as well."""
        found = in_every(*map(self.of_one, numbers))
        if under is not None and found != "holds" and self.of_one(under) == "holds":
            return "holds if"
        return found


class Margin(NamedTuple):
    """What is too close to no effect to count, between two bounds; the rules that use it."""

    low: float
    high: float

    def sizes(self, value: float) -> float:
        """A value in units of the margin; that of a ratio on a logarithmic scale."""
        if self.low > 0.0:
            return math.log(max(value, 1e-9)) / math.log(self.high)
        return value / self.high

    @property
    def larger(self) -> Rule:
        """Of a part that says that a number is larger by what counts."""
        return Rule(
            lambda number: shown(holds=number.low > self.high, contrary=number.high <= self.high),
            lambda value: self.sizes(value) - 1.0,
        )

    @property
    def smaller(self) -> Rule:
        """Of a part that says that a number is smaller by what counts."""
        return Rule(
            lambda number: shown(holds=number.high < self.low, contrary=number.low >= self.low),
            lambda value: -self.sizes(value) - 1.0,
        )

    @property
    def same(self) -> Rule:
        """Of a part that says that nothing changes by what counts."""
        return Rule(
            lambda number: shown(
                holds=self.low < number.low and number.high < self.high,
                contrary=number.low > self.high or number.high < self.low,
            ),
            lambda value: 1.0 - abs(self.sizes(value)),
        )

    @property
    def no_larger(self) -> Rule:
        """Of a part that says that a number is the same or smaller."""
        return Rule(
            lambda number: shown(holds=number.high < self.high, contrary=number.low > self.high),
            lambda value: 1.0 - self.sizes(value),
        )


RATIO = Margin(1.0 / 1.05, 1.05)  # of errors, of standard deviations
DECIBELS = Margin(-0.5, 0.5)  # of I^2 and NCI
ANEES = Margin(10.0**-0.05, 10.0**0.05)  # the same as a factor of the variance
SHARE = Margin(-0.05, 0.05)  # differences of shares
MEAN = Margin(-0.32, 0.32)  # standard deviations: an offset that raises an RMSE by 5 %


def most(share: Measured) -> bool:
    """Whether the share is above one half."""
    return share.low > 0.5


nearly_all = Rule(
    lambda share: shown(
        holds=share.low > 1.0 - SHARE.high, within=most(share), contrary=share.high < 0.5
    ),
    lambda share: (share - 1.0) / SHARE.high + 1.0,
)
"""Of a part that speaks of every draw."""

in_some = SHARE.larger
"""Of a part that says that something occurs, in a share of the draws."""


def judge(parts: Iterable[Finding]) -> Verdict:
    """The verdict on a claim of these parts."""
    all_of = set(parts)
    if all_of == {"holds"}:
        return "confirmed"
    if all_of == {"fails"}:
        return "refuted"
    return "wrong in part" if "fails" in all_of else "conditional"


def tells(number: Measured, rule: Rule | None = None) -> Measured:
    """The number, marked as one of the two or so that tell most.

    Given the rule that judges it, it has a place on the axis of what counts: to the right of 0 it
    speaks for the claim, to the left against it, in units of the margin.
    """
    return number.told(rule.place if rule else None)


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
