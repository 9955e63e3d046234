"""The tables of the ledger: every claim with its verdict, every figure of the thesis with ours.

The tables are MyST Markdown: ``[text](#fig-x)`` leads to the figure of that label, and a build of
the book fails where there is none.
"""

from collections.abc import Iterable, Mapping

from d2d.study.claims.base import Claim, Evidence, Verdict
from d2d.study.figures import ThesisFigure, page

SIGNS: dict[Verdict, str] = {"confirmed": "✓", "qualified": "≈", "refuted": "✗"}
"""A sign and the word beside it, so that no verdict is told by its colour alone."""


def badge(verdict: Verdict) -> str:
    """A verdict as HTML; ``_static/ledger.css`` colours it."""
    return f'<span class="verdict verdict-{verdict}">{SIGNS[verdict]} {verdict}</span>'


def count(claims: Iterable[Claim]) -> str:
    """How many claims there are, and how many of each verdict, in one line."""
    verdicts = [claim.verdict for claim in claims]
    each = ", ".join(f"{verdicts.count(verdict)} {verdict}" for verdict in SIGNS)
    return f"{len(verdicts)} claims: {each}"


def claims_table(claims: Iterable[Claim], evidence: Mapping[str, Evidence]) -> str:
    """One row for each claim: its verdict, the numbers that tell the most, where it is shown, why.

    Raises
    ------
    ValueError
        If a claim has no evidence, or its verdict is not that of the evidence.
    """
    rows = ["| claim | verdict | measured | why |", "|" + " --- |" * 4]
    for claim in claims:
        found = evidence.get(claim.id)
        if found is None or found.verdict != claim.verdict:
            raise ValueError(f"evidence: {claim.id} is not on record as {claim.verdict}")
        where = page(claim.section)
        shown = f"[chapter {_number(where)}]({where}.ipynb), [figure](#fig-{claim.figure})"
        numbers = "<br>".join(
            f"**{_significant(found.numbers[name])}** {name}" for name in claim.telling
        )
        why = found.because[0].upper() + found.because[1:]
        if claim.holds:
            why = f"**Holds:** {claim.holds}<br>**Why:** {why}"
        rows.append(
            f"| {claim.section} {claim.claim}<br>`{claim.id}`<br>{shown} "
            f"| {badge(claim.verdict)} | {numbers} | {why} |"
        )
    return "\n".join(rows)


def figures_table(figures: Iterable[ThesisFigure]) -> str:
    """One row for each figure of the thesis: its number, what it shows, and where ours is."""
    rows = ["| thesis | what it shows | ours |", "|" + " --- |" * 3]
    for each in figures:
        kind = "" if each.number.startswith("Table") else "Figure "
        rows.append(
            f"| {kind}{each.number} | {each.shows} "
            f"| [chapter {_number(each.page)}, {each.id}](#fig-{each.id}) |"
        )
    return "\n".join(rows)


def _significant(value: float) -> str:
    """Three digits, or a whole number as it is."""
    return f"{value:.0f}" if float(value).is_integer() else f"{value:.3g}"


def _number(page: str) -> str:
    """The number of a page, as its file name has it: ``04a_...`` is 4a."""
    return page.split("_")[0].lstrip("0")
