"""The tables of the scenes in the plane: errors, credibility, and everything in one."""

from collections.abc import Iterable

import numpy as np
import pandas as pd

from d2d.study.book.grammar import COSTS as LOOKS
from d2d.study.book.measured import rms_of
from d2d.study.book.table import Table, table
from d2d.study.plane.evaluation import COSTS, at_truth, distance_and_rotation, evaluated, rms
from d2d.study.plane.scenarios import Scenario

ANEES, NCI, INCLINATION = ("ANEES", "", ".3f"), ("NCI", "dB", ".2f"), ("I²", "dB", "+.2f")


def error_table(scenario: Scenario) -> Table:
    """Where 1000 runs of each cost end, started at the truth and at zero."""
    rows = []
    for start, words in (("truth", "the truth"), ("zero", "zero")):
        for name, cost in COSTS.items():
            errors = evaluated(scenario, cost, start).errors
            distance, turn = distance_and_rotation(errors)
            share = float(at_truth(errors).mean())
            rows.append((words, LOOKS[name].name, share, rms(distance), np.rad2deg(rms(turn))))
    measures = [("at the truth", "", ".1%"), ("RMSE", "m", ".3f"), ("RMSE", "deg", ".2f")]
    caption = "Where 1000 runs end, and the root mean square of their errors."
    return table(rows, ["started at", "cost", *measures], caption)


def credibility_table(scenario: Scenario) -> Table:
    """The indices of 1000 runs of each cost, started at the truth, with the region of the ANEES."""
    indices = {LOOKS[name].name: evaluated(scenario, c).credibility for name, c in COSTS.items()}
    low, high = next(iter(indices.values())).bounds
    return table(
        {name: (c.anees, c.consistent, c.nci, c.inclination) for name, c in indices.items()},
        ["cost", ANEES, "inside its region", NCI, INCLINATION],
        "Credibility of 1000 runs, started at the truth. The ANEES of a credible estimator lies "
        f"between {low:.3f} and {high:.3f} in 95 of 100 such experiments.",
    )


def short_name(scene: str) -> str:
    """The name of a scene in a table with many columns."""
    return scene.replace("outliers and clusters", "both,")


def summary(scenarios: Iterable[Scenario]) -> pd.DataFrame:
    """Evaluate each scenario with each cost: a row for 1000 runs from the truth and from zero.

    ``from_truth`` and ``from_zero`` are the shares of runs that end at the truth; the RMSE (m) of
    the translation and the indices are those of the runs from the truth.
    """
    rows = []
    for scenario in scenarios:
        for name, cost in COSTS.items():
            good, zero = evaluated(scenario, cost), evaluated(scenario, cost, "zero")
            rmse = rms_of(distance_and_rotation(good.errors)[0])
            shares = (float(at_truth(runs.errors).mean()) for runs in (good, zero))
            indices = good.credibility.anees, good.credibility.nci, good.credibility.inclination
            names = short_name(scenario.name), LOOKS[name].name
            rows.append((*names, *shares, float(rmse), rmse.between(".2f"), *indices))
    measures = ["from_truth", "from_zero", "rmse", "interval", "anees", "nci", "inclination"]
    return pd.DataFrame(rows, columns=["scene", "cost", *measures])


def summary_table(rows: pd.DataFrame, caption: str) -> Table:
    """Set a `summary` as a table."""
    shares = ("from truth", "", ".1%"), ("from zero", "", ".1%")
    rmse = ("RMSE", "m", ".3f"), ("95 %", "m")
    return table(rows, ["scene", "cost", *shares, *rmse, ANEES, NCI, INCLINATION], caption)
