"""The panels that the chapters on one-dimensional scenes share."""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes

from d2d._checks import Array
from d2d.cost import RegistrationCost
from d2d.point_set import PointSet
from d2d.study import drawing
from d2d.study.line_scene import TRUTH
from d2d.study.surfaces import Peaks, log_surface, peaks, target_log_surfaces


def both_sets(
    axes: Sequence[Axes],
    sets: tuple[PointSet, PointSet],
    true: tuple[Array, Array],
    names: tuple[Sequence[str], Sequence[str]],
) -> None:
    """The previous set in the first panel, the current one in the second."""
    titles = ("previous set F", "current set M")
    for ax, points, where, name, title in zip(axes, sets, true, names, titles, strict=False):
        drawing.line_targets(ax, points, where, name)
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
        drawing.surface(
            ax,
            translations,
            -logs[k] if negative_log else np.exp(logs[k]),
            color=drawing.TARGET_COLORS[k],
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
    """The fused surface as a density in the first panel and as a cost in the second."""
    values = log_surface(cost, translations, *sets)
    drawing.surface(axes[0], translations, np.exp(values), ylabel="density")
    drawing.surface(axes[1], translations, -values, ylabel="−log density")
    for ax, suffix in zip(axes, ("", ", −log"), strict=False):
        ax.axvline(TRUTH, color="0.6", ls="--", lw=0.8)
        ax.set_title(title + suffix)
    return peaks(translations, values)


def propagation(
    ax: Axes,
    function: Callable[[Array], Array],
    slope: Callable[[float], float],
    centres: Sequence[float],
    sigma: float,
    rng: np.random.Generator,
) -> None:
    """Inputs N(x0, sigma^2) under a curve, their sampled outputs beside it, and the tangent's.

    The input's density stands on the x axis.  On the y axis grey bars are 20 000 sampled outputs,
    lines the densities N(f(x0), (f'(x0) sigma)^2) of first-order propagation.
    """
    low, high = min(centres) - 6.0 * sigma, max(centres) + 6.0 * sigma
    x = np.linspace(low, high, 600)
    y = function(x)
    ax.plot(x, y, color=drawing.BLACK)
    size_x, size_y = 0.18 * float(np.ptp(y)), 0.22 * (high - low)
    bottom, left = float(y.min()) - 0.25 * float(np.ptp(y)), low - 0.3 * (high - low)
    for color, x0 in zip((drawing.ORANGE, drawing.BLUE), centres, strict=False):
        y0, spread = float(function(np.array(x0))), abs(slope(x0)) * sigma
        near = x0 + sigma * np.linspace(-4.0, 4.0, 200)
        ax.fill_between(
            near,
            bottom,
            bottom + size_x * np.exp(-0.5 * ((near - x0) / sigma) ** 2),
            color=color,
            alpha=0.4,
            lw=0,
        )
        ax.plot(near, y0 + slope(x0) * (near - x0), "--", color=color)
        counts, edges = np.histogram(function(rng.normal(x0, sigma, 20_000)), 60, density=True)
        scale = size_y * spread * np.sqrt(2.0 * np.pi)
        ax.barh(edges[:-1], scale * counts, np.diff(edges), left, align="edge", color="0.8")
        outputs = y0 + spread * np.linspace(-4.0, 4.0, 200)
        density = np.exp(-0.5 * ((outputs - y0) / spread) ** 2)
        ax.plot(left + size_y * density, outputs, color=color)
        ax.plot(x0, y0, "o", color=color)
        ax.plot([x0, x0, left], [bottom, y0, y0], ":", color=color, lw=0.8)
    ax.set(xlabel="x", ylabel="y", xlim=(left, high), ylim=(bottom, None))
