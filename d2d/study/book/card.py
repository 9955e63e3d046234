"""Cards that show a claim of the thesis with the evidence on record, and the box atop a chapter."""

import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from d2d.study.book.claim import Claim, Evidence, Verdict
from d2d.study.book.measured import Measured
from d2d.study.book.table import significant
from d2d.study.book.typography import typeset

SIGNS: dict[Verdict, str] = {"confirmed": "✓", "qualified": "≈", "refuted": "✗"}
"""The sign beside the word of each verdict, so that no verdict is marked by its colour alone."""

LEDGER = "10_claims.html"
"""Beside the page that links to it, because all pages with claims are chapters."""

WIDTH = 88
EXACT = "exact"
"""What is said of a number without an interval, such as a count or the value of a formula."""


def badge(verdict: Verdict) -> str:
    """A verdict as HTML; ``_static/ledger.css`` colours it."""
    return f'<span class="verdict verdict-{verdict}">{SIGNS[verdict]} {verdict}</span>'


def anchor(id: str) -> str:
    """The place of a claim's row in the ledger."""
    return f"claim-{id}"


def ledger_link(id: str, text: str) -> str:
    """A link, as HTML, from any chapter to a claim's row in the ledger."""
    return f'<a href="{LEDGER}#{anchor(id)}">{text}</a>'


def told(value: float, mark: str = "") -> str:
    """A number between marks with its 95 % interval, or the word that it needs none."""
    return f"{mark}{significant(value)}{mark} [{', '.join(_bounds(value)) or EXACT}]"


def _bounds(value: float) -> tuple[str, ...]:
    if not isinstance(value, Measured):
        return ()
    return significant(value.low), significant(value.high)


@dataclass(frozen=True)
class Cards:
    """Claims with their evidence, one card each, which show themselves.

    Attributes
    ----------
    shown : tuple of (Claim, Evidence)
    """

    shown: tuple[tuple[Claim, Evidence], ...]

    def __str__(self) -> str:
        """Claim, verdict, reason and all numbers, wrapped."""
        return "\n\n".join(_text(claim, evidence) for claim, evidence in self.shown)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        """A card each: verdict, claim, reason, telling numbers, and the others folded away."""
        return "\n".join(_html(claim, evidence) for claim, evidence in self.shown)


def cards(claims: Iterable[Claim], record: Mapping[str, Evidence]) -> Cards:
    """The cards of claims.

    Raises
    ------
    ValueError
        If a claim is not on record.
    """
    listed = tuple(claims)
    for claim in listed:
        if claim.id not in record:
            raise ValueError(f"record: has no evidence for {claim.id}")
    return Cards(tuple((claim, record[claim.id]) for claim in listed))


def _text(claim: Claim, evidence: Evidence) -> str:
    sentences = [
        f"[{claim.id}] {claim.text} (thesis {claim.section})",
        *([f"holds: {evidence.holds}"] if _conditional(evidence) else []),
        f"{evidence.verdict}: {evidence.because}",
        *([f"measured over {evidence.over}"] if evidence.over else []),
    ]
    numbers = [f"  {name}: {told(value)}" for name, value in evidence.numbers.items()]
    return "\n".join([*(textwrap.fill(sentence, WIDTH) for sentence in sentences), *numbers])


def _html(claim: Claim, evidence: Evidence) -> str:
    telling = {name: evidence.numbers[name] for name in claim.telling}
    others = {name: value for name, value in evidence.numbers.items() if name not in telling}
    holds = f'<p class="claim-holds"><b>Holds:</b> {typeset(evidence.holds)}</p>\n'
    over = f'<p class="claim-over">Measured over {typeset(evidence.over)}</p>\n'
    summary = "The other number" if len(others) == 1 else f"The other {len(others)} numbers"
    folded = f"<details><summary>{summary}</summary>\n{_numbers(others)}\n</details>\n"
    return (
        f'<div class="claim claim-{evidence.verdict}" role="group" aria-label="Claim {claim.id}">\n'
        f'<p class="claim-head">{badge(evidence.verdict)} '
        f'<span class="claim-source">thesis, section {claim.section} · '
        f"{ledger_link(claim.id, f'<code>{claim.id}</code> in the ledger')}</span></p>\n"
        f'<p class="claim-text">{typeset(claim.text)}</p>\n'
        f"{holds if _conditional(evidence) else ''}"
        f'<p class="claim-why">{typeset(_capital(evidence.because))}</p>\n'
        f"{_numbers(telling)}\n"
        f"{over if evidence.over else ''}"
        f"{folded if others else ''}"
        "</div>"
    )


def _numbers(numbers: Mapping[str, float]) -> str:
    rows = "\n".join(
        f"<div><dt>{typeset(name)} {_between(value)}</dt>"
        f"<dd>{typeset(significant(value))}</dd></div>"
        for name, value in numbers.items()
    )
    return f'<dl class="claim-numbers">\n{rows}\n</dl>'


def _between(value: float) -> str:
    bounds = " to ".join(map(typeset, _bounds(value))) or EXACT
    return f'<span class="interval">{bounds}</span>'


def _conditional(evidence: Evidence) -> bool:
    return evidence.verdict != "confirmed" and bool(evidence.holds)


def _capital(sentence: str) -> str:
    return sentence[:1].upper() + sentence[1:]
