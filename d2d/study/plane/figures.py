"""The figures of the scenes in the plane: a scene, its cost surfaces, errors and credibility."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import scipy
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, QuadMesh
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from scipy.ndimage import maximum_filter

from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.point_set import PointSet
from d2d.study.book.claim import DECIBELS
from d2d.study.book.drawing import ellipses, error_bands, label
from d2d.study.book.grammar import (
    BLACK,
    COST_MAP,
    GREY,
    SETS,
    TRUTH,
    cost_line,
    mark_truth,
    set_marks,
)
from d2d.study.book.grammar import COSTS as LOOKS
from d2d.study.book.style import PAGE, headline, label_planar_axes, letter_panels, write_out_ticks
from d2d.study.plane.evaluation import COSTS, STARTS, distance_and_rotation, evaluated, rms
from d2d.study.plane.optima import rotation_profile, translation_surface
from d2d.study.plane.scenarios import Scenario

FAR = 45.0  # m: outliers beyond this range lie outside the scene
ERROR_LIMITS = {"m": (0.01, 12.0), "°": (0.05, 50.0)}
OFFSETS: Array = np.linspace(-8.0, 8.0, 129)  # from the true translation, in m
LOWEST_COST = 0.3  # that can be told from the minimum
SCALE = (1, 10, 100, 1000)  # of the colours of −log density above its minimum, a logarithm
LEVELS = (1, 10, 30, 100, 300, 1000)
ROTATIONS: Array = np.deg2rad(np.linspace(-40.0, 40.0, 321))
IN_LABEL_UNITS = np.array([1.0, 1.0, np.rad2deg(1.0)])
LABELS = "$t_x$ (m)", "$t_y$ (m)", r"$\varphi$ (°)"
SEEN = {"summing": "sum: wells", "likelihood": "likelihood: bowl", "robust": "robust: one well"}
SOFT = 3.0  # dB up to which the axis of the credibility ratios is about linear
Place = tuple[int, str, float, float]  # of a name: panel, cost, and coordinates


def one_draw(scenario: Scenario, seed: int = 1) -> tuple[PointSet, PointSet]:
    """One draw of the noise: the fixed and the moving set."""
    fixed, moving = scenario.sample(1, np.random.default_rng(seed))
    return fixed[0], moving[0]


def cost_panels(
    scenario: Scenario,
    sets: tuple[PointSet, PointSet],
    costs: Mapping[str, RegistrationCost],
    finding: str,
    seen: Mapping[str, str] = SEEN,
    zoom: float = 1.0,
) -> None:
    """Draw a map of each cost over the translation, and all costs over the rotation in one panel.

    There are two figures: for a phone, and as wide as the page.
    """
    offsets, degrees = OFFSETS / zoom, np.rad2deg(ROTATIONS) / zoom
    for layout, size, high in (("ab;cd", (5.5, 6.2), 1.0), ("abc;ddd", (PAGE, 5.6), 1.5)):
        figure, panels = plt.subplot_mosaic(layout, figsize=size, height_ratios=(high, 1.0))
        *maps, cuts = panels.values()
        for letter, ax, (name, cost) in zip("abc", maps, costs.items(), strict=True):
            below, look = name != "likelihood", LOOKS[name]
            surface = translation_surface(cost, *sets, scenario.theta, offsets)
            mesh = cost_map(ax, offsets, surface, f"({letter}) {seen[name]}")
            mark_wells(ax, offsets, surface)
            profile = rotation_profile(cost, *sets, scenario.theta, np.deg2rad(degrees))
            above = np.maximum(profile.max() - profile, LOWEST_COST)
            cuts.plot(degrees, above, **cost_line(name))
            last = slice(255 if below else 220, None)
            place = degrees[last][0], above[last].min() if below else above[last].max()
            label(cuts, place, look.name.split()[0], look.color, (0, -11 if below else 2))
        cuts.axvline(0.0, **TRUTH)
        cuts.set(yscale="log", ylim=(LOWEST_COST, 8e3), title="(d) over the rotation")
        cuts.set(xlabel=r"$\varphi$ − truth (°)", ylabel="−log density", xmargin=0.0)
        cost_bar(figure, mesh, maps)
        headline(figure, finding)


def error_panels(
    scenario: Scenario, names: Sequence[str], finding: str, places: Iterable[Place]
) -> None:
    """Draw the share of the runs below each error, one row of panels a start, names at places."""
    figure, axes = plt.subplots(len(STARTS), 2, sharey=True, figsize=(5.5, 5.3))
    for row, start in zip(axes, STARTS, strict=True):
        errors = {name: evaluated(scenario, COSTS[name], start).errors for name in names}
        error_shares(row, errors, (f"translation, from {start}", f"rotation, from {start}"))
    name_curves(axes.ravel(), places)
    headline(figure, finding)
    letter_panels(axes)


def bounds_columns(scenario: Scenario, names: Sequence[str], finding: str) -> None:
    """Errors of 200 runs in order of their stated sigmas, a column per cost, phone and page."""
    results = [evaluated(scenario, COSTS[name]) for name in names]
    sigmas = [
        np.sqrt(np.diagonal(r.covariances, axis1=1, axis2=2)) * IN_LABEL_UNITS for r in results
    ]
    limits = 6.5 * np.max([np.nanmedian(s, axis=0) for s in sigmas], axis=0)
    for size in ((5.5, 5.9), (PAGE, 4.6)):
        figure, axes = plt.subplots(3, len(names), sharex=True, sharey="row", figsize=size)
        columns = zip(axes.T, "abc", names, results, sigmas, strict=False)
        for column, letter, name, result, sigma in columns:
            column[0].set_title(f"({letter}) {LOOKS[name].name}")
            errors = result.errors * IN_LABEL_UNITS
            for k, ax in enumerate(column):
                ax.set_ylim(-limits[k], limits[k])
                order = np.argsort(sigma[:200, k])
                shown = errors[order, k], sigma[order, k]
                error_bands(ax, np.arange(200.0), *shown, LABELS[k], LOOKS[name].color)
                ratio = np.nanmedian(sigma[:, k]) / rms(errors[:, k])
                look: dict[str, Any] = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
                words = f"stated {ratio:.1f} × actual"
                ax.text(5.0, 0.78 * limits[k], words, fontsize=9, bbox=look)
                ax.set_xlabel("run, by its stated σ")
                ax.label_outer()
        headline(figure, finding)


def credibility_columns(scenario: Scenario, names: Sequence[str], finding: str) -> None:
    """Histograms of the NEES of all runs, a column per cost, and of the credibility ratios below.

    A black line has the runs of a credible estimator in each bin of the NEES.
    """
    figure = plt.figure(figsize=(5.5, 4.7))
    above, below = figure.subfigures(2, squeeze=False)[:, 0]
    edges = np.geomspace(1e-2, 1e3, 41)
    axes = above.subplots(1, len(names), sharey=True)
    for letter, ax, name in zip("abc", axes, names, strict=False):
        nees = evaluated(scenario, COSTS[name]).credibility.nees
        ax.hist(np.clip(nees, edges[0], edges[-1]), edges, color=LOOKS[name].color, alpha=0.6)
        expected = len(nees) * np.diff(scipy.special.chdtr(3, edges))
        ax.stairs(expected, edges, color=BLACK, label="credible")
        ax.set(xscale="log", xlabel="NEES", title=f"({letter}) {LOOKS[name].name}")
        write_out_ticks(ax.xaxis, (0.01, 1, 100))
        ax.margins(y=0.25)
    axes[0].set_ylabel("runs")
    axes[0].legend(loc="upper center", borderaxespad=0.0, handlelength=1.2)
    credibility_ratios(below.subplots(), scenario, names)
    below.axes[0].set_title("(d) credibility ratios, and their mean, I²")
    headline(figure, finding)


def credibility_ratios(ax: Axes, scenario: Scenario, names: Sequence[str]) -> None:
    """Draw the distribution of the credibility ratio of each cost, a row each, with its mean."""
    edges = SOFT * np.sinh(np.linspace(-1.0, 1.0, 97) * np.arcsinh(24.0 / SOFT))  # as drawn
    verdicts = []
    for row, name in enumerate(names):
        result, look = evaluated(scenario, COSTS[name]).credibility, LOOKS[name]
        decibels = np.clip(10.0 * np.log10(result.ratio), edges[0], edges[-1])
        counts = np.histogram(decibels, edges)[0]
        heights = 0.8 * counts / counts.max() - row
        ax.stairs(heights, edges, baseline=-row, fill=True, color=look.color, alpha=0.6)
        ax.plot([result.inclination] * 2, (-row, 0.8 - row), color=BLACK, lw=1.2)
        mean = f"{round(result.inclination, 1) + 0.0:+.1f}".replace("-", "−")
        side = "small" if result.inclination > 0.0 else "large"
        verdict = "fits" if abs(result.inclination) <= DECIBELS.high else f"σ too {side}"
        verdicts.append(f"{look.name.split()[0]}\n{mean} dB: {verdict}")
    ax.set_yticks(-np.arange(len(names)), verdicts, va="bottom", linespacing=1.0)
    for text, name in zip(ax.get_yticklabels(), names, strict=True):
        text.set_color(LOOKS[name].color)
    ax.axvline(0.0, **TRUTH)
    ax.set_xscale("asinh", linear_width=SOFT)
    write_out_ticks(ax.xaxis, (-20, -10, -5, -2, 0, 2, 5, 10, 20))
    ax.set_xticks(range(-24, 25), minor=True)  # which show that steps are uneven
    ax.set(xlabel="ratio (dB)", xlim=(edges[0], edges[-1]), ylim=(-len(names) + 0.9, 1.0))
    ax.tick_params(axis="y", length=0)


def planar_scene(
    ax: Axes, scenario: Scenario, fixed: PointSet, moving: PointSet, *, sigmas: float = 3.0
) -> None:
    """Both scans of a scene, each in its own frame, with ellipses of so many standard deviations.

    A thin line joins what both scans see of a target.  A ring marks each outlier: thin if it is
    close to a target, thick if it is far from all.
    """
    pairs = np.stack([fixed.means, moving.means], axis=1)[: len(scenario.targets)]
    ax.add_collection(LineCollection(list(pairs), colors=GREY, linewidths=0.4, zorder=1))
    for points, outliers, name, words in (
        (fixed, scenario.outliers_fixed, "fixed", "previous F"),
        (moving, scenario.outliers_moving, "moving", "current M"),
    ):
        ellipses(ax, points, sigmas, edgecolor=SETS[name].color)
        ax.plot(*points.means.T, **set_marks(name) | {"ms": 4, "label": words})
        seen, far = points.means[len(scenario.targets) :], np.hypot(*outliers.T) > FAR
        for mask, width, kind in ((~far, 1.2, "close"), (far, 2.8, "far")):
            if mask.any():
                named = {"label": f"{kind} outlier"} if name == "fixed" else {"label": None}
                ax.plot(*seen[mask].T, **set_marks("outlier") | {"mew": width} | named)
    ax.plot(0.0, 0.0, "D", color=BLACK, mfc="none", label="sensor")
    label_planar_axes(ax)


def cost_map(ax: Axes, offsets: Array, log_values: Array, title: str = "") -> QuadMesh:
    """Draw a cost over t_x and t_y around the truth (cross), above its minimum.

    All maps have one logarithmic scale, `SCALE`; its 64 colours all fit into a picture's palette.
    """
    above = np.maximum(log_values.max() - log_values, LOWEST_COST)
    settings: dict[str, Any] = {"cmap": plt.get_cmap(COST_MAP, 64), "norm": LogNorm(1, SCALE[-1])}
    mesh = ax.pcolormesh(offsets, offsets, above, rasterized=True, **settings)
    lines = ax.contour(offsets, offsets, above, LEVELS, colors="white", linewidths=0.7)
    spans = [[np.ptp(line) for line in level if line.size] for level in lines.allsegs]
    long = [max(each, default=0.0) > 0.22 * np.ptp(offsets) for each in spans]
    ax.clabel(lines, np.asarray(lines.levels)[long], fontsize=9)
    ax.grid(False)
    ax.set(aspect="equal", title=title)
    ax.locator_params(nbins=4, steps=[1, 2, 5, 10])
    ax.set_xlabel("$t_x$ − truth (m)")
    spec = ax.get_subplotspec()
    if spec is None or spec.is_first_col():
        ax.set_ylabel("$t_y$ − truth (m)")
    mark_truth(ax)
    return mesh


def mark_wells(ax: Axes, offsets: Array, log_values: Array) -> int:
    """Number of the minima less than 10 above the lowest; dots mark all but the lowest."""
    highest = log_values.max()
    peaks = (log_values == maximum_filter(log_values, 5)) & (log_values > highest - 10.0)
    inside = np.argwhere(peaks[4:-4, 4:-4]) + 4  # a minimum beside the border may be none
    others = inside[log_values[tuple(inside.T)] < highest]
    ax.plot(*offsets[others].T[::-1], "o", color="white", ms=4, mec=BLACK, mew=0.6)
    return len(inside)


def cost_bar(figure: Figure, mesh: QuadMesh, axes: Sequence[Axes]) -> None:
    """Draw the one colour bar of all maps below them."""
    settings: dict[str, Any] = {"location": "bottom", "shrink": 0.7, "aspect": 35, "pad": 0.02}
    bar = figure.colorbar(mesh, ax=axes, extend="both", label="−log density", **settings)
    write_out_ticks(bar.ax.xaxis, SCALE)


def error_shares(
    axes: Sequence[Axes],
    errors: Mapping[str, Array],
    titles: Sequence[str] = ("translation", "rotation"),
) -> None:
    """Draw the share of runs below each error (N, 3) of a cost."""
    for name, of_runs in errors.items():
        distance, turn = distance_and_rotation(of_runs)
        share = 100.0 * np.arange(1, len(of_runs) + 1) / len(of_runs)
        for ax, values in zip(axes, (distance, np.rad2deg(turn)), strict=False):
            ax.step(np.sort(values), share, where="post", **cost_line(name))
    for ax, title, (unit, limits) in zip(axes, titles, ERROR_LIMITS.items(), strict=False):
        ax.set(xscale="log", xlabel=f"error ({unit})", title=title)
        write_out_ticks(ax.xaxis, (0.01, 0.1, 1, 10))
        ax.set(ylabel="runs (%)", ylim=(0.0, 102.0), xlim=limits)


def name_curves(axes: Sequence[Axes], places: Iterable[Place]) -> None:
    """Write the names of costs beside their curves, in their colours."""
    for panel, name, *where in places:
        label(axes[panel], where, LOOKS[name].name.split()[0], LOOKS[name].color, (0, 0))
