"""Claims as readers see them: the ledger, its tables, and the line that ends a page.

The ledger is HTML.  Lines and tables are MyST Markdown, so that they may refer as the text does:
``[text](#fig-x)`` links to the figure with that label, and the build of the book fails if there is
none.
"""

import math
import textwrap
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape

from d2d.study.book.claim import Claim, Evidence, Finding, Verdict
from d2d.study.book.measured import Measured
from d2d.study.book.table import significant
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

WIDTH = 88


def badge(verdict: Verdict) -> str:
    """Return a verdict as HTML; ``_static/ledger.css`` colours it."""
    return f'<span class="verdict {_style(verdict)}">{SIGNS[verdict]} {verdict}</span>'


def _style(verdict: Verdict) -> str:
    return f"verdict-{verdict.replace(' ', '-')}"


def anchor(id: str) -> str:
    """Return the HTML id of a claim's row in the ledger."""
    return f"claim-{id}"


def _bounds(value: float) -> list[str]:
    bounds = (value.low, value.high) if isinstance(value, Measured) else ()
    return [significant(bound) for bound in bounds] or ["exact"]  # say, a count


def _with_interval(value: float) -> str:
    return f"{significant(value)} [{', '.join(_bounds(value))}]"


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
    return "\n".join([*(textwrap.fill(sentence, WIDTH) for sentence in sentences), *numbers])


@dataclass(frozen=True)
class PageClaims:
    """The claims that a page settles, in one line; displays itself."""

    verdicts: dict[Verdict, list[str]]  # ids, without empty verdicts

    def __str__(self) -> str:
        return "; ".join(
            f"{len(ids)} {verdict}: {', '.join(ids)}" for verdict, ids in self.verdicts.items()
        )

    __repr__ = __str__

    def _repr_markdown_(self) -> str:
        def link(id: str) -> str:
            return f'<a href="{LEDGER}#{anchor(id)}"><code>{id}</code></a>'

        listed = "; ".join(
            f"{len(ids)} {badge(verdict)}: {', '.join(map(link, ids))}"
            for verdict, ids in self.verdicts.items()
        )
        return f"**What the thesis claims of this, and what came out:** {listed}."


def page_claims(page: str, claims: Iterable[Claim], record: Mapping[str, Evidence]) -> PageClaims:
    """Return the claims of a page, named as its file, by verdict."""
    own = [claim.id for claim in claims if claim.page == page]
    ids = {verdict: [id for id in own if record[id].verdict == verdict] for verdict in SIGNS}
    return PageClaims({verdict: listed for verdict, listed in ids.items() if listed})


def count_verdicts(record: Mapping[str, Evidence]) -> str:
    """Say how many claims there are, and how many of each verdict, in one line."""
    counts = zip(_counts(record.values()), SIGNS, strict=True)
    listed = ", ".join(f"{number} {verdict}" for number, verdict in counts)
    return f"{len(record)} claims: {listed}"


def _counts(evidence: Iterable[Evidence]) -> list[int]:
    counts = Counter(item.verdict for item in evidence)
    return [counts[verdict] for verdict in SIGNS]


def figures_table(figures: Iterable[ThesisFigure]) -> str:
    """List the thesis's figures: the number of each, what it shows, and where ours is."""
    rows = []
    for figure in figures:
        kind = "" if figure.number.startswith("Table") else "Figure "
        ours = f"[chapter {_chapter(figure.page)}, {figure.id}](#fig-{figure.id})"
        rows.append([f"{kind}{figure.number}", figure.shows, ours])
    return _markdown_table(["thesis", "what it shows", "ours"], rows)


def _markdown_table(header: Sequence[str], rows: Iterable[Sequence[str | int]]) -> str:
    lines = [f"| {' | '.join(map(str, row))} |" for row in (header, *rows)]
    lines.insert(1, "|" + " --- |" * len(header))
    return "\n".join(lines)


def _chapter(page: str) -> str:
    return page.split("_")[0].lstrip("0").upper()  # 4 for ``04_...``, B for ``b_...``


@dataclass(frozen=True)
class Ledger:
    """All claims, a line each that unfolds, below a map of them; displays itself."""

    shown: tuple[tuple[Claim, Evidence], ...]

    def __str__(self) -> str:
        lines = []
        for claim, evidence in self.shown:
            headlines = evidence.headlines.items()
            numbers = "; ".join(f"{name} {_with_interval(value)}" for name, value in headlines)
            lines.append(f"{evidence.verdict:13} {claim.id} ({claim.section}): {numbers}")
        return "\n".join(lines)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        rows = "\n".join(_row(claim, evidence) for claim, evidence in self.shown)
        return (
            f'{_map(self.shown)}\n<div class="ledger" id="ledger">\n'
            f'<div class="ledger-head" aria-hidden="true"><span>verdict</span><span>claim</span>'
            '<span><span class="axis-head"><span>against</span><span>for</span></span></span>'
            f"</div>\n{rows}\n</div>"
        )


def ledger(claims: Iterable[Claim], record: Mapping[str, Evidence]) -> Ledger:
    """Return the ledger of claims.  Raises ``KeyError`` with the id if one is not on record."""
    return Ledger(tuple((claim, record[claim.id]) for claim in claims))


def _map(shown: Sequence[tuple[Claim, Evidence]]) -> str:
    """Return the verdicts by chapter, each a link to its line."""
    chapters: dict[str, list[str]] = {}
    for claim, evidence in sorted(shown, key=lambda pair: pair[0].page):
        words = f"{claim.id}: {evidence.verdict}"
        chapters.setdefault(_chapter(claim.page), []).append(
            f'<a class="verdict {_style(evidence.verdict)}" href="#{anchor(claim.id)}" '
            f'title="{words}" aria-label="{words}">{SIGNS[evidence.verdict]}</a>'
        )
    cells = "".join(
        f"<li><span>{chapter}</span>{''.join(links)}</li>" for chapter, links in chapters.items()
    )
    return f'<ol class="ledger-map" aria-label="Verdicts by chapter">{cells}</ol>'


def _row(claim: Claim, evidence: Evidence) -> str:
    """Return a line with the verdict and the headlines, which unfolds to all that was found."""
    verdict, chapter, headlines = evidence.verdict, _chapter(claim.page), evidence.headlines
    elsewhere = page_of(claim.section, claim.figure)  # the page of a figure need not be the claim's
    figure_page = next((each.page for each in FIGURES if each.id == claim.figure), elsewhere)
    shown = "".join(
        f'<span class="told" title="{escape(name)}">{_axis(value)}<b>'
        f"{significant(value)}</b> {_interval(value)}</span>"
        for name, value in headlines.items()
    )
    lines = [
        f'<details class="ledger-row {_style(verdict)}" id="{anchor(claim.id)}" '
        f'data-verdict="{verdict}" data-chapter="{chapter}">',
        f"<summary>{badge(verdict)}<span>{escape(claim.text)}</span>"
        f'<span class="tellings">{shown}</span></summary>',
        '<div class="ledger-body">',
        f'<p class="claim-source">Thesis, {_where(claim)} · '
        f'<a href="{claim.page}.html">Chapter {chapter}</a>, '
        f'<a href="{figure_page}.html#fig-{claim.figure}">its figure</a> · '
        f"<code>{claim.id}</code></p>",
    ]
    if len(evidence.parts) > 1:
        parts = "".join(
            f'<li><b class="finding-{finding.split()[-1]}">{FINDINGS[finding][0]}</b> '
            f"{escape(part)}: {FINDINGS[finding][1]}</li>"
            for part, finding in evidence.parts.items()
        )
        lines.append(f'<ul class="claim-parts">{parts}</ul>')
    if evidence.is_conditional:
        lines.append(f'<p class="claim-holds"><b>Holds:</b> {escape(evidence.holds)}</p>')
    why = evidence.because[:1].upper() + evidence.because[1:]
    lines += [f'<p class="claim-why">{escape(why)}</p>', _numbers(headlines)]
    if evidence.over:
        lines.append(f'<p class="claim-over">Measured over {escape(evidence.over)}</p>')
    others = {name: value for name, value in evidence.numbers.items() if name not in headlines}
    if others:
        summary = "The other number" if len(others) == 1 else f"The other {len(others)} numbers"
        lines.append(f"<details><summary>{summary}</summary>\n{_numbers(others)}\n</details>")
    return "\n".join([*lines, "</div></details>"])


def _numbers(numbers: Mapping[str, float]) -> str:
    rows = "\n".join(
        f"<div><dt>{escape(name)} {_interval(value)}</dt><dd>{significant(value)}</dd></div>"
        for name, value in numbers.items()
    )
    return f'<dl class="claim-numbers">\n{rows}\n</dl>'


def _interval(value: float) -> str:
    return f'<span class="interval">{" to ".join(_bounds(value))}</span>'


_WIDTH, _HEIGHT, _FARTHEST = 110, 14, 20.0  # of an axis in px, and its ends in margins


def _axis(number: Measured) -> str:
    """Draw the interval of a number on the axis of what counts, if it has a place there.

    The axis is logarithmic to either side of 0.
    """
    middle, centre = 0.5 * _WIDTH, 0.5 * _HEIGHT

    def at(margins: float) -> float:
        size = math.log1p(min(abs(margins), _FARTHEST)) / math.log1p(_FARTHEST)
        return middle + math.copysign((middle - 4) * size, margins)

    side, drawing = "", ""
    if number.margin_units:
        lowest, value, highest = number.margin_units
        side = " axis-for" if lowest > 0.0 else " axis-against" if highest < 0.0 else " axis-open"
        drawing = (
            f'<path class="scale" d="M2 {centre:g}H{_WIDTH - 2}M{middle:g} 0V{_HEIGHT}"/>'
            f'<path class="range" d="M{at(lowest):.1f} {centre:g}'
            f'H{max(at(highest), at(lowest) + 1):.1f}"/>'
            f'<circle cx="{at(value):.1f}" cy="{centre:g}" r="3.2"/>'
        )
    size = f'width="{_WIDTH}" height="{_HEIGHT}"'
    return f'<svg class="axis{side}" {size} aria-hidden="true">{drawing}</svg>'
