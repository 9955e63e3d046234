"""The ledger's tables say what the registry and the evidence say."""

import re

import pytest

from d2d.study import ledger
from d2d.study.claims import Claim, Evidence
from d2d.study.figures import ThesisFigure

EVIDENCE = {
    "a": Evidence("confirmed", "it is so.", {"ratio": 1.23456, "other": 2.0}),
    "b": Evidence("refuted", "it is not.", {"steps": 6080.0}),
}
CLAIMS = (
    Claim("a", "4.4", "A.", lambda: EVIDENCE["a"], "confirmed", "outlier-cost", ("ratio",)),
    Claim("b", "6.3", "B.", lambda: EVIDENCE["b"], "refuted", "all-scenes", ("steps",), "Never."),
)


def test_count_is_of_the_verdicts_given() -> None:
    """Breaks if a count is typed, or a verdict without claims is left out."""
    assert ledger.count(CLAIMS) == "2 claims: 1 confirmed, 0 qualified, 1 refuted"


def test_each_claim_is_a_row_with_verdict_number_place_and_reason() -> None:
    """Breaks if a row tells another claim's evidence, or a claim that fails hides when it holds."""
    head, rule, first, second = ledger.claims_table(CLAIMS, EVIDENCE).splitlines()
    assert head.count("|") == rule.count("|") == first.count("|") == second.count("|") == 5
    assert "✓ confirmed" in first
    assert "**1.23** ratio" in first
    assert "other" not in first
    assert "**6080** steps" in second
    assert "[chapter 4b](04b_outliers_and_clusters_1d.ipynb), [figure](#fig-outlier-cost)" in first
    assert first.endswith("| It is so. |")
    assert "✗ refuted" in second
    assert second.endswith("| **Holds:** Never.<br>**Why:** It is not. |")


@pytest.mark.parametrize("evidence", [{}, {"a": EVIDENCE["b"], "b": EVIDENCE["b"]}])
def test_a_claim_without_its_evidence_is_refused(evidence: dict[str, Evidence]) -> None:
    """Breaks if the page could show a verdict that its evidence does not have."""
    with pytest.raises(ValueError, match=r"^evidence: a is not on record as confirmed"):
        ledger.claims_table(CLAIMS, evidence)


def test_verdicts_differ_by_sign_and_word() -> None:
    """Breaks if two verdicts can be told apart by their colour alone."""
    shown = {re.sub("<[^>]*>", "", ledger.badge(verdict)) for verdict in ledger.SIGNS}
    assert len({text.split()[0] for text in shown}) == len({text.split()[1] for text in shown}) == 3


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
        "| Table 5.1 | steps | [chapter 5, optimizer-steps](#fig-optimizer-steps) |",
    ]
