"""The tables and the chart that a run writes into the book, and the aims that it should meet."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks import methods, processes
from benchmarks.peers import PEERS
from benchmarks.scenes import SCENES, Accuracy
from benchmarks.timing import exponent
from d2d.study.book import drawing
from d2d.study.book.grammar import COSTS, OTHERS, cost_line
from d2d.study.book.style import headline, letter_panels, use_style, write_out_ticks
from d2d.study.results import results_path
from d2d.study.road.markdown import markdown

# The sizes of the table of growth, and its methods with a name for each.
MANY, MORE = 200, 1000
GROWING = (
    *(
        (cost, f"{cost}{what}", name)
        for what, name in (
            ("", methods.ONE),
            (", covariance propagated", methods.ONE_PROPAGATED),
            (", from arrays", methods.ONE_ARRAYS),
        )
        for cost in methods.COSTS
    ),
    *(
        ("its own", name, name)
        for name in (
            "small_gicp ICP",
            "small_gicp ICP, from arrays",
            "open3d ICP",
            "open3d ICP, from arrays",
            "kiss-icp",
        )
    ),
)


@dataclass(frozen=True)
class Row:
    """One line of the table; times in s per registration, nan for a floor of the accuracy.

    ``share`` is processor time over elapsed time: below 1, other processes were running as well.
    """

    scene: str
    size: int
    start: str
    cost: str
    name: str
    best: float
    median: float
    runs: int
    accuracy: Accuracy
    share: float = float("nan")

    def cells(self) -> dict[str, Any]:
        """The row of the published table, whose units are in its headings."""
        judged = self.accuracy
        return {
            "scene": self.scene,
            "targets": self.size,
            "start": self.start,
            "cost": self.cost,
            "method": self.name,
            "best_us": number(1e6 * self.best),
            "median_us": number(1e6 * self.median),
            "rmse_m": number(judged.translation),
            "over_floor": number(judged.over_floor, 4),
            "rmse_deg": number(np.rad2deg(judged.rotation)),
            "at_truth_percent": number(100.0 * judged.at_truth, 4),
            "runs": self.runs,
        }


@dataclass(frozen=True)
class Measured:
    """Everything that one run measures."""

    machine: str
    versions: str
    missing: dict[str, str]
    rows: list[Row]
    libraries: dict[str, processes.Library]


def find(
    rows: Sequence[Row], size: int, start: str, cost: str, name: str, scene: str = "dense"
) -> Row | None:
    """The row of a method, or None; a peer is found by its name without the setting."""
    for row in rows:
        same = (row.scene, row.size, row.start, row.cost) == (scene, size, start, cost)
        if same and (row.name == name or row.name.startswith(f"{name} (")):
            return row
    return None


def number(value: float, digits: int = 3) -> str:
    """A value rounded to that many significant digits, without an exponent."""
    if not np.isfinite(value):
        return ""
    if value == 0.0:
        return "0"
    decimals = max(0, digits - 1 - int(np.floor(np.log10(abs(value)))))
    return f"{round(value, digits - 1 - int(np.floor(np.log10(abs(value))))):.{decimals}f}"


def growth(rows: Sequence[Row], cost: str, name: str, start: str, scene: str = "dense") -> float:
    """The local exponent between `MANY` and `MORE` targets, nan where one was not measured."""
    both = [find(rows, size, start, cost, name, scene) for size in (MANY, MORE)]
    found = [row for row in both if row is not None]
    return exponent((MANY, MORE), [row.best for row in found]) if len(found) == 2 else np.nan


def growth_table(rows: Sequence[Row]) -> str:
    """Times of `MANY` and `MORE` targets, exponent and accuracy, the two scenes side by side."""
    header = (
        "from 0.4 m off",
        *(
            f"{scene}: {what}"
            for scene in SCENES
            for what in (f"{MANY}, µs", f"{MORE}, µs", "exponent", "× floor")
        ),
    )
    lines = []
    for cost, label, name in GROWING:
        cells: list[str] = []
        for scene in SCENES:
            many, more = (find(rows, size, "off", cost, name, scene) for size in (MANY, MORE))
            cells += [number(row.best * 1e6 if row else np.nan) for row in (many, more)]
            cells.append(number(growth(rows, cost, name, "off", scene), 2))
            cells.append(number(more.accuracy.over_floor if more else np.nan))
        lines.append((label, *cells))
    return markdown(header, lines, 1)


def aim(what: str, sign: str, bound: float, value: float, unit: str = "×") -> tuple[str, ...]:
    """An aim, at least (≥) or at most (≤) a bound, the result, and whether the aim is met."""
    wanted, measured = f"{sign} {bound:g} {unit}", f"{number(value, 4)} {unit}"
    met = value >= bound if sign == "≥" else value <= bound
    if np.isnan(value):
        return what, wanted, "not measured", ""
    return (
        what,
        *(text.replace(" ", "\N{NO-BREAK SPACE}") for text in (wanted, measured)),
        ("✓" if met else "✗"),
    )


def aims_table(m: Measured) -> str:
    """All aims, and the results of this run."""

    def best(size: int, cost: str, name: str, start: str = "truth", scene: str = "dense") -> float:
        row = find(m.rows, size, start, cost, name, scene)
        return row.best if row else np.nan

    lines = []
    for size, icp in ((8, 10.0), (48, 1.0)):
        where = f"{size} × {size}"
        batch = best(size, "likelihood", methods.BATCH)
        arrays = best(size, "likelihood", methods.BATCH_ARRAYS)
        for name in (methods.BFGS, f"{methods.BFGS}, exact gradient"):
            ratio = best(size, "likelihood", name) / batch
            lines.append(aim(f"{where}: {name} over the batch", "≥", 1000.0, ratio))
        for name in ("open3d ICP", "small_gicp ICP"):
            ratio = best(size, "its own", name) / batch
            lines.append(aim(f"{where}: {name} over the batch", "≥", icp, ratio))
            ratio = best(size, "its own", f"{name}, from arrays") / arrays
            lines.append(aim(f"{where}: the same, both from arrays", "≥", icp, ratio))
    for scene in SCENES:
        for size in (MANY, MORE):
            peer = best(size, "its own", "small_gicp ICP", "off", scene)
            ratio = peer / best(size, "robust", methods.ONE, "off", scene)
            what = f"{size} targets, {scene}, 0.4 m off: small_gicp ICP over robust, one per call"
            lines.append(aim(what, "≥", 1.0, ratio))
    for size, limit, floor in ((8, 40.0, 1.01), (48, 150.0, 1.08)):
        where, one = f"{size} × {size}", 1e6 * best(size, "likelihood", methods.ONE)
        lines.append(aim(f"{where}: one per call", "≤", limit, one, "µs"))
        row = find(m.rows, size, "truth", "likelihood", methods.BATCH)
        over = row.accuracy.over_floor if row else np.nan
        lines.append(aim(f"{where}: translation RMSE over the floor", "≤", floor, over))
        row = find(m.rows, size, "zero", "robust", methods.SCHEDULE)
        share = 100.0 * row.accuracy.at_truth if row else np.nan
        lines.append(
            aim(f"{where} from zero: robust, ANNEALED, at the truth", "≥", 99.9, share, "%")
        )
    own = m.libraries["d2d"]
    lines.append(aim("import d2d", "≤", 1.0, own.imported, "s"))
    lines.append(aim("first call, compiling", "≤", 15.0, own.compiled, "s"))
    return markdown(("what", "aim", "measured", "met"), lines)


def libraries_table(libraries: Mapping[str, processes.Library]) -> str:
    """Size and seconds before the first result, a row for each library."""
    header = "library", "installed, MB", "of these", "first result, s", "when compiling, s"
    lines = []
    for name, library in libraries.items():
        largest = sorted(library.sizes.items(), key=lambda size: -size[1])[:3]
        shares = ", ".join(f"{package} {size:.0f}" for package, size in largest)
        total = f"{sum(library.sizes.values()):.0f}"
        seconds = number(library.first, 2), number(library.compiled, 2)
        lines.append((f"{name} {library.version}", total, shares, *seconds))
    return markdown(header, lines, 1)


def disturbance(rows: Sequence[Row]) -> str:
    """One sentence on how much of a core the run had; less than all of it flatters short calls."""
    shares = [row.share for row in rows if "threads" not in row.name]
    share = 100.0 * min(1.0, float(np.nanmedian(shares)))
    return f"The process had {share:.0f} % of a core."


def page(m: Measured) -> str:
    """The Markdown that the book's page includes."""
    missing = [f"- not installed: {name} ({why})" for name, why in m.missing.items()]
    return "\n\n".join(
        [
            "<!-- Written by `make bench`. -->",
            f"Measured on {m.machine}, with one thread unless said: {m.versions}. "
            + disturbance(m.rows),
            *(["\n".join(missing)] if missing else []),
            "### In short",
            aims_table(m),
            "### Before the first result",
            libraries_table(m.libraries),
            f"### {MANY} and {MORE} targets, in a dense and in a wide scene",
            growth_table(m.rows),
            "",
        ]
    )


def charts(rows: Sequence[Row]) -> None:
    """Draw time and accuracy over the number of targets, and one against the other."""
    matplotlib.use("Agg")
    use_style()
    figure, axes = plt.subplots(2, figsize=(5.5, 6.2), height_ratios=(1.6, 1.0), sharex=True)
    sizes = sorted({row.size for row in rows})
    ends: tuple[dict[str, Any], dict[str, Any]] = ({}, {})
    for cost, name, look in _looks():
        found = [row for size in sizes if (row := find(rows, size, "off", cost, name))]
        values = [[1e6 * row.best for row in found], [row.accuracy.over_floor for row in found]]
        for ax, curve, end in zip(axes, values, ends, strict=True):
            if found and not (ax is axes[1] and name == methods.ONE_PROPAGATED):
                ax.plot([row.size for row in found], curve, **look)
                if found[-1].size == sizes[-1]:
                    end[look["label"]] = (curve[-1], look["color"])
                else:  # named above its highest mark
                    highest = found[int(np.argmax(curve))].size, max(curve)
                    drawing.label(ax, highest, look["label"], look["color"], (-30, 6))
    titles = "time per call (µs)", "RMSE over that of known pairs"
    for ax, end, title, gap in zip(axes, ends, titles, (1.8, 1.7), strict=True):
        ax.set(xscale="log", yscale="log", title=title, ymargin=0.1)
        _name_ends(ax, sizes[-1], end, gap)
    write_out_ticks(axes[1].xaxis, sizes)
    write_out_ticks(axes[1].yaxis, [1, 2, 5, 10, 20, 50, 100])
    axes[1].set(xlabel="targets in each set", xlim=(None, 30.0 * sizes[-1]))
    headline(figure, "d2d is the fastest at 500 and 1000 targets, with under half an ICP's error")
    letter_panels(axes)
    _save(figure, "benchmarks.png")

    shown = [size for size in (8, 48, 200) if size in sizes]
    figure, axes = plt.subplots(1, 2, figsize=(5.5, 5.0), sharey=True)
    words = ", ".join(map(str, shown))
    beside = {"transform": axes[0].get_yaxis_transform(), "ha": "right", "va": "center"}
    for height, (cost, name, look) in enumerate(_looks(batches=True)):
        for n, size in enumerate(shown):
            if row := find(rows, size, "truth", cost, name):
                marks = {"color": look["color"], "marker": look["marker"], "ms": 4.0 + 2.5 * n}
                axes[0].plot(1e6 * row.best, height, mfc="none", **marks)
                axes[1].plot(row.accuracy.over_floor, height, mfc="none", **marks)
        axes[0].text(-0.03, height, look["label"], color=look["color"], **beside)
    axes[0].set(xscale="log", xlabel="µs", title=f"time for {words} targets", yticks=[])
    axes[0].invert_yaxis()
    axes[1].set(xscale="log", xlabel="times that of known pairs", title="RMSE")
    write_out_ticks(axes[1].xaxis, [1, 2, 5, 10, 20])
    headline(figure, "In a batch d2d is the fastest, and nothing is more accurate")
    letter_panels(axes)
    _save(figure, "benchmarks_accuracy.png")


def _save(figure: Figure, name: str) -> None:
    figure.savefig(results_path(name), dpi=244, metadata={"Software": None})
    plt.close(figure)


def _name_ends(ax: Axes, x: float, ends: Mapping[str, tuple[float, str]], gap: float) -> None:
    """Name the lines that end at ``x`` in a column, whose names are a factor ``gap`` apart."""
    found = sorted(ends.items(), key=lambda end: end[1])
    heights = np.log([y for _, (y, _) in found])
    for _ in range(300):  # names that are too close push each other apart
        push = 0.5 * np.clip(np.log(gap) - np.diff(heights), 0.0, None)
        heights += np.append(0.0, push) - np.append(push, 0.0)
    for (name, (y, color)), height in zip(found, np.exp(heights), strict=True):
        ax.plot((1.08 * x, 1.4 * x), (y, height), color=color, lw=0.5)
        ax.text(1.5 * x, height, name, color=color, va="center", fontsize=9)


def _looks(batches: bool = False) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Cost, name and style of each line of a chart; with ``batches``, these and no covariances.

    Peers have the colour and the mark of their library; broken lines take covariances.
    """
    for cost in methods.COSTS:
        line = cost_line(cost) | {"marker": COSTS[cost].marker, "zorder": 3.0, "lw": 2.2}
        yield cost, methods.ONE, line | {"label": f"d2d, {cost}"}
        label = f"d2d, {cost}, " + ("batch" if batches else "covariance")
        name = methods.BATCH if batches else methods.ONE_PROPAGATED
        yield cost, name, line | {"lw": 0.8, "label": label} | ({} if batches else {"marker": ""})
    modules = list(dict.fromkeys(peer.module for peer in PEERS))
    for peer in PEERS:
        library, name = modules.index(peer.module), peer.name.split(",")[0]
        look = {"color": OTHERS[library], "marker": "so^v<"[library], "lw": 1.0, "ms": 4}
        if "GICP" in peer.name:
            look |= {"ls": "--", "mfc": "white"}
        yield "its own", peer.name, look | {"label": name}


def write(m: Measured) -> None:
    """Write the page's tables, all rows and the charts."""
    results_path("benchmarks.md").write_text(page(m), encoding="utf-8")
    rows = pd.DataFrame([row.cells() for row in m.rows])
    rows.to_csv(results_path("benchmarks.csv"), index=False)
    charts(m.rows)
