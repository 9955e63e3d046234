"""The tables of chapters 9 and 10 hold the runs that they are said to hold."""

import pytest

from d2d.study import scenarios
from d2d.study.plane.evaluation import COSTS, SUMMING, at_truth, evaluated
from d2d.study.plane.tables import credibility_table, summary, summary_table


def test_the_summary_has_a_row_for_every_scene_and_cost() -> None:
    """Breaks if a condition is left out or two columns change places."""
    rows = summary(scenarios.ALL)
    assert rows.scene[::3].tolist() == [
        "overlapped", "outliers", "clusters", "both, A", "both, B"
    ]  # fmt: skip
    assert rows.cost[:3].tolist() == ["sum", "likelihood", "robust likelihood"]
    result = evaluated(scenarios.OVERLAPPED, SUMMING)
    assert rows.from_truth[0] == at_truth(result.errors).mean()
    assert rows.inclination[0] == result.credibility.inclination
    last = summary_table(rows, "All.").rows[0][-1]
    assert last == f"{result.credibility.inclination:+.2f}"


def test_the_verdict_on_an_anees_is_that_of_its_region() -> None:
    shown = credibility_table(scenarios.OVERLAPPED)
    low, high = (float(word) for word in shown.caption.split() if word[:2] in ("0.", "1."))
    for cost, row in zip(COSTS.values(), shown.rows, strict=True):
        anees = evaluated(scenarios.OVERLAPPED, cost).credibility.anees
        assert float(row[1]) == pytest.approx(anees, abs=1e-3)
        assert row[2] == ("yes" if low < anees < high else "no")
