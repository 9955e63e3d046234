"""The panels of the scenes on a line."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.point_set import PointSet
from d2d.study.book.grammar import BLACK, OUTLIER, TRUTH, cost_key, cost_line, set_marks
from d2d.study.book.style import write_out_ticks
from d2d.study.line import scene
from d2d.study.line.surfaces import Peaks, log_surface, peaks, target_log_surfaces

TARGETS = ("0.25", "0.45", "0.6", "0.25", "0.45")  # tints of grey; a target has a row of its own
SOFT = 2.0  # a cost above its minimum is drawn linearly below this, logarithmically above


def line_targets(
    ax: Axes, points: PointSet, true: Array, names: Sequence[str], marks: str = "fixed"
) -> None:
    """Draw a row for each target on a line: density, true place (hollow), observed (filled)."""
    x = np.linspace(true.min() - 6.0, true.max() + 6.0, 2401)
    variances = points.covariances[:, 0, 0]
    scaled = np.sqrt(2.0 * np.pi * variances[:, None])
    densities = np.exp(-0.5 * (x - points.means) ** 2 / variances[:, None]) / scaled
    _rows(ax, x, densities, names, 1.0 / scaled.min())
    for k, (name, mean) in enumerate(zip(names, points.means[:, 0], strict=True)):
        ax.plot(true[k], -k, **set_marks(marks) | {"mfc": "none", "ms": 7})
        ax.plot(mean, -k, **set_marks(marks) | {"ms": 4})
        if name == "O":
            ax.plot(mean, -k, **set_marks("outlier"))
    ax.set(xlabel="x (m)", xlim=(true.min() - 2.0, true.max() + 2.0))


def _rows(
    ax: Axes, x: Array, heights: Array, names: Sequence[str], highest: float, shade: float = 0.25
) -> None:
    """Draw curves (K, T) over x one below the other, all to one scale, named at the left."""
    for k, (name, height) in enumerate(zip(names, heights, strict=True)):
        color = OUTLIER if name == "O" else TARGETS[k]
        curve = 0.85 * height / highest - k
        ax.fill_between(x, -k, curve, color=color, alpha=shade, lw=0)
        ax.plot(x, curve, color=color, lw=1.2)
    ax.set_yticks(0.85 * heights[:, 0] / highest - np.arange(len(names)) + 0.08, names)
    ax.tick_params(axis="y", length=0)
    ax.set(ylim=(0.4 - len(names), 1.0))
    ax.margins(x=0.0)


def surface(
    ax: Axes, translations: Array, values: Array, *, ylabel: str = "density (1/m)", **style: Any
) -> None:
    """Draw a cost surface over t_x."""
    ax.plot(translations, values, **({"color": BLACK} | style))
    ax.set(xlabel="$t_x$ (m)", ylabel=ylabel, xmargin=0.0, ymargin=0.2)


def cost_surface(ax: Axes, translations: Array, log_values: Array, **style: Any) -> None:
    """Draw minus the logarithm of a surface, above its minimum: wells and walls on one scale."""
    surface(ax, translations, log_values.max() - log_values, ylabel="−log density", **style)
    if (highest := ax.dataLim.y1) > 20.0:
        ax.set_yscale("asinh", linear_width=SOFT)
        write_out_ticks(ax.yaxis, [tick for tick in (0, 10, 100, 1000) if tick < highest])
        finer = np.outer([1, 10, 100], range(1, 10)).ravel()  # which show that steps are uneven
        ax.set_yticks(finer[finer < highest], minor=True)


def both_sets(
    axes: Sequence[Axes],
    sets: tuple[PointSet, PointSet],
    true: tuple[Array, Array],
    names: tuple[Sequence[str], Sequence[str]],
) -> None:
    """Draw the previous set in the first panel, the current one in the second."""
    titles = {"fixed": "previous set F", "moving": "current set M"}
    panels = zip(axes, sets, true, names, titles.items(), strict=False)
    for ax, points, positions, letters, (marks, title) in panels:
        line_targets(ax, points, positions, letters, marks)
        ax.set_title(title)


def every_target(
    ax: Axes,
    translations: Array,
    cost: RegistrationCost,
    sets: tuple[PointSet, PointSet],
    names: Sequence[str],
    *,
    negative_log: bool = False,
) -> None:
    """Draw the surface of each moving target, as a density or as a cost, in a row of its own."""
    logs = target_log_surfaces(cost, translations, *sets)
    if negative_log:
        wells = logs.max(axis=1, keepdims=True) - logs
        _rows(ax, translations, wells, names, float(wells.max()), shade=0.0)
    else:
        peaks_of_p2d = sets[0].weights / np.sqrt(2.0 * np.pi * sets[0].covariances[:, 0, 0])
        highest = max(float(peaks_of_p2d.max()), float(np.exp(logs).max()))
        _rows(ax, translations, np.exp(logs), names, highest)
    ax.axvline(scene.TRUTH, **TRUTH)
    ax.set(xlabel="$t_x$ (m)", title="targets of M, −log" if negative_log else "targets of M")


def fused(
    axes: Sequence[Axes],
    translations: Array,
    cost: RegistrationCost,
    sets: tuple[PointSet, PointSet],
    title: str,
) -> Peaks:
    """Draw the fused surface as a density, in a second panel as a cost, and return its peaks."""
    values = log_surface(cost, translations, *sets)
    style = cost_line(cost_key(cost), cost.metric)
    unit = "1/m" if cost.fusion == "summing" else f"1/m$^{sets[1].size}$"
    surface(axes[0], translations, np.exp(values), ylabel=f"density ({unit})", **style)
    if len(axes) > 1:
        cost_surface(axes[1], translations, values, **style)
    for ax, low, words in zip(axes, (0.86, 0.0), ("", ", −log"), strict=False):
        ax.axvline(scene.TRUTH, low, **TRUTH)
        ax.set_title(title + words, color=style["color"])
    return peaks(translations, values)
