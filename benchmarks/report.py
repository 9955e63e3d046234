"""The tables and the chart that a run writes into the book, and the aims that it should meet."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

from benchmarks import methods
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


class Throughput(NamedTuple):
    """Scans, targets in each, seconds driven, and seconds to read and track them."""

    scans: int
    targets: float
    driven: float
    total: float

    @property
    def times_real_time(self) -> float:
        """Seconds driven per second of computing."""
        return self.driven / self.total


@dataclass(frozen=True)
class Measured:
    """Everything that one run measures."""

    machine: str
    versions: str
    missing: dict[str, str]
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


Line = tuple[str, str, str, str]  # what, the aim, what was measured, whether it was met


def unbroken(text: str) -> str:
    """A number with its sign and unit, which a narrow screen does not set on several lines."""
    return "\N{NO-BREAK SPACE}".join(text.split(" ", 2))


def aim(what: str, sign: str, bound: float, value: float | None, unit: str = "×") -> Line:
    """An aim, at least (≥) or at most (≤) a bound, and whether a value meets it."""
    wanted = unbroken(f"{sign} {bound:g} {unit}")
    if value is None:
        return what, wanted, "not measured", "–"
    met = value >= bound if sign == "≥" else value <= bound
    return what, wanted, unbroken(f"{number(value, 4)} {unit}"), "yes" if met else "no"


def stated(what: str, measured: str) -> Line:
    """A measurement without an aim."""
    return what, "stated", measured, "–"


def aims_table(m: Measured) -> str:
    """All aims, and the results of this run."""

    def slower(size: int, cost: str, name: str, base: str = methods.BATCH) -> float | None:
        row = find(m.rows, size, "truth", cost, name)
        batch = find(m.rows, size, "truth", "likelihood", base)
        return row.best / batch.best if row and batch else None

    lines = []
    for size, icp in ((8, 10.0), (48, 1.0)):
        where = f"{size} × {size}"
        for name, what in (
            (methods.BFGS, "NumPy in BFGS over the batch"),
            (f"{methods.BFGS}, exact gradient", "the same with the exact gradient"),
        ):
            lines.append(aim(f"{where}: {what}", "≥", 1000.0, slower(size, "likelihood", name)))
        for name in ("open3d ICP", "small_gicp ICP") if size == 8 else ("small_gicp ICP",):
            ratio = slower(size, "its own", name)
            lines.append(aim(f"{where}: {name} over the batch", "≥", icp, ratio))
            ratio = slower(size, "its own", f"{name}, from arrays", methods.BATCH_ARRAYS)
            lines.append(aim(f"{where}: the same, both from arrays", "≥", icp, ratio))
    for start in ("truth", "off"):
        for size in (MANY, MORE):
            robust = find(m.rows, size, start, "robust", methods.ONE)
            peer = find(m.rows, size, start, "its own", "small_gicp ICP")
            what = f"{size} × {size} from {STARTS[start]}: small_gicp ICP over robust, one per call"
            lines.append(aim(what, "≥", 1.0, peer.best / robust.best if peer and robust else None))
        grown = (MORE / MANY) ** growth(m.rows, "robust", methods.ONE, start)
        what = f"{MORE} over {MANY} targets from {STARTS[start]}: robust, one per call"
        lines.append(aim(what, "≤", 8.0, grown))
    for size, limit in ((8, 40.0), (48, 150.0)):
        row = find(m.rows, size, "truth", "likelihood", methods.ONE)
        lines.append(
            aim(f"{size} × {size}: one per call", "≤", limit, row.best * 1e6 if row else None, "µs")
        )
    for size, limit in ((8, 1.01), (48, 1.08)):
        row = find(m.rows, size, "truth", "likelihood", methods.BATCH)
        over_floor = row.accuracy.over_floor if row and row.accuracy else None
        what = f"{size} × {size}: translation RMSE over the floor"
        lines.append(aim(what, "≤", limit, over_floor))
    for size in (8, 48):
        for name in (methods.BATCH, methods.SCHEDULE, methods.STARTS):
            row = find(m.rows, size, "zero", "robust", name)
            share = 100.0 * row.accuracy.at_truth if row and row.accuracy else None
            line = aim(
                f"{size} × {size} from zero, robust: {name}, at the truth", "≥", 99.9, share, "%"
            )
            lines.append(stated(line[0], line[2]) if name == methods.BATCH else line)
    speed = m.drive.times_real_time if m.drive else None
    lines.append(aim("RadarScenes, one sensor, one core", "≥", 25.0, speed, "× real time"))
    runs, peak = max(m.peaks.items())
    lines.append(stated(f"peak memory of {runs} Monte Carlo runs", f"{peak:.0f} MB"))
    lines.append(aim("import d2d", "≤", 1.0, m.import_seconds, "s"))
    lines.append(aim("first call, compiling", "≤", 15.0, m.first_call[0], "s"))
    return markdown(("what", "aim", "measured", "met"), lines)


def others_table(m: Measured) -> str:
    """A table of the other measurements: start-up, memory, throughput."""
    lines = [
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
            aims_table(m),
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
