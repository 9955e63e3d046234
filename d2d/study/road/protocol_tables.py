"""Tables and chart of the protocol, for page G and chapter 15."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import scipy

from d2d._types import Array
from d2d.radar import ErrorBudget
from d2d.study.book.grammar import COVARIANCES, GREY, OCHRE, SKY, TRUTH
from d2d.study.book.style import headline, letter_panels, use_style, write_out_ticks
from d2d.study.results import results_path
from d2d.study.road.drive import DATA_SETS, Source
from d2d.study.road.markdown import markdown, write_page
from d2d.study.road.protocol import (
    ALL,
    BARE,
    CAUSES,
    CELLS,
    CONSTANT,
    DIRECTIONS,
    EMPTY,
    FACTORS,
    FITTED,
    LEVELS,
    MODELS,
    STORED,
    TRACKS,
    ProtocolResult,
    protocol,
)

PAGE = "road_protocol.md"
# Of the chart: the cells in words, and each model's colour, marker and size.
IN_WORDS = ("all radars", "front radar", "side radar", "40 targets", "15 targets", "a radar silent")
LOOKS = {
    BARE: (*COVARIANCES["inverse Hessian"][1:3], 7),
    EMPTY: (*COVARIANCES["propagated noise"][1:3], 6),
    CONSTANT: (OCHRE, "s", 5),
    FACTORS: (SKY, "D", 5),
    FITTED: (GREY, "o", 5),
    STORED: (*COVARIANCES["noise and budget"][1:3], 9),
}


def mean_with_half(values: Array) -> tuple[float, float]:
    """The mean of several drives and half its 95 % interval by Student's t."""
    half = scipy.stats.t.ppf(0.975, len(values) - 1) * scipy.stats.sem(values)
    return float(values.mean()), float(half)


def over_drives(values: Array, digits: int) -> str:
    """Two drives one beside the other, more as their mean with its interval by Student's t."""
    if len(values) < 3:
        return " / ".join(f"{value:.{digits}f}" for value in values)
    mean, half = mean_with_half(values)
    return f"{mean:.{digits}f} (±{half:.{digits}f})"


def by_drive(rows: pd.DataFrame, measure: str, cell: str = ALL) -> pd.DataFrame:
    """A measure in a cell: a row for each drive, a column for each model."""
    here = rows[rows["cell"] == cell].set_index(["drive", "model"])[measure]
    return here.unstack("model", sort=False)


def table(
    rows: pd.DataFrame,
    columns: Mapping[str, tuple[str, str, float, int]],
    models: Sequence[str] = MODELS,
) -> str:
    """A line for each model; of each column its cell, measure, factor and digits."""
    lines = []
    for model in models:
        found = []
        for cell, measure, factor, digits in columns.values():
            values = by_drive(rows, measure, cell)
            known = model in values
            found.append(over_drives(factor * values[model].to_numpy(), digits) if known else "–")
        lines.append((model, *found))
    return markdown(("covariance", *columns), lines)


def by_cell(rows: pd.DataFrame, measure: str) -> str:
    """A table of one measure: models by cells."""
    digits = 2 if rows["drive"].nunique() == 2 else 1  # beside an interval, on a phone
    cells = rows["cell"].unique()
    heads = {each.removesuffix(" targets"): (each, measure, 1.0, digits) for each in cells}
    return table(rows, heads)


def with_bounds(rows: pd.DataFrame, model: str, measure: str) -> str:
    """One measure of all sensors, with its interval on each of two drives."""
    values = by_drive(rows, measure)[model]
    if len(values) > 2:
        return over_drives(values.to_numpy(), 2)
    bounds = by_drive(rows, f"{measure} bounds")[model]
    return " / ".join(
        f"{value:.2f} [{low:.2f}, {high:.2f}]"
        for value, (low, high) in zip(values, bounds, strict=True)
    )


def intervals(rows: pd.DataFrame) -> str:
    """All sensors: the ANEES, and the log score beside that of the stored budget."""
    measures = ("ANEES", "difference")
    lines = [(model, *(with_bounds(rows, model, name) for name in measures)) for model in MODELS]
    return markdown(("covariance", "ANEES", "score less that of the stored budget"), lines)


def by_direction(rows: pd.DataFrame) -> str:
    """All sensors: squares by direction, and coverage in per cent."""
    columns = {f"${name}$": (ALL, name, 1.0, 2) for name in DIRECTIONS}
    return table(rows, columns | {name: (ALL, name, 100.0, 0) for name in LEVELS})


def errors(rows: pd.DataFrame) -> str:
    """All sensors: RMS errors by direction."""
    units = zip(DIRECTIONS, ("m/s", "m/s", "°/s"), (3, 3, 2), strict=True)
    columns = {f"${n}$, {unit}": (ALL, f"RMSE of {n}", 1.0, d) for n, unit, d in units}
    return table(rows, columns, TRACKS)


def causes(found: ProtocolResult, stored: ErrorBudget) -> str:
    """The budget that each drive is judged with, with its 95 % intervals, and the stored one."""
    unit = np.array([np.rad2deg(1.0), 1.0, 100.0, 1.0])
    lines = []
    for name, own in found.budgets.items():
        columns = zip(*(unit * each for each in (own.values, *own.bounds)), strict=True)
        cells = (f"{value:.3f} [{low:.3f}, {high:.3f}]" for value, low, high in columns)
        lines.append((name, *cells))
    known = unit * [getattr(stored, name) for name in CAUSES]
    lines.append(("stored", *(f"{value:.3f}" for value in known)))
    return markdown(("fitted without", "azimuth, °", "Doppler, m/s", "scale, %", "lag, s"), lines)


def counts(rows: pd.DataFrame) -> str:
    """How many estimates were judged, how many blocks they make, and what share they are.

    Blocks are as long as the errors and their NEES need; beyond `GROSS` an error is gross.
    """
    one_each = rows.drop_duplicates(["cell", "drive"], keep="last")
    lines = [
        (
            cell,
            str(len(own)),
            str(own["estimates"].sum()),
            f"{own['independent'].sum():.0f}",
            f"{100.0 * own['accepted'].mean():.1f}",
            f"{100.0 * own['gross'].mean():.1f}",
        )
        for cell, own in one_each.groupby("cell", sort=False)
    ]
    return markdown(
        ("cell", "drives", "judged", "independent", "accepted, %", "grossly off, %"), lines
    )


def section(data_set: str, found: ProtocolResult, stored: ErrorBudget) -> str:
    """The tables of a data set."""
    rows, names = found.rows, list(found.budgets)
    value = " / ".join(names) if len(names) < 3 else f"mean of {', '.join(names)} and its interval"
    tables = {
        f"ANEES, mean NEES / 3 ({value}; 40, 15: targets a scan)": by_cell(rows, "ANEES"),
        "mean log score, smaller is better": by_cell(rows, "log score"),
        "all sensors, with 95 % intervals": intervals(rows),
        "all sensors: mean squares of whitened errors, and coverage in per cent": by_direction(
            rows
        ),
        "all sensors: RMS errors": errors(rows),
        "the budget, with 95 % intervals": causes(found, stored),
        "estimates": counts(rows),
    }
    folded = "\n\n".join(f"**{data_set}: {title}**\n\n{text}" for title, text in tables.items())
    return f"```{{dropdown}} All numbers of {data_set}\n{folded}\n```"


def chart(results: Mapping[str, pd.DataFrame], path: Path) -> None:
    """The ANEES of every model in every cell: of two drives both, of more the mean."""
    use_style()
    shape: dict[str, Any] = {"sharex": True, "sharey": True, "squeeze": False}
    figure, axes = plt.subplots(1, len(results), figsize=(5.5, 6.2), **shape)
    worst = dict.fromkeys(MODELS, 0.0)
    for ax, (name, rows) in zip(axes[0], results.items(), strict=True):
        names: list[str] = []
        for cell, words in zip(CELLS, IN_WORDS, strict=True):
            ax.axhline(len(names) - 0.5, color="0.8", lw=0.8)
            names.append(words)
            values = by_drive(rows, "ANEES", cell)
            for model in values:
                place, own = len(names), values[model].to_numpy()
                color, marker, size = LOOKS[model]
                look: dict[str, Any] = {"color": color, "marker": marker, "lw": 1.2, "ms": size}
                if len(own) < 3:
                    heights = place + np.linspace(-0.18, 0.18, len(own))  # no mark hides the other
                    ax.plot(own, heights, **look, markevery=[0])
                    ax.plot(own, heights, **look | {"lw": 0}, mfc="white", zorder=1.9)
                    worst[model] = max(worst[model], own.max())
                else:
                    mean, half = mean_with_half(own)
                    spread = [min(half, mean - 0.1)], [half]  # the scale is logarithmic
                    ax.errorbar(mean, place, xerr=spread, **look)
                    worst[model] = max(worst[model], mean)
                names.append(model)
        ax.axvspan(0.5, 2.0, color="0.92", lw=0)
        ax.axvline(1.0, **TRUTH)
        ax.set(
            xscale="log",
            xlabel="ANEES (1 is right)",
            xlim=(0.09, 60),
            ylim=(len(names) - 0.4, -0.6),
        )
        write_out_ticks(ax.xaxis, (0.1, 0.5, 1, 2, 5, 10, 50))
        drives = "{} filled, {} open".format(*values.index) if len(values) == 2 else "mean, 95 %"
        ax.set_title(f"{name}: {drives}")
        ax.set_yticks(range(len(names)), names)
        for text in ax.get_yticklabels():
            text.set_size(8.5)
            if text.get_text() not in LOOKS:
                text.set(weight="bold", ha="left", x=-0.42)
        ax.tick_params(axis="y", length=0)
    letter_panels(axes)
    headline(
        figure,
        f"With other sensors a constant matrix is up to {worst[CONSTANT]:.0f} times too small; "
        f"the budget, which follows radars and targets, at most {worst[STORED]:.1f} times",
    )
    figure.savefig(path, dpi=244, metadata={"Software": None})
    plt.close(figure)


def write(sources: Mapping[str, Sequence[Source]]) -> None:
    """Judge every model on the drives at hand and write tables and chart into the book."""
    parts, charted = [], {}
    for data_set, drives in sources.items():
        if len(drives) < 2:
            raise ValueError(f"{data_set} must have two drives at least, to leave one out")
        found = protocol(drives)
        parts.append(section(data_set, found, DATA_SETS[data_set].budget))
        charted[data_set] = found.rows
    write_page(PAGE, "d2d.study.road protocol", parts)
    chart(charted, results_path("road_protocol.png"))
