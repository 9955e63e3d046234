"""The panels of the scenes on a line."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.point_set import PointSet
from d2d.study.book.style import BLACK, BLUE, GREEN, ORANGE, PINK, SKY, YELLOW
from d2d.study.line.scene import TRUTH
from d2d.study.line.surfaces import Peaks, log_surface, peaks, target_log_surfaces

TARGET_COLOURS = (ORANGE, BLUE, GREEN, PINK, YELLOW, SKY)


def line_targets(ax: Axes, points: PointSet, true: Array, names: Sequence[str]) -> None:
    """Targets of a 1D set: true position (circle), observed one (star), density (curve)."""
    low, high = true.min() - 2.0, true.max() + 2.0
    x = np.linspace(low, high, 1201)
    for k, name in enumerate(names):
        mean, variance = points.means[k, 0], points.covariances[k, 0, 0]
        density = np.exp(-0.5 * (x - mean) ** 2 / variance) / np.sqrt(2.0 * np.pi * variance)
        color = TARGET_COLOURS[k]
        ax.plot(x, density, color=color)
        ax.plot(true[k], 0.0, "o", mfc="none", color=color, clip_on=False)
        ax.plot(mean, 0.0, "*", ms=8, color=color, clip_on=False)
        ax.annotate(
            name,
            (mean, density.max()),
            (0, 3),
            textcoords="offset points",
            ha="center",
            color=color,
        )
    ax.set_xlabel("x (m)")
    ax.set_ylabel("density (1/m)")
    ax.set_ylim(0.0, None)
    ax.margins(y=0.15)


def surface(
    ax: Axes,
    translations: Array,
    values: Array,
    *,
    color: str = BLACK,
    label: str | None = None,
    ylabel: str = "density (1/m)",
) -> None:
    """A cost surface over t_x."""
    ax.plot(translations, values, color=color, label=label)
    ax.set_xlabel("$t_x$ (m)")
    ax.set_ylabel(ylabel)
    ax.margins(x=0.0)


def both_sets(
    axes: Sequence[Axes],
    sets: tuple[PointSet, PointSet],
    true: tuple[Array, Array],
    names: tuple[Sequence[str], Sequence[str]],
) -> None:
    """The previous set in the first panel, the current one in the second."""
    titles = ("previous set F", "current set M")
    for ax, points, positions, name, title in zip(axes, sets, true, names, titles, strict=False):
        line_targets(ax, points, positions, name)
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
    """The surface of each moving target, as a density or as a cost."""
    logs = target_log_surfaces(cost, translations, *sets)
    for k, name in enumerate(names):
        surface(
            ax,
            translations,
            -logs[k] if negative_log else np.exp(logs[k]),
            color=TARGET_COLOURS[k],
            label=name,
            ylabel="−log density" if negative_log else "density (1/m)",
        )
    ax.axvline(TRUTH, color="0.6", ls="--", lw=0.8)
    ax.set_title("targets, −log" if negative_log else "targets")


def fused(
    axes: Sequence[Axes],
    translations: Array,
    cost: RegistrationCost,
    sets: tuple[PointSet, PointSet],
    title: str,
) -> Peaks:
    """The fused surface, as a density in the first panel and as a cost in the second.

    Returns its peaks.
    """
    values = log_surface(cost, translations, *sets)
    surface(axes[0], translations, np.exp(values), ylabel="density")
    surface(axes[1], translations, -values, ylabel="−log density")
    for ax, suffix in zip(axes, ("", ", −log"), strict=False):
        ax.axvline(TRUTH, color="0.6", ls="--", lw=0.8)
        ax.set_title(title + suffix)
    return peaks(translations, values)
