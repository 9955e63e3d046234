"""Tables and chart of the protocol, for page G and chapter 15."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import scipy
from matplotlib.colors import Normalize

from d2d._types import Array
from d2d.radar import ErrorBudget
from d2d.study.book.grammar import BLACK, COST_MAP, GREY
from d2d.study.book.style import headline, letter_panels, use_style
from d2d.study.results import results_path
from d2d.study.road.drive import DATA_SETS, Source
from d2d.study.road.markdown import markdown, write_page
from d2d.study.road.protocol import (
    ALL,
    CAUSES,
    CELLS,
    DIRECTIONS,
    LEVELS,
    MODELS,
    TRACKS,
    Judged,
    protocol,
)

FAR = 10.0  # a factor between an ANEES and 1 from which on all have one colour
PAGE = "road_protocol.md"


def over_drives(values: Array, digits: int) -> str:
    """Two drives one beside the other, more as their mean with its interval by Student's t."""
    if len(values) < 3:
        return " / ".join(f"{value:.{digits}f}" for value in values)
    half = scipy.stats.t.ppf(0.975, len(values) - 1) * scipy.stats.sem(values)
    return f"{values.mean():.{digits}f} (±{half:.{digits}f})"


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


def causes(found: Judged, stored: ErrorBudget) -> str:
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


def section(data_set: str, found: Judged, stored: ErrorBudget) -> str:
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
    """The ANEES of every model in every cell: of two drives both, of more the mean.

    The colour says how far the mean is from 1, by a factor to either side.
    """
    use_style()
    figure, axes = plt.subplots(len(results), figsize=(5.5, 5.7), sharex=True, squeeze=False)
    for ax, (name, rows) in zip(axes[:, 0], results.items(), strict=True):
        for column, cell in enumerate(CELLS):
            values = by_drive(rows, "ANEES", cell).reindex(columns=[*MODELS])
            off = np.abs(np.log(values.mean().to_numpy()))
            look = {"cmap": COST_MAP, "norm": Normalize(0.0, np.log(FAR)), "aspect": "auto"}
            image = ax.imshow(off[:, None], extent=(column, column + 1, len(MODELS), 0), **look)
            for row, own in enumerate(values.to_numpy().T):
                shown = own if len(own) < 3 else own.mean(keepdims=True)
                known = shown[np.isfinite(shown)]
                text = " / ".join(f"{value:.{int(value < 9.95)}f}" for value in known)
                color = "white" if off[row] < 0.6 * np.log(FAR) else BLACK
                ax.text(column + 0.5, row + 0.5, text, color=color, ha="center", va="center")
        drives = " / ".join(values.index) if len(values) < 3 else f"mean of {len(values)} drives"
        ax.set(xlim=(0, len(CELLS)), ylim=(len(MODELS), 0), title=f"{name}: {drives}")
        cells = rows.groupby("model")["cell"].nunique()
        for row in np.flatnonzero(cells[[*MODELS]] == 1).tolist():
            words = "judged with all sensors only"
            ax.text(0.5 + 0.5 * len(CELLS), row + 0.5, words, color=GREY, ha="center", va="center")
        ax.set_yticks(np.arange(len(MODELS)) + 0.5, MODELS)
        ax.set_xticks(np.arange(len(CELLS)) + 0.5, [cell.replace(" ", "\n") for cell in CELLS])
        ax.grid(visible=False)
    bar = figure.colorbar(image, ax=axes, location="bottom", shrink=0.7, aspect=30)
    bar.set_ticks([*np.log([1, 2, 5, 10])], labels=["1", "2", "5", "10 and more"])
    bar.set_label("factor between the ANEES and 1, to either side")
    headline(figure, "Without shared errors the ANEES is above 8, with the budget below 3")
    letter_panels(axes)
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
