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

A number is judged with its 95 % interval (`d2d.study.book.measured`) against a margin, the smallest
effect that counts; the page with the ledger gives the margins and says why.  "Nearly all" is above
95 %, "hardly any" below 5 %, "some" above it, "most" above one half.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from types import ModuleType
from typing import Literal, NamedTuple, TypeVar

import numpy as np

from d2d.study.book.measured import Measured
from d2d.study.book.thesis_figures import page_of

Verdict = Literal["confirmed", "conditional", "wrong in part", "refuted"]
Finding = Literal["holds", "holds if", "open", "fails"]
Number = TypeVar("Number", bound=float)


def decide(
    *, supported: bool | np.bool_, opposed: bool | np.bool_, conditional: bool | np.bool_ = False
) -> Finding:
    """Decide whether a part holds, holds under a condition, fails, or is open."""
    if supported:
        return "holds"
    if conditional:
        return "holds if"
    return "fails" if opposed else "open"


def in_every(*findings: Finding) -> Finding:
    """Judge a part that speaks of several scenes, methods or measures at once."""
    return decide(
        supported=set(findings) == {"holds"},
        conditional=not {"holds", "holds if"}.isdisjoint(findings),
        opposed="fails" in findings,
    )


class Rule(NamedTuple):
    """The rule that judges a number; ``margin_units`` are above 0 where it supports the part."""

    judge: Callable[[Measured], Finding]
    margin_units: Callable[[float], float]

    def __call__(self, number: Measured, *, under: Measured | None = None) -> Finding:
        """Judge a number; ``under`` is the same number under a condition."""
        finding = self.judge(number)
        if under is not None and finding != "holds" and self.judge(under) == "holds":
            return "holds if"
        return finding


class Margin(NamedTuple):
    """Effects between two bounds, which are too small to count; the rules that use the bounds."""

    low: float
    high: float

    def units(self, value: float) -> float:
        """Return a value in units of the margin; a ratio on a logarithmic scale."""
        if self.low > 0.0:
            return math.log(max(value, 1e-9)) / math.log(self.high)
        return value / self.high

    @property
    def larger(self) -> Rule:
        """The rule of a part that says that a number is larger by what counts."""
        return self._between(1.0, math.inf)

    @property
    def smaller(self) -> Rule:
        """The rule of a part that says that a number is smaller by what counts."""
        return self._between(-math.inf, -1.0)

    @property
    def same(self) -> Rule:
        """The rule of a part that says that nothing changes by what counts."""
        return self._between(-1.0, 1.0)

    @property
    def no_larger(self) -> Rule:
        """The rule of a part that says that a number is the same or smaller."""
        return self._between(-math.inf, 1.0)

    def _between(self, lower: float, upper: float) -> Rule:
        """Return the rule of a part that says that a number lies between these margins."""
        return Rule(
            lambda number: decide(
                supported=lower < self.units(number.low) and self.units(number.high) < upper,
                opposed=self.units(number.high) <= lower or upper <= self.units(number.low),
            ),
            lambda value: min(self.units(value) - lower, upper - self.units(value)),
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
    lambda share: decide(
        supported=share.low > 1.0 - SHARE.high, conditional=most(share), opposed=share.high < 0.5
    ),
    lambda share: (share - 1.0) / SHARE.high + 1.0,
)
"""The rule of a part that speaks of every draw."""

in_some = SHARE.larger
"""The rule of a part that says that something occurs, in a share of the draws."""


def judge(parts: Iterable[Finding]) -> Verdict:
    """Return the verdict on a claim of these parts."""
    all_of = set(parts)
    if all_of == {"holds"}:
        return "confirmed"
    if all_of == {"fails"}:
        return "refuted"
    return "wrong in part" if "fails" in all_of else "conditional"


@dataclass
class Evidence:
    """Measurements of a check, to which it adds parts and numbers until it ends with `conclude`.

    Names of ``numbers`` have units; a plain float is exact, a count or the value of a formula.
    One or two numbers are headlines: the ledger shows them beside the verdict.
    """

    parts: dict[str, Finding] = field(default_factory=dict)  # named in a few words
    because: str = ""  # one sentence that gives the reason, composed from the numbers
    numbers: dict[str, float] = field(default_factory=dict)
    holds: str = ""  # the condition; used if a part holds under one
    over: str = ""  # the draws, layouts or drives that were measured

    def part(self, words: str, rule: Rule) -> "Part":
        """Add a part of the claim: open, until a number judges it."""
        self.parts[words] = "open"
        return Part(self, words, rule)

    def __call__(self, name: str, value: Number) -> Number:
        """Add a number and return it."""
        self.numbers[name] = value
        return value

    def headline(self, name: str, number: Measured, rule: Rule | None = None) -> Measured:
        """Add a headline and return it; a rule gives it a place on the axis of the ledger."""
        self.numbers[name] = number.as_headline(rule.margin_units if rule else None)
        return number

    def conclude(self, because: str, *, over: str, holds: str = "") -> None:
        """Add the sentences."""
        self.because, self.over, self.holds = because, over, holds

    @property
    def verdict(self) -> Verdict:
        """The verdict that follows from the parts."""
        return judge(self.parts.values())

    @property
    def headlines(self) -> dict[str, Measured]:
        """The numbers that the ledger shows beside the verdict."""
        return {
            name: value
            for name, value in self.numbers.items()
            if isinstance(value, Measured) and value.headline
        }

    @property
    def is_conditional(self) -> bool:
        """Whether a part holds under a condition."""
        return "holds if" in self.parts.values()


@dataclass(frozen=True)
class Part:
    """A part of a claim, which holds if all of its numbers say so."""

    evidence: Evidence
    words: str
    rule: Rule  # of its numbers, where they are not given another
    findings: list[Finding] = field(default_factory=list)

    def judge(
        self, number: Measured, rule: Rule | None = None, *, under: Measured | None = None
    ) -> None:
        """Judge the part by one more number, which is not shown."""
        self.findings.append((rule or self.rule)(number, under=under))
        self.evidence.parts[self.words] = in_every(*self.findings)

    def __call__(
        self, name: str, number: Measured, rule: Rule | None = None, under: Measured | None = None
    ) -> Measured:
        """Judge the part by a number, add it to the evidence, and return it."""
        self.judge(number, rule, under=under)
        return self.evidence(name, number)

    def headline(
        self, name: str, number: Measured, rule: Rule | None = None, under: Measured | None = None
    ) -> Measured:
        """Judge the part by a number, add it as a headline, and return it."""
        self.judge(number, rule, under=under)
        return self.evidence.headline(name, number, rule or self.rule)


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
) -> Callable[[Callable[[Evidence], None]], Claim]:
    """Turn a function that fills evidence into a claim, with its docstring as the claim's text."""

    def decorate(fill: Callable[[Evidence], None]) -> Claim:
        def check() -> Evidence:
            evidence = Evidence()
            fill(evidence)
            return evidence

        text = " ".join((fill.__doc__ or "").split())
        return Claim(id, section, lines, text, figure, check)

    return decorate


def claims_of(modules: Iterable[ModuleType]) -> dict[str, Claim]:
    """Return the claims that the modules define, by id, in the order of their definition."""
    values = (value for module in modules for value in vars(module).values())
    return {value.id: value for value in values if isinstance(value, Claim)}
