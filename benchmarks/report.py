"""The tables and the chart that a run writes into the book, and the bars that it has to clear."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

from benchmarks import methods
from benchmarks.drive import Throughput
from benchmarks.peers import PEERS
from benchmarks.scenes import Accuracy
from benchmarks.timing import exponent
from d2d.study.book.grammar import COSTS, OTHERS, cost_line
from d2d.study.book.style import letter_panels, use_style
from d2d.study.results import results_path
from d2d.study.road.markdown import markdown

STARTS = {"truth": "the truth", "off": "0.4 m and 0.6° off", "zero": "zero"}
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

    size: int
    start: str
    cost: str
    name: str
    best: float
    median: float
    runs: int
    accuracy: Accuracy | None
    share: float = float("nan")


@dataclass(frozen=True)
class Bar:
    """One bar of the benchmark: what was aimed at, what was measured, and whether it was met."""

    what: str
    aim: str
    measured: str
    met: bool | None  # None where there is nothing to compare with


@dataclass(frozen=True)
class Measured:
    """Everything that one run measures."""

    machine: str
    versions: str
    missing: dict[str, str]
    exp: dict[str, float]
    rows: list[Row]
    memory: float  # MB
    import_seconds: float
    first_call: tuple[float, float]
    peaks: dict[int, float]
    drive: Throughput | None


def find(rows: Sequence[Row], size: int, start: str, cost: str, name: str) -> Row | None:
    """The row of a method, or None; a peer is found by its name without the setting."""
    for row in rows:
        same = (row.size, row.start, row.cost) == (size, start, cost)
        if same and (row.name == name or row.name.startswith(f"{name} (")):
            return row
    return None


def number(value: float, digits: int = 3) -> str:
    """A value rounded to that many significant digits, without an exponent."""
    if not np.isfinite(value):
        return "–"
    if value == 0.0:
        return "0"
    decimals = max(0, digits - 1 - int(np.floor(np.log10(abs(value)))))
    return f"{round(value, digits - 1 - int(np.floor(np.log10(abs(value))))):.{decimals}f}"


def main_tables(rows: Sequence[Row]) -> str:
    """Time and accuracy of every method, where the batches were measured as well.

    The container's class sets each row of ten cells in two lines on a phone, see `ledger.css`.
    """
    header = (
        *("cost", "method", "µs, best", "µs, median", "× batch"),
        *("RMSE, m", "× floor", "RMSE, °", "at truth, %", "runs"),
    )
    groups: dict[tuple[int, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row.size, row.start), []).append(row)
    parts = []
    for (size, start), members in groups.items():
        batch = find(rows, size, start, "likelihood", methods.BATCH)
        if batch is None:
            continue
        lines = []
        for row in members:
            judged = row.accuracy or Accuracy(*[float("nan")] * 4)
            lines.append(
                (
                    row.cost,
                    row.name,
                    number(row.best * 1e6),
                    number(row.median * 1e6),
                    number(row.best / batch.best),
                    number(judged.translation),
                    number(judged.over_floor, 4),
                    number(np.rad2deg(judged.rotation)),
                    number(100.0 * judged.at_truth, 4),
                    str(row.runs) if row.runs else "–",
                )
            )
        parts.append(f"### {size} × {size} targets, started at {STARTS[start]}")
        parts.append(f":::{{container}} methods\n\n{markdown(header, lines, 2)}\n\n:::")
    return "\n\n".join(parts)


def growth(rows: Sequence[Row], cost: str, name: str, start: str) -> float:
    """The local exponent between `MANY` and `MORE` targets, nan where one was not measured."""
    both = [find(rows, size, start, cost, name) for size in (MANY, MORE)]
    found = [row for row in both if row is not None]
    return exponent((MANY, MORE), [row.best for row in found]) if len(found) == 2 else np.nan


def growth_table(rows: Sequence[Row], start: str) -> str:
    """Times of `MANY` and `MORE` targets from one start, exponent, and the accuracy of `MORE`."""
    header = f"from {STARTS[start]}", f"{MANY}, µs", f"{MORE}, µs", "exponent", "× floor"
    lines = []
    for cost, label, name in GROWING:
        many, more = (find(rows, size, start, cost, name) for size in (MANY, MORE))
        accuracy = more.accuracy.over_floor if more and more.accuracy else np.nan
        lines.append(
            (
                label,
                *(number(row.best * 1e6 if row else np.nan) for row in (many, more)),
                number(growth(rows, cost, name, start), 2),
                number(accuracy),
            )
        )
    return markdown(header, lines, 1)


def _at_least(what: str, value: float | None, aim: float, unit: str = "×") -> Bar:
    bar = _unbroken(f"≥ {aim:g} {unit}")
    if value is None:
        return Bar(what, bar, "not measured", None)
    return Bar(what, bar, _unbroken(f"{number(value, 4)} {unit}"), value >= aim)


def _at_most(what: str, value: float | None, aim: float, unit: str) -> Bar:
    bar = _unbroken(f"≤ {aim:g} {unit}")
    if value is None:
        return Bar(what, bar, "not measured", None)
    return Bar(what, bar, _unbroken(f"{number(value, 4)} {unit}"), value <= aim)


def _unbroken(text: str) -> str:
    """A number with its sign and unit, which a narrow screen does not set on several lines."""
    return "\N{NO-BREAK SPACE}".join(text.split(" ", 2))


def bars(m: Measured) -> list[Bar]:
    """All bars, with what this run measured."""

    def slower(size: int, cost: str, name: str, base: str = methods.BATCH) -> float | None:
        row = find(m.rows, size, "truth", cost, name)
        batch = find(m.rows, size, "truth", "likelihood", base)
        return row.best / batch.best if row and batch else None

    def accuracy_of(size: int, start: str, cost: str, name: str) -> Accuracy | None:
        row = find(m.rows, size, start, cost, name)
        return row.accuracy if row else None

    result = []
    arrays = methods.BATCH_ARRAYS
    for size, icp in ((8, 10.0), (48, 1.0)):
        where = f"{size} × {size}"
        bfgs = slower(size, "likelihood", methods.BFGS)
        result.append(_at_least(f"{where}: NumPy in BFGS over the batch", bfgs, 1000.0))
        bfgs = slower(size, "likelihood", f"{methods.BFGS}, exact gradient")
        result.append(_at_least(f"{where}: the same with the exact gradient", bfgs, 1000.0))
        bfgs = slower(size, "likelihood", methods.MATRICES)
        result.append(_at_least(f"{where}: NumPy with np.linalg in BFGS", bfgs, 1000.0))
        for name in ("open3d ICP", "small_gicp ICP") if size == 8 else ("small_gicp ICP",):
            ratio = slower(size, "its own", name)
            result.append(_at_least(f"{where}: {name} over the batch", ratio, icp))
            ratio = slower(size, "its own", f"{name}, from arrays", arrays)
            result.append(_at_least(f"{where}: the same, both from arrays", ratio, icp))
    for start in ("truth", "off"):
        for size in (MANY, MORE):
            robust = find(m.rows, size, start, "robust", methods.ONE)
            icp = find(m.rows, size, start, "its own", "small_gicp ICP")
            what = f"{size} × {size} from {STARTS[start]}: small_gicp ICP over robust, one per call"
            ratio = icp.best / robust.best if icp and robust else None
            result.append(_at_least(what, ratio, 1.0))
        ratio = (MORE / MANY) ** growth(m.rows, "robust", methods.ONE, start)
        what = f"{MORE} over {MANY} targets from {STARTS[start]}: robust, one per call"
        result.append(_at_most(what, ratio, 8.0, "×"))
    for size, limit in ((8, 40.0), (48, 150.0)):
        row = find(m.rows, size, "truth", "likelihood", methods.ONE)
        what = f"{size} × {size}: one per call, where exp takes {m.exp['compiled loop']:.1f} ns"
        result.append(_at_most(what, row.best * 1e6 if row else None, limit, "µs"))
    for size, limit in ((8, 1.01), (48, 1.08)):
        judged = accuracy_of(size, "truth", "likelihood", methods.BATCH)
        what = f"{size} × {size}: translation RMSE over the floor"
        result.append(_at_most(what, judged.over_floor if judged else None, limit, "×"))
    for size in (8, 48):
        for name in (methods.BATCH, methods.SCHEDULE, methods.STARTS):
            judged = accuracy_of(size, "zero", "robust", name)
            share = 100.0 * judged.at_truth if judged else None
            what = f"{size} × {size} from zero, robust: {name}, at the truth"
            bar = _at_least(what, share, 99.9, "%")
            if name == methods.BATCH:
                bar = Bar(what, "stated", bar.measured, None)
            result.append(bar)
    speed = m.drive.times_real_time if m.drive else None
    result.append(_at_least("RadarScenes, one sensor, one core", speed, 25.0, "× real time"))
    runs, peak = max(m.peaks.items())
    result.append(Bar(f"peak memory of {runs} Monte Carlo runs", "stated", f"{peak:.0f} MB", None))
    result.append(_at_most("import d2d", m.import_seconds, 1.0, "s"))
    result.append(_at_most("first call, compiling", m.first_call[0], 15.0, "s"))
    return result


def bars_table(m: Measured) -> str:
    """The bars as a table."""
    words = {True: "yes", False: "no", None: "–"}
    lines = [(bar.what, bar.aim, bar.measured, words[bar.met]) for bar in bars(m)]
    return markdown(("what", "aim", "measured", "met"), lines, 1)


def others_table(m: Measured) -> str:
    """A table of the other measurements: exp, start-up, memory, throughput."""
    lines = [
        *((f"one exp, {name}", f"{value:.2f} ns") for name, value in m.exp.items()),
        ("import d2d", f"{m.import_seconds:.2f} s"),
        ("first call on a new machine, compiling", f"{m.first_call[0]:.1f} s"),
        ("first call of a later process, from the cache", f"{m.first_call[1]:.2f} s"),
        *(
            (f"peak memory of {runs} Monte Carlo runs", f"{peak:.0f} MB")
            for runs, peak in sorted(m.peaks.items())
        ),
        (
            f"memory of a robust registration of {max(row.size for row in m.rows)} targets",
            f"{m.memory:.0f} MB",
        ),
    ]
    if m.drive is None:
        lines.append(("RadarScenes", "not measured: D2D_RADARSCENES is not set"))
    else:
        d = m.drive
        lines += [
            (
                f"RadarScenes, {d.scans} scans of {d.targets:.0f} targets, reading included",
                f"{d.times_real_time:.1f} × real time",
            ),
            ("of it reading", f"{100.0 * d.reading / d.total:.0f} %"),
        ]
    return markdown(("what", "measured"), lines, 1)


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
            bars_table(m),
            f"### {MANY} and {MORE} targets",
            growth_table(m.rows, "truth"),
            growth_table(m.rows, "off"),
            main_tables(m.rows),
            "### The rest",
            others_table(m),
            "",
        ]
    )


def chart(m: Measured, path: Path) -> None:
    """Time and accuracy against the number of targets, of what registers one pair a call.

    One panel stands below the other, so that a phone shows both.
    """
    matplotlib.use("Agg")
    use_style()
    figure, axes = plt.subplots(2, figsize=(5.0, 7.6), height_ratios=(1.5, 1.0), sharex=True)
    above, below = axes
    sizes = sorted({row.size for row in m.rows})
    for cost, name, look in _looks():
        found = [row for size in sizes if (row := find(m.rows, size, "off", cost, name))]
        measured = [row.size for row in found]
        above.plot(measured, [row.best * 1e6 for row in found], **look)
        if name == methods.ONE_PROPAGATED:
            continue
        below.plot(measured, [row.accuracy.over_floor for row in found if row.accuracy], **look)
    for ax, title in ((above, "time per call (µs)"), (below, "RMSE over that of known pairs")):
        ax.set(xscale="log", yscale="log", title=title)
    below.set_xticks(sizes, sizes)
    below.set_xticks([], minor=True)
    ratios = [1, 2, 5, 10, 20, 50]
    below.set_yticks(ratios, ratios)
    below.set_yticks([], minor=True)
    below.set_xlabel("targets in each set")
    letter_panels(axes)
    figure.legend(*above.get_legend_handles_labels(), loc="outside upper center", ncols=2)
    figure.savefig(path, dpi=110, bbox_inches="tight", metadata={"Software": None})
    plt.close(figure)


def _looks() -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Cost, name and style of each line of the chart.

    Peers of one library have one colour, and open marks and broken lines if they estimate or take
    covariances.
    """
    for cost in methods.COSTS:
        line = cost_line(cost)
        yield cost, methods.ONE, {**line, "marker": COSTS[cost].marker}
        label = f"{line['label']}, with covariance"
        yield cost, methods.ONE_PROPAGATED, {**line, "lw": 0.8, "label": label}
    modules = list(dict.fromkeys(peer.module for peer in PEERS))
    for peer in PEERS:
        library = modules.index(peer.module)
        color, marker = OTHERS[library], "so^v<"[library]
        look = {"color": color, "marker": marker, "lw": 1.0, "label": peer.name.split(",")[0]}
        if "GICP" in peer.name:
            look |= {"ls": "--", "mfc": "white"}
        yield "its own", peer.name, look


def write(m: Measured) -> None:
    """Write the page's tables and the chart."""
    results_path("benchmarks.md").write_text(page(m), encoding="utf-8")
    chart(m, results_path("benchmarks.png"))
