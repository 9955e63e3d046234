"""The figures of the exhaustive evaluation."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from d2d.study.beyond.exhaustive import ANNEALING, Outcome, Rows, Trial, select, success
from d2d.study.book.grammar import (
    BLACK,
    COSTS,
    COVARIANCES,
    GREY,
    PINK,
    PURPLE,
    SHARE_MAP,
    SKY,
    TRUTH,
    YELLOW,
    cost_line,
)
from d2d.study.book.style import write_out_ticks
from d2d.study.estimation.covariance_trials import CREDIBLE_INCLINATION
from d2d.study.plane.scenarios import OVERLAPPED, RANGES
from d2d.study.runs import StatedCovariances

# For each factor: the parameter of the trial, the label of the axis, and whether it is logarithmic.
FACTORS: dict[str, tuple[str, str, bool]] = {
    "noise": ("noise", "noise / nominal", True),
    "size": ("size", "targets in a scan", True),
    "outliers": ("outlier_share", "outlier share", False),
    "overlap": ("overlap", "overlap", False),
    "spacing": ("spacing_m", "minimum spacing (m)", False),
    "field": ("field_deg", "half field of view (°)", True),
    "reported": ("reported", "stated / actual σ", True),
}
# The costs as the stored results name them, and their keys in the grammar.
STORED = {"sum": "summing", "likelihood": "likelihood", "robust": "robust"}

Measure = Callable[[Outcome], float]


def factor_panels(
    axes: NDArray[np.object_], rows: Rows, measure: Measure, *, annealed: bool
) -> None:
    """A measure over each factor, started at the truth; the last panel holds the legend.

    With ``annealed``, also that of the annealed robust likelihood, started 5 m and 15 degrees off.
    """
    panels = axes.ravel()
    for ax, (factor, (parameter, label, logarithmic)) in zip(panels, FACTORS.items(), strict=False):
        for cost, key in STORED.items():
            chosen = select(rows, factor, cost=cost, distance_m=0.0)
            style = cost_line(key) | {"marker": COSTS[key].marker}
            _line(ax, chosen, parameter, measure, **style)
        if annealed:
            chosen = select(rows, factor, cost="robust", scales=ANNEALING)
            style = cost_line("robust", label="robust, annealed,\nfrom afar")
            _line(ax, chosen, parameter, measure, **style, marker="x", zorder=3)
        ax.set(xlabel=label, ylim=(-0.03, 1.03))
        if logarithmic:
            ax.set_xscale("log")
            _plain_ticks(ax, [getattr(trial, parameter) for trial, _ in chosen])
    for empty in panels[len(FACTORS) :]:
        empty.axis("off")
        empty.legend(*panels[0].get_legend_handles_labels(), loc="center")


def _line(ax: Axes, rows: Rows, parameter: str, measure: Measure, **style: Any) -> None:
    values = [getattr(trial, parameter) for trial, _ in rows]
    ax.plot(values, [measure(outcome) for _, outcome in rows], ms=4, lw=1.2, **style)


def _plain_ticks(ax: Axes, values: Sequence[float]) -> None:
    """Ticks at the lowest and the highest value and at one between, if possible 1, written out."""
    middle = 1.0 if min(values) < 1.0 < max(values) else values[len(values) // 2]
    write_out_ticks(ax.xaxis, (min(values), middle, max(values)))


def start_map(ax: Axes, rows: Rows, cost: str, scales: str, title: str) -> None:
    """Success in percent over the start's distance and rotation, averaged over the directions."""
    chosen = select(rows, "start", cost=cost, scales=scales)
    distances = sorted({trial.distance_m for trial, _ in chosen})
    turns = sorted({trial.turn_deg for trial, _ in chosen})
    shares = np.empty((len(turns), len(distances)))
    for place in np.ndindex(shares.shape):
        turn, distance = turns[place[0]], distances[place[1]]
        here = select(chosen, "start", distance_m=distance, turn_deg=turn)
        shares[place] = np.mean([success(outcome) for _, outcome in here])
    ax.imshow(shares, vmin=0.0, vmax=1.0, aspect="auto", origin="lower", cmap=SHARE_MAP)
    ax.grid(False)
    ax.set_xticks(range(len(distances)), [f"{value:g}" for value in distances])
    ax.set_yticks(range(len(turns)), [f"{value:g}" for value in turns])
    ax.set(xlabel="start off by (m)", ylabel="start off by (°)", title=title)
    for (row, column), value in np.ndenumerate(shares):
        color = BLACK if value > 0.6 else "white"
        ax.text(column, row, f"{100 * value:.0f}", ha="center", va="center", color=color, size=7)


def cross_range_sigma(trial: Trial) -> float:
    """Standard deviation across the line of sight at the mean range, in m."""
    return trial.noise * OVERLAPPED.sigma_azimuth * float(np.mean(RANGES))


def first_scale_panel(ax: Axes, rows: Rows) -> None:
    """Success over the standard deviation at the first scale, in units of the start's distance."""
    noises = sorted({trial.noise for trial, _ in select(rows, "first scale")})
    marks = zip(noises, (BLACK, YELLOW, PINK, SKY, PURPLE), "Pvx^*", strict=True)
    for noise, color, marker in marks:
        chosen = select(rows, "first scale", noise=noise)
        ratio = [
            float(trial.scales.split()[0]) * cross_range_sigma(trial) / trial.distance_m
            for trial, _ in chosen
        ]
        shares = [success(outcome) for _, outcome in chosen]
        ax.plot(ratio, shares, marker, color=color, ms=5, label=f"noise {noise:g}")
    ax.axvline(1.0, color=GREY, lw=0.9)
    ax.set_xscale("log")
    ax.set(xlabel="first scale · σ / start error", ylabel="share at the truth", ylim=(-0.03, 1.03))
    ax.legend(loc="lower right")


def covariance_panel(
    ax: Axes, covariances: dict[str, StatedCovariances], title: str, *, named: bool
) -> None:
    """I^2 of both covariances, one row for each name; within the band they count as credible."""
    ax.axvspan(-CREDIBLE_INCLINATION, CREDIBLE_INCLINATION, color=SKY, alpha=0.4, lw=0)
    ax.axvline(0.0, **TRUTH)
    heights = np.arange(len(covariances))[::-1]
    for kind, name in (("inverse Hessian", "inverse Hessian"), ("propagated", "propagated noise")):
        values = [both.credibility(kind).inclination for both in covariances.values()]
        ax.plot(values, heights, **COVARIANCES[name].marks, ms=6)
    # an entry that is not a cost of the grammar keeps its name
    names = [COSTS[key].name if key in COSTS else key for key in covariances]
    ax.set_yticks(heights, names if named else [""] * len(heights))
    ax.set_xscale("symlog", linthresh=1.0, linscale=0.7)
    write_out_ticks(ax.xaxis, (-10, -1, 0, 1, 10))
    ax.set(xlabel="I² (dB)", title=title, ylim=(-0.6, len(covariances) - 0.4), xlim=(-40, 40))
