"""The ledger, its tables and the pages' last lines say what is on record, as text and as HTML."""

import re
from html import unescape
from pathlib import Path

from d2d.study.book.claim import Claim, Evidence
from d2d.study.book.ledger import (
    LEDGER,
    SIGNS,
    anchor,
    badge,
    count_verdicts,
    figures_table,
    in_words,
    ledger,
    page_claims,
    verdicts_table,
)
from d2d.study.book.measured import Measured
from d2d.study.book.thesis_figures import ThesisFigure
from d2d.study.claims import CLAIMS, claims_on

CHAPTERS = Path(__file__).resolve().parents[3] / "chapters"
RATIO = Measured(1.23456, 1.1, 2.0, True, (-2.0, -1.0, 0.5))
NUMBERS = {"steps": 6080.0, "ratio < 2": RATIO, "slope": -0.5}
RECORD = {
    "a": Evidence({"it is": "holds"}, "it is so.", NUMBERS, "Not said.", "9 draws"),
    "b": Evidence(
        {"the one": "holds if", "the other": "fails"},
        f"it is {'very ' * 40}wrong.",
        {"ratio": RATIO},
        "Never.",
        "a drive",
    ),
}
CLAIMS_OF_TWO = [
    Claim("a", "4.4", "12", "A is right.", "outlier-cost", lambda: RECORD["a"]),
    Claim("b", "6.3", "34, 56", "B is wrong.", "all-scenes", lambda: RECORD["b"]),
]


def read(html: str) -> str:
    """What a reader of the HTML sees."""
    return unescape(re.sub("<[^>]*>", " ", html)).replace("−", "-")


def test_verdicts_differ_by_sign_and_word():
    """Breaks if two verdicts can be told apart by their colour alone."""
    shown = {re.sub("<[^>]*>", "", badge(verdict)) for verdict in SIGNS}
    assert len({text.split()[0] for text in shown}) == len({text.split()[1] for text in shown}) == 4


def test_a_claim_in_words_is_wrapped_and_complete():
    """Breaks if a reason runs off the page, or nbval no longer sees a number or its interval."""
    first, second = (in_words(claim, RECORD[claim.id]) for claim in CLAIMS_OF_TWO)
    assert max(map(len, [*first.splitlines(), *second.splitlines()])) <= 88
    assert first.splitlines() == [
        "[a] A is right. (thesis, section 4.4, line 12)",
        "confirmed: it is so.",
        "measured over 9 draws",
        "  steps: 6080 [exact]",
        "  ratio < 2: 1.23 [1.1, 2]",
        "  slope: -0.5 [exact]",
    ]
    assert "section 6.3, lines 34, 56" in second
    assert (
        "the one: holds under a condition; the other: fails\nholds: Never.\nwrong in part: "
        in second
    )


def test_a_row_unfolds_to_what_its_text_says():
    """Breaks if a reader sees other numbers than those that are compared, or not the telling first.

    A claim that is confirmed holds without a condition, and has a row without one.
    """
    first, second = (
        ledger(CLAIMS_OF_TWO, RECORD)._repr_html_().split('<details class="ledger-row')[1:]
    )
    seen = " ".join(read(first + second).split())
    for shown in ("✓ confirmed", "A is right.", "It is so.", "Never.", "Measured over 9 draws"):
        assert shown in seen
    assert "≈ the one: holds under a condition ✗ the other: fails Holds: Never." in seen
    for shown in ("ratio < 2 1.1 to 2 1.23", "steps exact 6080", "slope exact -0.5"):
        assert shown in seen
    assert "Not said." not in first
    body = first.split("</summary>", 1)[1]
    assert body.index("ratio &lt; 2") < body.index("<details>") < body.index("steps")
    assert "<details>" not in second


def test_each_row_has_its_address():
    """Breaks if a link to a claim, and the ledger's rows, are named differently."""
    rows = ledger(CLAIMS_OF_TWO, RECORD)._repr_html_()
    assert re.findall(r'<details class="ledger-row[^>]* id="([^"]*)"', rows) == [*map(anchor, "ab")]


def test_a_page_ends_with_its_claims_by_verdict():
    told = page_claims("04_outliers_and_clusters_1d", CLAIMS_OF_TWO, RECORD)
    assert str(told) == "1 confirmed: a"
    assert "1 ✓ confirmed : a ." in " ".join(read(told._repr_markdown_()).split())
    assert f'href="{LEDGER}#{anchor("a")}"' in told._repr_markdown_()
    assert page_claims("01_motivation", CLAIMS_OF_TWO, RECORD).verdicts == {}


def test_each_claim_is_told_on_one_page():
    pages = {claim.page for claim in CLAIMS.values()}
    assert sum(len(ids) for page in pages for ids in claims_on(page).verdicts.values()) == len(
        CLAIMS
    )
    for page in pages:
        assert f'claims_on(\\"{page}\\")' in (CHAPTERS / f"{page}.ipynb").read_text("utf-8")


def test_verdicts_are_counted_in_all_and_by_page():
    """Breaks if a count is typed, a verdict without claims is left out, or a page is another."""
    assert (
        count_verdicts(RECORD) == "2 claims: 1 confirmed, 0 conditional, 1 wrong in part, 0 refuted"
    )
    assert verdicts_table(CLAIMS_OF_TWO, RECORD).splitlines()[2:] == [
        "| [4](04_outliers_and_clusters_1d.ipynb) | 1 | 1 | 0 | 0 | 0 |",
        "| [10](10_credibility_2d.ipynb) | 1 | 0 | 0 | 1 | 0 |",
        "| all | 2 | 1 | 0 | 1 | 0 |",
    ]


def test_each_claim_is_a_line_with_verdict_numbers_and_place():
    """Breaks if a line has another claim's evidence, or leads elsewhere."""
    html = ledger(CLAIMS_OF_TWO, RECORD)._repr_html_()
    first, second = html.split('<details class="ledger-row')[1:]
    summary = " ".join(read(first.split("</summary>")[0]).split())
    assert summary.endswith("✓ confirmed A is right. 1.23 1.1 to 2")
    assert 'data-verdict="wrong in part" data-chapter="10"' in second
    assert '<a href="04_outliers_and_clusters_1d.html">Chapter 4' in first
    assert '<a href="11_outliers_and_clusters_2d.html#fig-outlier-cost">' in first
    assert "steps" in first.split("</summary>", 1)[1]
    assert str(ledger(CLAIMS_OF_TWO, RECORD)).splitlines() == [
        "confirmed     a (4.4): ratio < 2 1.23 [1.1, 2]",
        "wrong in part b (6.3): ratio 1.23 [1.1, 2]",
    ]


def test_the_map_has_each_claim_in_its_chapter():
    shown = ledger(CLAIMS_OF_TWO, RECORD)._repr_html_().split("</ol>")[0]
    assert re.findall(
        r"<li><span>(\w+)</span><a .*? href=\"#claim-(\w)\".*?>(.)</a></li>", shown
    ) == [
        ("4", "a", "✓"),
        ("10", "b", "½"),
    ]


def test_an_interval_is_drawn_where_it_lies():
    """Breaks if an interval across the bound of what counts looks decided."""
    html = ledger(CLAIMS_OF_TWO, RECORD)._repr_html_()
    low, at, high = (
        float(re.search(pattern, html)[1])
        for pattern in (
            r'class="range" d="M([\d.]+)',
            r'cx="([\d.]+)"',
            r'class="range" .*?H([\d.]+)',
        )
    )
    middle = float(re.search(r"M([\d.]+) 0V", html)[1])
    assert "axis-open" in html
    assert low < at < middle < high


def test_each_figure_leads_to_ours():
    """Breaks if a link lacks the label's prefix, or a table is called a figure."""
    figures = [
        ThesisFigure("overall-noisy", "4.6", "4.2", "a surface"),
        ThesisFigure("optimizer-steps", "Table 5.1", "5.1", "steps"),
    ]
    assert figures_table(figures).splitlines()[2:] == [
        "| Figure 4.6 | a surface | [chapter 3, overall-noisy](#fig-overall-noisy) |",
        "| Table 5.1 | steps | [chapter 6, optimizer-steps](#fig-optimizer-steps) |",
    ]
