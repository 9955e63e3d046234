"""Tables and drawings of the covariances on the road."""

from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from d2d.study.book.drawing import intervals
from d2d.study.book.grammar import COVARIANCES, TRUTH
from d2d.study.book.style import PAGE, write_out_ticks
from d2d.study.book.table import Column, Table, table
from d2d.study.drives.errors import NAMES, UNITS


def score_table(judged: Mapping[str, Mapping[str, Any]], caption: str = "") -> Table:
    """ANEES, share in the 95 % region, whitened squares, log score: a row for each model.

    The drives have a column if there are several.
    """
    rows = [
        (where, name, found["anees"], found["inside"], *found["whitened"], found["log_score"])
        for where, models in judged.items()
        for name, found in models.items()
    ]
    columns: list[Column] = ["drive", "covariance", ("ANEES", "", ".2f"), ("inside", "", ".0%")]
    columns += [(name, "", ".2f") for name in (*NAMES, "log score")]
    first = 0 if len(judged) > 1 else 1
    return table([row[first:] for row in rows], columns[first:], caption)


def error_table(judged: Mapping[str, Mapping[str, Any]], caption: str = "") -> Table:
    """RMSE and mean errors of the estimates with a budget, a row for each drive."""
    found = {where: models["noise and budget"] for where, models in judged.items()}
    rows = {w: (*each["rmse"], *each["mean"], each["estimates"]) for w, each in found.items()}
    numbers = [
        (*column, spec) for spec in (".3f", "+.3f") for column in zip(NAMES, UNITS, strict=True)
    ]
    columns: list[Column] = ["drive", *numbers, "estimates"]
    return table(rows, columns, caption, groups={"RMSE": 3, "mean error": 3, "": 1})


def draw_scores(judged: Mapping[str, Mapping[str, Any]], wide: bool = False) -> Figure:
    """ANEES with its interval, and the share inside the 95 % region, of every model and drive."""
    size = (PAGE, 0.9 + 0.36 * len(judged)) if wide else (5.5, 1.3 + 0.55 * len(judged))
    figure, axes = plt.subplots(1, 2, sharey=True, figsize=size)
    places = np.arange(len(judged))[::-1]
    for ax, place in product(axes, places[::2]):
        ax.axhspan(place - 0.5, place + 0.5, color="0.95", lw=0)  # which marks are of one drive
    for k, name in enumerate(COVARIANCES):
        offset = 0.22 * (1 - k)
        found = [models[name] for models in judged.values()]
        anees = np.array([each["anees"] for each in found])
        bounds = np.array([each["anees_interval"] for each in found])
        marks = COVARIANCES[name].marks
        intervals(axes[0], anees, bounds, places + offset, **marks)
        inside = [100.0 * each["inside"] for each in found]
        axes[1].plot(inside, places + offset, **marks, ms=6)
    axes[0].set_xscale("log")
    write_out_ticks(axes[0].xaxis, (0.5, 1, 2, 5, 10, 20))
    axes[0].axvline(1.0, **TRUTH)
    axes[1].axvline(95.0, **TRUTH)
    axes[0].set(xlabel="ANEES", title="(a) 1 is right", yticks=places, yticklabels=list(judged))
    axes[1].set(xlabel="in the 95 % region (%)", xlim=(0, 102), title="(b) 95 % is right")
    handles = axes[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=3 if wide else 2)
    return figure
