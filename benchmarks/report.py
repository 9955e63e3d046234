"""The tables and the chart that a run writes into the book, and the aims that it should meet."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from benchmarks import methods, processes
from benchmarks.peers import PEERS
from benchmarks.scenes import SCENES, Accuracy
from d2d.study.book import drawing
from d2d.study.book.grammar import COSTS, GREY, OTHERS, PINK, cost_line
from d2d.study.book.style import headline, letter_panels, use_style, write_out_ticks
from d2d.study.results import results_path
from d2d.study.road.markdown import markdown

# The sizes of the table of growth, and its methods: ours with each cost, then the peers.
MANY, MORE = 200, 1000
GROWING = [
    *product((methods.ONE, methods.ONE_PROPAGATED, methods.ONE_ARRAYS), methods.COSTS),
    *product(("small_gicp ICP", "small_gicp ICP, from arrays"), ["its own"]),
    *product(("open3d ICP", "open3d ICP, from arrays", "kiss-icp"), ["its own"]),
]

# Of the chart over the sizes: name, colour and parts of the names of each group of peers, and where
# the name stands in both panels; and what the panels show.
_BANDS = (
    ("CPD: probreg, pycpd", PINK, ("CPD",), ((9, 3e4), (9, 50))),
    ("ICP, GICP: open3d,\nsmall_gicp, kiss-icp", GREY, ("ICP", "kiss"), ((60, 9), (2200, 4.4))),
)
_MEASURES: dict[str, Callable[["Row"], float]] = {
    "time per call (µs)": lambda row: 1e6 * row.best,
    "RMSE over that of known pairs": lambda row: row.accuracy.over_floor,
}


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


def growth_table(rows: Sequence[Row]) -> str:
    """Times of `MANY` and `MORE` targets, local exponent and accuracy, the scenes side by side."""
    header = (
        "from 0.4 m off",
        *(
            f"{scene}: {what}"
            for scene in SCENES
            for what in (f"{MANY}, µs", f"{MORE}, µs", "exponent", "× floor")
        ),
    )
    lines = []
    for name, cost in GROWING:
        cells: list[str] = []
        for scene in SCENES:
            many, more = (find(rows, size, "off", cost, name, scene) for size in (MANY, MORE))
            before, after = (row.best if row else np.nan for row in (many, more))
            exponent = np.log(after / before) / np.log(MORE / MANY)
            cells += [number(1e6 * before), number(1e6 * after), number(exponent, 2)]
            cells.append(number(more.accuracy.over_floor if more else np.nan))
        lines.append((name.replace(methods.ONE, cost), *cells))
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


def draw_sizes(rows: Sequence[Row]) -> None:
    """Draw time and accuracy over the number of targets."""
    figure, axes = plt.subplots(2, figsize=(5.5, 5.8), height_ratios=(1.5, 1.0), sharex=True)
    sizes = sorted({row.size for row in rows})
    for words, color, families, places in _BANDS:
        members = [peer.name for peer in PEERS if any(each in peer.name for each in families)]
        found = [[find(rows, size, "off", "its own", name) for name in members] for size in sizes]
        known = {
            n: [r for r in each if r] for n, each in zip(sizes, found, strict=True) if any(each)
        }
        for ax, place, measure in zip(axes, places, _MEASURES.values(), strict=True):
            values = [[measure(row) for row in each] for each in known.values()]
            low, high = (list(map(end, values)) for end in (min, max))
            ax.fill_between([*known], low, high, facecolor=color, edgecolor=color, alpha=0.3)
            ax.text(*place, words, color=color, fontsize=9)
    for name, words, width in (
        (methods.ONE, "d2d, robust", 2.2),
        (methods.ONE_PROPAGATED, "d2d, covariance\npropagated", 0.8),
    ):
        own = [row for size in sizes if (row := find(rows, size, "off", "robust", name))]
        look = cost_line("robust") | {"marker": COSTS["robust"].marker, "ms": 2.5 * width}
        for ax, measure in zip(axes, _MEASURES.values(), strict=True):
            if ax is axes[0] or name == methods.ONE:
                ax.plot([row.size for row in own], list(map(measure, own)), **look, lw=width)
                end = own[-1].size, measure(own[-1])
                drawing.label(ax, end, words, COSTS["robust"].color, (7, -4))
    for ax, title in zip(axes, _MEASURES, strict=True):
        ax.set(xscale="log", yscale="log", title=title, ymargin=0.1)
    write_out_ticks(axes[1].xaxis, sizes)
    write_out_ticks(axes[1].yaxis, [1, 2, 5, 10, 20, 50, 100])
    axes[1].set(xlabel="targets in each set", xlim=(None, 1.15 * sizes[-1]))
    headline(figure, "At 500 and 1000 targets d2d is the fastest and the most accurate")
    letter_panels(axes)
    _save(figure, "benchmarks.png")


def draw_batches(rows: Sequence[Row]) -> None:
    """Draw time and accuracy of each method, also in a batch, for up to three sizes."""
    sizes = {row.size for row in rows}
    shown = [size for size in (8, 48, 200) if size in sizes]
    figure, axes = plt.subplots(1, 2, figsize=(5.5, 5.0), sharey=True)
    words = f"time: {shown[0]} (small) to {shown[-1]} targets"
    beside = {"transform": axes[0].get_yaxis_transform(), "ha": "right", "va": "center"}
    for height, (cost, name, look) in enumerate(_looks()):
        for n, size in enumerate(shown):
            if row := find(rows, size, "truth", cost, name):
                marks = {"color": look["color"], "marker": look["marker"], "ms": 3.5 + 1.8 * n}
                place = height + 0.28 * (n - 1)  # one below the other, so that no mark hides one
                axes[0].plot(1e6 * row.best, place, mfc="none", **marks)
                axes[1].plot(row.accuracy.over_floor, place, mfc="none", **marks)
        axes[0].text(-0.03, height, look["label"], color=look["color"], **beside)
    axes[0].set(xscale="log", xlabel="µs", title=words, yticks=[])
    axes[0].invert_yaxis()
    axes[1].set(xscale="log", xlabel="times that of known pairs", title="RMSE")
    write_out_ticks(axes[1].xaxis, [1, 2, 5, 10, 20])
    headline(figure, "In a batch d2d is the fastest, and nothing is more accurate")
    letter_panels(axes)
    _save(figure, "benchmarks_accuracy.png")


def _save(figure: Figure, name: str) -> None:
    figure.savefig(results_path(name), dpi=244, metadata={"Software": None})
    plt.close(figure)


def _looks() -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Cost, name and style of each row of the batches' chart; peers have that of their library."""
    for cost in methods.COSTS:
        line = cost_line(cost) | {"marker": COSTS[cost].marker}
        yield cost, methods.ONE, line | {"label": f"d2d, {cost}"}
        yield cost, methods.BATCH, line | {"label": f"d2d, {cost}, batch"}
    modules = list(dict.fromkeys(peer.module for peer in PEERS))
    for peer in PEERS:
        library, name = modules.index(peer.module), peer.name.split(",")[0]
        look = {"color": OTHERS[library], "marker": "so^v<"[library], "label": name}
        yield "its own", peer.name, look


def write(m: Measured) -> None:
    """Write the page's tables, all rows and the charts."""
    results_path("benchmarks.md").write_text(page(m), encoding="utf-8")
    rows = pd.DataFrame([row.cells() for row in m.rows])
    rows.to_csv(results_path("benchmarks.csv"), index=False)
    matplotlib.use("Agg")
    use_style()
    draw_sizes(m.rows)
    draw_batches(m.rows)
