"""The tables of chapter 10 hold the runs that they are said to hold."""

import pytest

from d2d.study import scenarios
from d2d.study.plane.evaluation import COSTS, SUMMING, at_truth, evaluated, summary
from d2d.study.plane.tables import credibility_table, short_name, summary_table


def test_the_summary_has_a_row_for_every_scene_and_cost() -> None:
    """Breaks if a condition is left out or two columns change places."""
    shown = summary_table(summary(scenarios.ALL), "All.")
    assert shown.caption == "All."
    assert [row[0] for row in shown.rows[::3]] == [
        short_name(scene.name) for scene in scenarios.ALL
    ]
    assert [row[1] for row in shown.rows[:3]] == ["sum", "likelihood", "robust likelihood"]
    headings = [name for name, _ in shown.header]
    sum_row = dict(zip(headings, shown.rows[0], strict=True))
    result = evaluated(scenarios.OVERLAPPED, SUMMING)
    assert sum_row["from truth"] == f"{at_truth(result.errors).mean():.1%}"
    assert sum_row["I²"] == f"{result.credibility.inclination:+.2f}"


def test_the_verdict_on_an_anees_is_that_of_its_region() -> None:
    shown = credibility_table(scenarios.OVERLAPPED)
    low, high = (float(word) for word in shown.caption.split() if word[:2] in ("0.", "1."))
    for cost, row in zip(COSTS.values(), shown.rows, strict=True):
        anees = evaluated(scenarios.OVERLAPPED, cost).credibility.anees
        assert float(row[1]) == pytest.approx(anees, abs=1e-3)
        assert row[2] == ("yes" if low < anees < high else "no")
