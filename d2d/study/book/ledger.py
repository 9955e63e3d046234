"""The tables of the ledger: every claim with its verdict, every figure of the thesis with ours.

The tables are MyST Markdown: ``[text](#fig-x)`` links to the figure with that label, and the build
of the book fails if there is none.
"""

from collections.abc import Iterable, Mapping

from d2d.study.book.card import SIGNS, anchor, badge, told
from d2d.study.book.claim import Claim, Evidence, Verdict
from d2d.study.book.thesis_figures import ThesisFigure, page_of
from d2d.study.book.typography import typeset


def count_verdicts(record: Mapping[str, Evidence]) -> str:
    """How many claims there are, and how many of each verdict, in one line."""
    counts = _counts(record.values())
    listed = ", ".join(f"{number} {verdict}" for verdict, number in counts.items())
    return f"{len(record)} claims: {listed}"


def verdicts_table(claims: Iterable[Claim], record: Mapping[str, Evidence]) -> str:
    """A table of the number of claims with each verdict, by page, with a last row for all pages."""
    by_page: dict[str, list[Evidence]] = {}
    for claim in claims:
        by_page.setdefault(page_of(claim.section, claim.id), []).append(record[claim.id])
    lines = [f"| chapter | claims | {' | '.join(SIGNS)} |", "|" + " --- |" * (2 + len(SIGNS))]
    in_order = sorted(by_page.items())  # the thesis tells of optimisers (5b) before chapter 5
    linked = {f"[{_chapter(page)}]({page}.ipynb)": listed for page, listed in in_order}
    for name, evidence in (linked | {"all": list(record.values())}).items():
        cells = (name, len(evidence), *_counts(evidence).values())
        lines.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(lines)


def claims_table(claims: Iterable[Claim], record: Mapping[str, Evidence]) -> str:
    """A table with one row for each claim: its verdict, its telling numbers, its figure, and why.

    Raises
    ------
    ValueError
        If a claim is not on record.
    """
    lines = ["| claim | verdict | measured | why |", "|" + " --- |" * 4]
    for claim in claims:
        evidence = record.get(claim.id)
        if evidence is None:
            raise ValueError(f"record: has no evidence for {claim.id}")
        page = page_of(claim.section, claim.id)
        shown = f"[chapter {_chapter(page)}]({page}.ipynb), [figure](#fig-{claim.figure})"
        numbers = "<br>".join(
            typeset(f"{told(evidence.numbers[name], '**')} {name}") for name in claim.telling
        )
        why = typeset(evidence.because[0].upper() + evidence.because[1:])
        if evidence.verdict != "confirmed":
            why = f"**Holds:** {typeset(evidence.holds)}<br>**Why:** {why}"
        lines.append(
            f'| <span id="{anchor(claim.id)}"></span>{claim.section} {typeset(claim.text)}'
            f"<br>`{claim.id}`<br>{shown} "
            f"| {badge(evidence.verdict)} | {numbers}<br>over {typeset(evidence.over)} | {why} |"
        )
    return "\n".join(lines)


def figures_table(figures: Iterable[ThesisFigure]) -> str:
    """A table with one row per figure of the thesis: its number, what it shows, where ours is."""
    lines = ["| thesis | what it shows | ours |", "|" + " --- |" * 3]
    for figure in figures:
        kind = "" if figure.number.startswith("Table") else "Figure "
        lines.append(
            f"| {kind}{figure.number} | {figure.shows} "
            f"| [chapter {_chapter(figure.page)}, {figure.id}](#fig-{figure.id}) |"
        )
    return "\n".join(lines)


def _counts(evidence: Iterable[Evidence]) -> dict[Verdict, int]:
    verdicts = [item.verdict for item in evidence]
    return {verdict: verdicts.count(verdict) for verdict in SIGNS}


def _chapter(page: str) -> str:
    """The chapter number in a page's file name: 4a for ``04a_...``."""
    return page.split("_")[0].lstrip("0")
