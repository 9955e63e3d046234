"""The figures of the exhaustive evaluation."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from d2d.study.beyond.exhaustive import select
from d2d.study.book.grammar import BLACK, COSTS, COVARIANCES, GREY, SHARE_MAP, SKY, TRUTH
from d2d.study.book.style import write_out_ticks
from d2d.study.estimation.covariance_trials import CREDIBLE_INCLINATION
from d2d.study.plane.scenarios import OVERLAPPED, RANGES
from d2d.study.runs import StatedCovariances

# For each factor: the parameter of the trial and the label of the axis.
FACTORS: dict[str, tuple[str, str]] = {
    "noise": ("noise", "noise / nominal"),
    "size": ("size", "targets in a scan"),
    "outliers": ("outlier_share", "outliers (%)"),
    "overlap": ("overlap", "overlap (%)"),
    "spacing": ("spacing_m", "minimum spacing (m)"),
    "field": ("field_deg", "half field of view (°)"),
    "reported": ("reported", "stated / actual σ"),
}
# The costs as the stored results name them, and their keys in the grammar.
STORED = {"sum": "summing", "likelihood": "likelihood", "robust": "robust"}


def factor_cells(
    ax: Axes,
    rows: pd.DataFrame,
    measure: str,
    factor: str,
    costs: Mapping[str, Mapping[str, Any]],
    right: tuple[float, float],
) -> tuple[QuadMesh, NDArray[np.float64], NDArray[np.bool_]]:
    """Draw a column of the table over a factor in cells, a row for each cost that is selected.

    Frames enclose the shares (%) between both bounds.  Returns the mesh, the values of the factor
    and which cells of each row are framed.
    """
    parameter, words = FACTORS[factor]
    found = [select(rows, factor, **chosen).sort_values(parameter) for chosen in costs.values()]
    shares = 100.0 * np.array([each[measure] for each in found])
    values = found[0][parameter].to_numpy() * (100.0 if "%" in words else 1.0)
    look: dict[str, Any] = {"vmin": 0.0, "vmax": 100.0, "cmap": SHARE_MAP, "rasterized": True}
    mesh = ax.pcolormesh(shares, edgecolor="white", linewidth=0.5, **look)
    framed = (shares >= right[0]) & (shares <= right[1])
    for row, cells in enumerate(framed):
        for start, end in np.flatnonzero(np.diff([0, *cells, 0])).reshape(-1, 2):
            corner, size = (start + 0.15, row + 0.15), (end - start - 0.3, 0.7)
            ax.add_patch(Rectangle(corner, *size, fill=False, color=BLACK, lw=1.4))
    ax.set_xticks(np.arange(len(values)) + 0.5, [f"{value:g}" for value in values])
    ax.set_yticks(np.arange(len(costs)) + 0.5, list(costs))
    for text, chosen in zip(ax.get_yticklabels(), costs.values(), strict=False):
        text.set_color(COSTS[STORED[chosen["cost"]]].color)
    ax.set(xlabel=words, ylim=(len(costs), 0))
    ax.grid(False)
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)
    return mesh, values, framed


def start_map(ax: Axes, rows: pd.DataFrame, cost: str, scales: str, title: str) -> QuadMesh:
    """Draw success over the start's distance and rotation; lines enclose 9 in 10, and half."""
    chosen = select(rows, "start", cost=cost, scales=scales)
    shares = 100.0 * chosen.pivot_table("success", "turn_deg", "distance_m")
    places = shares.columns, shares.index, shares
    mesh = ax.pcolormesh(*places, vmin=0, vmax=100, cmap=SHARE_MAP, rasterized=True)
    lines = ax.contour(*places, [50.0, 90.0], colors="white", linestyles=["--", "-"])
    lines.set_path_effects([withStroke(linewidth=3.0, foreground=BLACK)])
    ax.grid(False)
    ax.set(xlim=(0, 20), ylim=(0, 90), xticks=[0, 10, 20], yticks=[0, 30, 60, 90])
    ax.set(xlabel="start off by (m)", ylabel="start off by (°)", title=title)
    return mesh


def first_scales(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of the factor "first scale" with the columns ``first`` and ``ratio``.

    The ratio is of the first scale's standard deviation across the line of sight to the distance.
    """
    chosen = select(rows, "first scale")
    first = chosen.scales.str.split().str[0].astype(float)
    cross_range = OVERLAPPED.sigma_azimuth * float(np.mean(RANGES))  # m
    return chosen.assign(first=first, ratio=first * chosen.noise * cross_range / chosen.distance_m)


def first_scale_panel(ax: Axes, rows: pd.DataFrame) -> None:
    """Draw success over first scale · σ / start error: all trials; lines of three noises."""
    trials = first_scales(rows)
    ax.plot(trials.ratio, 100.0 * trials.success, "o", color=GREY, ms=2.5, alpha=0.6)
    for noise, line in ((0.1, "-"), (0.5, "--"), (2.0, ":")):
        chosen = trials[(trials.noise == noise) & (trials.distance_m == 5.0)].sort_values("ratio")
        ax.plot(chosen.ratio, 100.0 * chosen.success, color=COSTS["robust"].color, ls=line)
    ax.axvspan(1.0, 500.0, color=SKY, alpha=0.15, lw=0)
    ax.set(xscale="log", xlim=(0.005, 500.0), ylim=(-3.0, 103.0))
    write_out_ticks(ax.xaxis, (0.01, 0.1, 1, 10, 100))
    ax.set(xlabel="first scale · σ / start error", ylabel="runs at the truth (%)")


def covariance_panel(ax: Axes, covariances: dict[str, StatedCovariances], title: str) -> None:
    """I^2 of both covariances, a row for each name, over the band of the credible ones."""
    band: dict[str, Any] = {"color": "0.9", "lw": 0, "label": "right within ±0.5 dB"}
    ax.axvspan(-CREDIBLE_INCLINATION, CREDIBLE_INCLINATION, **band)
    ax.axvline(0.0, **TRUTH)
    heights = np.arange(len(covariances))[::-1]
    kinds = ("inverse Hessian", "inverse Hessian", 0.2), ("propagated", "propagated noise", -0.2)
    found = [
        [both.credibility(kind).inclination for both in covariances.values()] for kind, *_ in kinds
    ]
    ax.plot(found, [heights + 0.2, heights - 0.2], color=GREY, lw=0.9, zorder=1.8)
    for (_, name, lift), values in zip(kinds, found, strict=True):
        ax.plot(values, heights + lift, **COVARIANCES[name].marks, ms=6)
    ax.set_yticks(heights, covariances)
    ax.set_xscale("symlog", linthresh=1.0, linscale=0.7)
    write_out_ticks(ax.xaxis, (-10, -1, 0, 1, 10))
    words = "← too large          I² (dB)          too small →"
    ax.set(xlabel=words, title=title, ylim=(-0.6, len(covariances) - 0.4), xlim=(-40, 40))
