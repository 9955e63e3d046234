"""The tables of the scenes in the plane: errors, credibility, and everything in one."""

from collections.abc import Iterable

import numpy as np

from d2d.study.book.grammar import COSTS as LOOKS
from d2d.study.book.table import Table, table
from d2d.study.plane.evaluation import COSTS, Row, at_truth, distance_and_rotation, evaluated, rms
from d2d.study.plane.scenarios import Scenario


def error_table(scenario: Scenario) -> Table:
    """Where 1000 runs of each cost end, started at the truth and at zero."""
    rows = []
    for start, place in (("truth", "the truth"), ("zero", "zero")):
        for name, cost in COSTS.items():
            errors = evaluated(scenario, cost, start).errors
            distance, turn = distance_and_rotation(errors)
            share = float(at_truth(errors).mean())
            rows.append((place, LOOKS[name].name, share, rms(distance), np.rad2deg(rms(turn))))
    return table(
        rows,
        [
            "started at",
            "cost",
            ("at the truth", "", ".1%"),
            ("RMSE", "m", ".3f"),
            ("RMSE", "deg", ".2f"),
        ],
        "Where 1000 runs end, and the root mean square of their errors.",
    )


def credibility_table(scenario: Scenario) -> Table:
    """The indices of 1000 runs of each cost, started at the truth, with the region of the ANEES."""
    judged = {LOOKS[name].name: evaluated(scenario, c).credibility for name, c in COSTS.items()}
    low, high = next(iter(judged.values())).bounds
    return table(
        {name: (c.anees, c.consistent, c.nci, c.inclination) for name, c in judged.items()},
        [
            "cost",
            ("ANEES", "", ".3f"),
            "inside its region",
            ("NCI", "dB", ".2f"),
            ("I²", "dB", "+.2f"),
        ],
        "Credibility of 1000 runs, started at the truth. The ANEES of a credible estimator lies "
        f"between {low:.3f} and {high:.3f} in 95 of 100 such experiments.",
    )


def short_name(scene: str) -> str:
    """The name of a scene in a table with many columns."""
    return scene.replace("outliers and clusters", "both,")


def summary_table(rows: Iterable[Row], caption: str) -> Table:
    """Every scene with every cost: a row for each."""
    return table(
        [
            (
                short_name(row.scenario),
                LOOKS[row.cost].name,
                row.from_truth,
                row.from_zero,
                row.rmse,
                row.rmse.between(".2f"),
                row.credibility.anees,
                row.credibility.nci,
                row.credibility.inclination,
            )
            for row in rows
        ],
        [
            "scene",
            "cost",
            ("from truth", "", ".1%"),
            ("from zero", "", ".1%"),
            ("RMSE", "m", ".3f"),
            ("95 %", "m"),
            ("ANEES", "", ".3f"),
            ("NCI", "dB", ".2f"),
            ("I²", "dB", "+.2f"),
        ],
        caption,
    )
