"""Claims as readers see them: the ledger, its tables, and the list that ends a page.

The ledger is HTML.  Lists and tables are MyST Markdown, so that they may refer as the text does:
``[text](#fig-x)`` links to the figure with that label, and the build of the book fails if there is
none.
"""

import math
import textwrap
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import groupby
from typing import NamedTuple

from d2d.study.book.claim import Claim, Evidence, Finding, Verdict
from d2d.study.book.measured import Measured, with_bounds
from d2d.study.book.table import significant
from d2d.study.book.templates import render, typeset
from d2d.study.book.thesis_figures import FIGURES, ThesisFigure, page_of

SIGNS: dict[Verdict, str] = {
    "confirmed": "✓",
    "conditional": "≈",
    "wrong in part": "½",
    "refuted": "✗",
}
"""The sign beside the word of each verdict, so that no verdict is marked by its colour alone."""

FINDINGS: dict[Finding, tuple[str, str]] = {
    "holds": ("✓", "holds"),
    "holds if": ("≈", "holds under a condition"),
    "open": ("?", "is not decided"),
    "fails": ("✗", "fails"),
}
"""The sign and the words of each finding."""

LEDGER = "claims.html"
"""Beside the page that links to it, because all pages with claims are chapters."""


def badge(verdict: Verdict) -> str:
    """Return a verdict as HTML; ``_static/ledger.css`` colours it."""
    return f'<span class="verdict {_style(verdict)}">{SIGNS[verdict]} {verdict}</span>'


def _style(verdict: Verdict) -> str:
    return f"verdict-{verdict.replace(' ', '-')}"


def anchor(id: str) -> str:
    """Return the HTML id of a claim's row in the ledger."""
    return f"claim-{id}"


def _figures(value: float) -> list[str]:
    """Return a number, and the bounds of its interval if it has one, all with equal decimals."""
    each = with_bounds(value)
    width, largest = max(each) - min(each), max(map(abs, each))
    if not 1e-5 < width < math.inf:
        return [significant(number) for number in each]
    least = -math.floor(max(math.log10(width) - 1, math.log10(largest) - 2))
    for decimals in range(min(max(least, 0), 3), 6):
        shown = [f"{round(number, decimals) + 0.0:.{decimals}f}" for number in each]
        if len({*shown}) > 1:
            break
    return shown


def _bounds(value: float) -> list[str]:
    return _figures(value)[1:] or ["exact"]  # say, a count


def _with_interval(value: float) -> str:
    return f"{_figures(value)[0]} [{', '.join(_bounds(value))}]"


def _where(claim: Claim) -> str:
    several = "lines" if any(mark in claim.lines for mark in ",–") else "line"
    return f"section {claim.section}, {several} {claim.lines}"


def in_words(claim: Claim, evidence: Evidence) -> str:
    """Return a claim with its verdict, the reason and all numbers, as text."""
    sentences = [f"[{claim.id}] {claim.text} (thesis, {_where(claim)})"]
    if len(evidence.parts) > 1:
        parts = (f"{part}: {FINDINGS[finding][1]}" for part, finding in evidence.parts.items())
        sentences.append("; ".join(parts))
    if evidence.is_conditional:
        sentences.append(f"holds: {evidence.holds}")
    sentences.append(f"{evidence.verdict}: {evidence.because}")
    if evidence.over:
        sentences.append(f"measured over {evidence.over}")
    numbers = [f"  {name}: {_with_interval(value)}" for name, value in evidence.numbers.items()]
    return "\n".join([*(textwrap.fill(sentence, 76) for sentence in sentences), *numbers])


@dataclass(frozen=True)
class PageClaims:
    """The claims that a page settles, by verdict; displays itself."""

    verdicts: dict[Verdict, list[Claim]]  # without empty ones

    def __str__(self) -> str:
        named = {verdict: [claim.id for claim in own] for verdict, own in self.verdicts.items()}
        return "; ".join(f"{len(ids)} {each}: {', '.join(ids)}" for each, ids in named.items())

    __repr__ = __str__

    def _repr_markdown_(self) -> str:
        return "**What the thesis claims of this, and what came out:**\n\n" + "\n".join(
            f'- <a href="{LEDGER}#{anchor(claim.id)}">{badge(verdict)}</a> {typeset(claim.text)}'
            for verdict, own in self.verdicts.items()
            for claim in own
        )


def page_claims(page: str, claims: Iterable[Claim], record: Mapping[str, Evidence]) -> PageClaims:
    """Return the claims of a page, named as its file, by verdict."""
    own = [claim for claim in claims if claim.page == page]
    by = {sign: [claim for claim in own if record[claim.id].verdict == sign] for sign in SIGNS}
    return PageClaims({verdict: listed for verdict, listed in by.items() if listed})


def count_verdicts(record: Mapping[str, Evidence]) -> str:
    """Say how many claims there are, and how many of each verdict, in one line."""
    counts = Counter(item.verdict for item in record.values())
    listed = ", ".join(f"{counts[verdict]} {verdict}" for verdict in SIGNS)
    return f"{len(record)} claims: {listed}"


def figures_table(figures: Iterable[ThesisFigure]) -> str:
    """List the thesis's figures: the number of each, what it shows, and where ours is."""
    lines = ["| thesis | what it shows | ours |", "| --- | --- | --- |"]
    for figure in figures:
        kind = "" if figure.number.startswith("Table") else "Figure "
        ours = f"[chapter {_chapter(figure.page)}, {figure.id}](#fig-{figure.id})"
        lines.append(f"| {kind}{figure.number} | {figure.shows} | {ours} |")
    return "\n".join(lines)


def _chapter(page: str) -> str:
    return page.split("_")[0].lstrip("0").upper()  # 4 for ``04_...``, B for ``b_...``


class _Row(NamedTuple):
    """A line of the ledger."""

    claim: Claim
    evidence: Evidence

    def __str__(self) -> str:
        headlines = self.evidence.headlines.items()
        numbers = "; ".join(f"{name} {_with_interval(value)}" for name, value in headlines)
        return f"{self.evidence.verdict:13} {self.claim.id} ({self.claim.section}): {numbers}"

    @property
    def chapter(self) -> str:
        """The number of the claim's chapter."""
        return _chapter(self.claim.page)

    @property
    def figure_page(self) -> str:
        """The page of the claim's figure, which need not be the claim's."""
        elsewhere = page_of(self.claim.section, self.claim.figure)
        return next((each.page for each in FIGURES if each.id == self.claim.figure), elsewhere)

    @property
    def others(self) -> dict[str, float]:
        """The numbers beside the headlines."""
        headlines = self.evidence.headlines
        return {name: n for name, n in self.evidence.numbers.items() if name not in headlines}


@dataclass(frozen=True)
class Ledger:
    """All claims, a line each that unfolds, below a map of them; displays itself."""

    rows: tuple[_Row, ...]

    def __str__(self) -> str:
        return "\n".join(map(str, self.rows))

    __repr__ = __str__

    def _repr_html_(self) -> str:
        by_page = sorted(self.rows, key=lambda row: row.claim.page)
        words = {"badge": badge, "style": _style, "anchor": anchor, "where": _where}
        numbers = {"figures": _figures, "bounds": _bounds, "axis": _axis}
        chapters = {chapter: [*rows] for chapter, rows in groupby(by_page, lambda row: row.chapter)}
        tables = {"signs": SIGNS, "findings": FINDINGS, "width": _WIDTH, "height": _HEIGHT}
        return render(
            "ledger.html", rows=self.rows, chapters=chapters, **words, **numbers, **tables
        )


def ledger(claims: Iterable[Claim], record: Mapping[str, Evidence]) -> Ledger:
    """Return the ledger of claims.  Raises ``KeyError`` with the id if one is not on record."""
    return Ledger(tuple(_Row(claim, record[claim.id]) for claim in claims))


_WIDTH, _HEIGHT, _FARTHEST = 110, 14, 20.0  # of an axis in px, and its ends in margins


class _Axis(NamedTuple):
    """An interval on the axis of what counts, in px, and the side that it lies on."""

    low: str
    value: str
    high: str
    side: str


def _axis(number: Measured) -> _Axis | None:
    """Place a number on the axis of what counts, which is logarithmic to either side of 0."""
    if not number.margin_units:
        return None
    middle = 0.5 * _WIDTH
    scale = (middle - 4) / math.log1p(_FARTHEST)
    low, value, high = (
        middle + math.copysign(scale * math.log1p(min(abs(margins), _FARTHEST)), margins)
        for margins in number.margin_units
    )
    side = "for" if low > middle else "against" if high < middle else "open"
    return _Axis(f"{low:.1f}", f"{value:.1f}", f"{max(high, low + 1):.1f}", side)
