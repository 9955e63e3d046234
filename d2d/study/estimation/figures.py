"""The figures of estimation: optimiser paths, also as frames of an animation; error propagation."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm

from d2d._types import Array
from d2d.study.book.drawing import intervals, label
from d2d.study.book.grammar import BLACK, COST_MAP, COVARIANCES, GREY, OCHRE, PURPLE, TRUTH
from d2d.study.book.style import write_out_ticks
from d2d.study.estimation.descent import PairedTargets, profile
from d2d.study.estimation.optimisers import Path
from d2d.study.runs import StatedCovariances

# Of each path: its colour, and its name with its place in the plane of t_y (m) and phi (degrees).
LOOKS = {
    "gradient descent": (OCHRE, (-0.172, 4.6), "gradient\ndescent\nsteps: {}"),
    "Newton": (PURPLE, (0.4, -0.6), "Newton, steps: {}"),
    "Gauss-Newton": (BLACK, (0.17, 4.2), "Gauss-Newton and\nLevenberg-Marquardt,\nsteps: {}"),
}


def draw_paths(
    ax: Axes, problem: PairedTargets, paths: Mapping[str, Path], iteration: int | None = None
) -> None:
    """Draw the paths, or up to an iteration on contours, over the profiled cost of t_y and phi."""
    ends = np.concatenate([path.points[:, 1:] for path in paths.values()])
    margin = 0.2 * np.ptp(ends, axis=0)
    t_y, angle = np.linspace(ends.min(axis=0) - margin, ends.max(axis=0) + margin, 81).T
    cost = profile(problem, t_y, angle)
    levels = cost.min() + np.geomspace(1.0, float(np.ptp(cost)), 14)
    filled: dict[str, Any] = {"cmap": COST_MAP, "norm": LogNorm(), "extend": "both"}
    lines: dict[str, Any] = {"colors": GREY, "linewidths": 0.5}
    draw, look = (ax.contourf, filled) if iteration is None else (ax.contour, lines)
    draw(t_y, np.rad2deg(angle), cost - cost.min() + 1.0, levels - cost.min(), **look)
    box = {"facecolor": "white", "edgecolor": "none", "pad": 2.0}
    for name, (color, place, words) in LOOKS.items():
        points = paths[name].points[: None if iteration is None else iteration + 1, 1:]
        drawn = points[:, 0], np.rad2deg(points[:, 1])
        ax.plot(*drawn, "-", color="white", lw=4.5)
        ax.plot(*drawn, ".-", color=color, ms=7, lw=2.0)
        ax.plot(drawn[0][-1], drawn[1][-1], "o", color=color, mec="white", ms=8)
        text = words.format(len(points) - 1) if len(points) > 1 else ""
        ax.text(*place, text, color=color, fontsize=9, bbox=box)
    ax.grid(False)
    ax.set(xlabel="$t_y$ (m)", ylabel=r"$\varphi$ (°)")


def propagation_panel(
    ax: Axes,
    function: Callable[[Array], Array],
    slope: Callable[[float], float],
    centres: Sequence[float],
    sigma: float,
    rng: np.random.Generator,
) -> None:
    """Inputs N(x0, sigma^2) below, sampled (grey), propagated outputs beside; chords: 2 sigma."""
    low, high = min(centres) - 4.0 * sigma, max(centres) + 4.0 * sigma
    x = np.linspace(low, high, 600)
    y = function(x)
    ax.plot(x, y, color=BLACK)
    size_x, size_y = 0.18 * float(np.ptp(y)), 0.22 * (high - low)
    bottom, left = float(y.min()) - 0.25 * float(np.ptp(y)), low - 0.3 * (high - low)
    units = np.linspace(-4.0, 4.0, 200)
    bell = np.exp(-0.5 * units**2)
    for color, x0 in zip((OCHRE, PURPLE), centres, strict=False):
        y0, spread = float(function(np.array(x0))), abs(slope(x0)) * sigma
        inputs, density = x0 + sigma * units, bottom + size_x * bell
        ax.fill_between(inputs, bottom, density, color=color, alpha=0.4, lw=0)
        ax.plot(inputs, y0 + slope(x0) * (inputs - x0), "--", color=color)
        counts, edges = np.histogram(function(rng.normal(x0, sigma, 20_000)), 60, density=True)
        scale = size_y * spread * np.sqrt(2.0 * np.pi)
        ax.barh(edges[:-1], scale * counts, np.diff(edges), left, align="edge", color="0.8")
        ax.plot(left + size_y * bell, y0 + spread * units, color=color)
        ax.plot(x0, y0, "o", color=color)
        ax.plot([x0, x0, left], [bottom, y0, y0], ":", color=color, lw=0.8)
        height, width = np.exp(-0.5) * np.array([size_x, size_y]) + [bottom, left]
        ax.plot([x0 - sigma, x0 + sigma], [height, height], color=color)
        ax.plot([width, width], [y0 - spread, y0 + spread], color=color)
        label(ax, (x0 + sigma, height), f"σ = {sigma:g}", color, (3, 0))
        label(ax, (width, y0 + spread), f"σ = {spread:g}", color, (3, 0))
    ax.set(xlabel="x", ylabel="y", xlim=(left, high), ylim=(bottom, None))


def stated_over_actual(ax: Axes, studies: Mapping[str, tuple[str, StatedCovariances]]) -> None:
    """Mark the stated over the actual variance of t_x, t_y and phi, a group of rows for each cost.

    ``studies`` are by the group's name; marks are medians, lines reach from 5 % to 95 %.
    """
    names: list[str] = []
    for name, (_, study) in studies.items():
        rows = len(names) + np.arange(3)
        names += [f"{name}  $t_x$", "$t_y$", r"$\varphi$"]
        for kind, look, shift in (
            ("inverse Hessian", "inverse Hessian", -0.17),
            ("propagated", "propagated noise", 0.17),
        ):
            stated = np.diagonal(study.covariances[kind], axis1=1, axis2=2)
            low, middle, high = np.quantile(stated / study.errors.var(axis=0), [0.05, 0.5, 0.95], 0)
            marks = COVARIANCES[look].marks | {"label": look if rows[0] == 0 else None}
            intervals(ax, middle, np.stack([low, high], axis=-1), rows + shift, **marks)
        ax.axhline(rows[-1] + 0.5, color="0.8", lw=0.8)
    ax.axvline(1.0, **TRUTH)
    ax.set_yticks(range(len(names)), names)
    words = "← too small     stated / actual variance     too large →"
    ax.set(xscale="log", xlabel=words, ylim=(len(names) - 0.5, -0.5))
    write_out_ticks(ax.xaxis, (0.5, 1, 2, 4, 8, 16))
    ax.grid(axis="y", visible=False)
