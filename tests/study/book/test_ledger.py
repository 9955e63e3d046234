"""The ledger, its tables and the pages' last lines say what is on record, as text and as HTML."""

import re
from html import unescape
from pathlib import Path

import pytest

from d2d.study.book.claim import Claim, Evidence
from d2d.study.book.ledger import (
    LEDGER,
    SIGNS,
    badge,
    count_verdicts,
    ledger,
    page_claims,
)
from d2d.study.book.measured import Measured
from d2d.study.claims import CLAIMS, claims_on

CHAPTERS = Path(__file__).resolve().parents[3] / "chapters"
RATIO = Measured(1.23456, 1.1, 2.0, True, (-2.0, -1.0, 0.5))
NUMBERS = {"steps": 6080.0, "ratio < 2": RATIO, "slope": -0.5}
PARTS = {"the one": "holds if", "the other": "fails"}
RECORD = {
    "a": Evidence({"it is": "holds"}, "it is so.", NUMBERS, "Not said.", "9 draws"),
    "b": Evidence(PARTS, f"it is {'very ' * 40}wrong.", {"ratio": RATIO}, "Never.", "a drive"),
}
TWO = [
    Claim("a", "4.4", "12", "A is right.", "outlier-cost", lambda: RECORD["a"]),
    Claim("b", "6.3", "34, 56", "B is wrong.", "all-scenes", lambda: RECORD["b"]),
]


def read(html: str) -> str:
    """What a reader of the HTML sees."""
    return " ".join(unescape(re.sub("<[^>]*>", " ", html)).replace("−", "-").split())


@pytest.fixture
def rows():
    """The two rows of the ledger, as HTML."""
    return ledger(TWO, RECORD)._repr_html_().split('<details class="ledger-row')[1:]


def test_row_unfolds_to_all_that_is_on_record(rows):
    """Breaks if a reader sees other numbers than those that are compared, not the headlines first,
    or a condition of a claim that is confirmed.
    """
    line, body = rows[0].split("</summary>", 1)
    assert read(line).endswith("✓ confirmed A is right. 1.23 1.1 to 2")
    shown = read(body)
    numbers = "ratio < 2 1.1 to 2 1.23 Measured over 9 draws The other 2 numbers steps exact 6080"
    assert f"It is so. {numbers} slope exact -0.5" in shown
    assert "Not said." not in shown
    assert "≈ the one: holds under a condition ✗ the other: fails Holds: Never." in read(rows[1])
    assert "<details>" not in rows[1]
    assert str(ledger(TWO, RECORD)).splitlines() == [
        "confirmed     a (4.4): ratio < 2 1.23 [1.1, 2]",
        "wrong in part b (6.3): ratio 1.23 [1.1, 2]",
    ]


def test_page_ends_with_its_claims_by_verdict():
    """Breaks if a page is told another page's claims, or none are told of a claim."""
    told = page_claims("05_outliers_and_clusters_1d", TWO, RECORD)
    assert str(told) == "1 confirmed: a"
    assert read(told._repr_markdown_()).endswith("1 ✓ confirmed : a .")
    assert f'href="{LEDGER}#claim-a"' in told._repr_markdown_()
    assert page_claims("results", TWO, RECORD).verdicts == {}
    ends = [claims_on(page) for page in {claim.page for claim in CLAIMS.values()}]
    assert sum(len(ids) for end in ends for ids in end.verdicts.values()) == len(CLAIMS)
    for page in {claim.page for claim in CLAIMS.values()}:
        assert f'claims_on(\\"{page}\\")' in (CHAPTERS / f"{page}.ipynb").read_text("utf-8")


def test_verdicts_are_counted():
    """Breaks if a count is typed, or a verdict without claims is left out."""
    counted = "2 claims: 1 confirmed, 0 conditional, 1 wrong in part, 0 refuted"
    assert count_verdicts(RECORD) == counted
    assert len({read(badge(verdict)).split()[0] for verdict in SIGNS}) == 4  # not by colour alone
