"""The ledger's tables say what the registry and the evidence say."""

import pytest

from d2d.study.book import ledger
from d2d.study.book.claim import Claim, Evidence
from d2d.study.book.measured import Measured
from d2d.study.book.thesis_figures import ThesisFigure

EVIDENCE = {
    "a": Evidence(
        "confirmed", "it is so.", {"ratio": Measured(1.23456, 1.1, 2), "other": 2.0}, over="9 draws"
    ),
    "b": Evidence("refuted", "it is not.", {"steps": 6080.0}, "Never.", "one drive"),
}
CLAIMS = (
    Claim("a", "4.4", "A.", "outlier-cost", ("ratio",), lambda: EVIDENCE["a"]),
    Claim("b", "6.3", "B.", "all-scenes", ("steps",), lambda: EVIDENCE["b"]),
)


def test_count_is_of_the_verdicts_given() -> None:
    """Breaks if a count is typed, or a verdict without claims is left out."""
    assert ledger.count_verdicts(EVIDENCE) == "2 claims: 1 confirmed, 0 qualified, 1 refuted"


def test_each_claim_is_a_row_with_verdict_number_place_and_reason() -> None:
    """Breaks if a row tells another claim's evidence, or a claim that fails hides when it holds."""
    head, rule, first, second = ledger.claims_table(CLAIMS, EVIDENCE).splitlines()
    assert head.count("|") == rule.count("|") == first.count("|") == second.count("|") == 5
    assert "✓ confirmed" in first
    assert '**1.23** <span class="whole">[1.1, 2]</span> ratio<br>over 9 draws' in first
    assert "other" not in first
    assert "**6080** [exact] steps<br>over one drive" in second
    assert "[chapter 4b](04b_outliers_and_clusters_1d.ipynb), [figure](#fig-outlier-cost)" in first
    assert first.startswith('| <span id="claim-a"></span>4.4 A.')
    assert first.endswith("| It is so. |")
    assert "✗ refuted" in second
    assert second.endswith("| **Holds:** Never.<br>**Why:** It is not. |")


def test_a_claim_without_evidence_is_refused() -> None:
    """Breaks if the page could leave out what has not been measured."""
    with pytest.raises(ValueError, match=r"^record: has no evidence for b"):
        ledger.claims_table(CLAIMS, {"a": EVIDENCE["a"]})


def test_verdicts_are_counted_by_page() -> None:
    """Breaks if a claim is counted on another page, or the last row is no sum."""
    rows = ledger.verdicts_table(CLAIMS, EVIDENCE).splitlines()[2:]
    assert rows == [
        "| [4b](04b_outliers_and_clusters_1d.ipynb) | 1 | 1 | 0 | 0 |",
        "| [6](06_credibility_2d.ipynb) | 1 | 0 | 0 | 1 |",
        "| all | 2 | 1 | 0 | 1 |",
    ]


def test_each_figure_leads_to_ours() -> None:
    """Breaks if a link lacks the label's prefix, or a table is called a figure."""
    rows = ledger.figures_table(
        [
            ThesisFigure("overall-noisy", "4.6", "4.2", "a surface"),
            ThesisFigure("optimizer-steps", "Table 5.1", "5.1", "steps"),
        ]
    ).splitlines()[2:]
    assert rows == [
        "| Figure 4.6 | a surface | [chapter 4a, overall-noisy](#fig-overall-noisy) |",
        "| Table 5.1 | steps | [chapter 5b, optimizer-steps](#fig-optimizer-steps) |",
    ]
