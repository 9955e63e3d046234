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
from d2d.study.book.grammar import BLACK, GREY, PURPLE, SKY
from d2d.study.book.style import letter_panels, use_style
from d2d.study.results import results_path
from d2d.study.road.drive import DATA_SETS, Source
from d2d.study.road.markdown import markdown, write_page
from d2d.study.road.models import ABLATIONS, BUDGET, CAUSES, CONSTANTS, MODELS
from d2d.study.road.protocol import (
    ALL,
    CELLS,
    DIRECTIONS,
    LEVELS,
    Fitted,
    estimate_cells,
    protocol,
)

FAIR = 0.7, 1.5  # an ANEES that is near enough to 1 for a model to count as right
LOWEST = 0.25  # ANEES, where the axis begins
PAGE = "road_protocol.md"


def read_table(title: str) -> dict[str, list[str]]:
    """The cells of a stored table, by covariance; its heading begins with the title."""
    text = results_path(PAGE).read_text(encoding="utf-8")
    lines = text.split(f"**{title}")[1].split("\n\n")[1].splitlines()[2:]
    rows = ([cell.strip() for cell in line.strip("|").split("|")] for line in lines)
    return {name: cells for name, *cells in rows}


def mean_and_half_width(values: Array) -> tuple[Array, Array]:
    """The mean over some drives, and half the width of its 95 % interval by Student's t."""
    count = len(values)
    half = scipy.stats.t.ppf(0.975, count - 1) * np.std(values, axis=0, ddof=1) / np.sqrt(count)
    return np.mean(values, axis=0), half


def fixed(value: Any, digits: int) -> str:
    """A number with so many decimals, zero without a sign."""
    return f"{np.round(value, digits) + 0.0:.{digits}f}"


def over_drives(values: Array, digits: int) -> str:
    """Two drives one beside the other, more as their mean with its interval."""
    if len(values) < 3:
        return " / ".join(fixed(value, digits) for value in values)
    mean, half = mean_and_half_width(values)
    return f"{fixed(mean, digits)} (±{half:.{digits}f})"


def by_drive(rows: pd.DataFrame, measure: str, cell: str = ALL) -> pd.DataFrame:
    """A measure in a cell: a row for each drive, a column for each model."""
    here = rows[rows["cell"] == cell].set_index(["drive", "model"])[measure]
    return here.unstack("model", sort=False)


def by_cell(rows: pd.DataFrame, models: Sequence[str], measure: str, beside: str = "") -> str:
    """A table of one measure: models by cells, or how much it is above that of one ``beside``."""
    cells = rows["cell"].unique()
    digits = 2 if rows["drive"].nunique() == 2 or beside else 1  # beside an interval, on a phone
    found = {cell: by_drive(rows, measure, cell) for cell in cells}
    if beside:
        found = {cell: each.sub(each[beside], axis=0) for cell, each in found.items()}
    lines = [
        (model, *(over_drives(found[cell][model].to_numpy(), digits) for cell in cells))
        for model in models
    ]
    heads = (cell.removesuffix(" targets") for cell in cells)  # narrow enough for a phone
    return markdown(("covariance", *heads), lines)


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
    """All sensors: the ANEES, and the log score beside that of the constants."""
    measures = ("ANEES", "difference")
    lines = [(model, *(with_bounds(rows, model, name) for name in measures)) for model in MODELS]
    return markdown(("covariance", "ANEES", "score less that of constants"), lines)


def by_direction(rows: pd.DataFrame) -> str:
    """All sensors: squares by direction, and coverage in per cent."""
    forms = [(name, 1.0, 2) for name in DIRECTIONS] + [(name, 100.0, 0) for name in LEVELS]
    columns = [
        [over_drives(factor * by_drive(rows, name)[model].to_numpy(), digits) for model in MODELS]
        for name, factor, digits in forms
    ]
    lines = [*zip(MODELS, *columns, strict=True)]
    return markdown(("covariance", *DIRECTIONS, *LEVELS), lines)


def constants(fitted: Fitted) -> str:
    """The constants beside the noise that each drive is judged with, with standard errors."""
    unit, digits = np.array([1.0, 1.0, np.rad2deg(1.0)]), (3, 3, 2)
    lines = []
    for name, own in fitted.items():
        found = own[CONSTANTS]
        columns = zip(found["constants"] * unit, found["sigmas"] * unit, digits, strict=True)
        lines.append((name, *(f"{value:.{d}f} ± {sigma:.{d}f}" for value, sigma, d in columns)))
    return markdown(("fitted without", "v_x, m/s", "v_y, m/s", "ω, °/s"), lines)


def causes(fitted: Fitted, stored: ErrorBudget) -> str:
    """The budget that each drive is judged with, with its 95 % intervals, and the stored one."""
    unit = np.array([np.rad2deg(1.0), 1.0, 100.0, 1.0])
    lines = []
    for name, own in fitted.items():
        found = own[BUDGET]
        columns = zip(*(unit * each for each in (found["causes"], *found["bounds"])), strict=True)
        cells = (f"{value:.3f} [{low:.3f}, {high:.3f}]" for value, low, high in columns)
        lines.append((name, *cells))
    known = unit * [getattr(stored, name) for name in CAUSES]
    lines.append(("stored", *(f"{value:.3f}" for value in known)))
    return markdown(("fitted without", "azimuth, °", "Doppler, m/s", "scale, %", "lag, s"), lines)


def counts(rows: pd.DataFrame) -> str:
    """How many estimates were judged, how many blocks they make, and what share they are.

    Blocks are as long as the errors need, and the NEES of the last model.
    """
    one_each = rows.drop_duplicates(["cell", "drive"], keep="last")
    lines = [
        (
            cell,
            str(len(own)),
            str(own["estimates"].sum()),
            f"{own['independent'].sum():.0f}",
            f"{100.0 * own['accepted'].mean():.1f}",
        )
        for cell, own in one_each.groupby("cell", sort=False)
    ]
    return markdown(("cell", "drives", "judged", "independent", "accepted, %"), lines)


def section(data_set: str, fitted: Fitted, rows: pd.DataFrame, stored: ErrorBudget) -> str:
    """The tables of a data set."""
    names = list(fitted)
    value = " / ".join(names) if len(names) < 3 else f"mean of {', '.join(names)} and its interval"
    tables = {
        f"ANEES, mean NEES / 3 ({value}; 40, 15: targets a scan)": by_cell(
            rows, [*MODELS], "ANEES"
        ),
        "mean log score, smaller is better": by_cell(rows, [*MODELS], "log score"),
        "all sensors, with 95 % intervals": intervals(rows),
        "all sensors: mean squares of whitened errors, and coverage in per cent": by_direction(
            rows
        ),
        "constants beside the noise, ± standard error": constants(fitted),
        "budget beside the noise, with 95 % intervals": causes(fitted, stored),
        "fitted budget without one of its parts: log score less that of the whole": by_cell(
            rows, [*ABLATIONS], "log score", BUDGET
        ),
        "estimates": counts(rows),
    }
    folded = "\n\n".join(f"**{data_set}: {title}**\n\n{text}" for title, text in tables.items())
    return f"```{{dropdown}} All numbers of {data_set}\n{folded}\n```"


def chart(results: Mapping[str, pd.DataFrame], path: Path) -> None:
    """The ANEES of every model in every cell: both drives, or the mean with its interval."""
    use_style()
    figure, axes = plt.subplots(3, 2, figsize=(5.0, 7.8), sharex=True, sharey=True)
    heights = np.arange(len(MODELS))[::-1]
    for ax, cell in zip(axes.ravel(), CELLS, strict=True):
        ax.axvspan(*FAIR, color=GREY, alpha=0.2, lw=0)
        ax.axvline(1.0, color=BLACK, lw=0.8)
        looks = zip(results.items(), (PURPLE, SKY), (0.2, -0.2), strict=False)
        for (name, rows), color, shift in looks:
            values = by_drive(rows, "ANEES", cell)[[*MODELS]].to_numpy()
            if len(values) > 2:
                mean, half = mean_and_half_width(values)
                low = np.maximum(mean - half, LOWEST)
                ax.hlines(heights + shift, low, mean + half, color=color, lw=1.2)
                values = mean[None]
            points = ax.plot(values.T, heights + shift, "o", color=color, ms=3.5)
            points[0].set_label(name)
        ax.set(xscale="log", xlim=(LOWEST, 70.0), title=cell)
        ax.set_xticks([0.5, 2, 10, 50], [0.5, 2, 10, 50])
        ax.set_xticks([], minor=True)
        ax.grid(axis="y", alpha=0.4)
    axes[0, 0].set_yticks(heights, MODELS)
    for ax in axes[-1]:
        ax.set_xlabel("ANEES")
    letter_panels(axes)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    figure.savefig(path, dpi=110, bbox_inches="tight", metadata={"Software": None})
    plt.close(figure)


def write(sources: Mapping[str, Sequence[Source]]) -> None:
    """Judge every model on the drives at hand and write tables and chart into the book."""
    parts, charted = [], {}
    for data_set, drives in sources.items():
        if len(drives) < 2:
            raise ValueError(f"{data_set} must have two drives at least, to leave one out")
        fitted, rows = protocol(estimate_cells(drives))
        parts.append(section(data_set, fitted, rows, DATA_SETS[data_set].budget))
        charted[data_set] = rows
    write_page(PAGE, "d2d.study.road protocol", parts)
    chart(charted, results_path("road_protocol.png"))
