"""What the chapters' figures share: the style, the colours, targets with their ellipses."""

from collections.abc import Mapping, Sequence
from importlib.resources import as_file, files
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from numpy.typing import NDArray
from scipy.stats import chi2

from d2d import rigid
from d2d._checks import Array
from d2d.credibility import Credibility
from d2d.point_set import PointSet
from d2d.radar import Mounting, RadarScan
from d2d.study.scenarios import Scenario

BLUE, ORANGE, GREEN, PINK, YELLOW, SKY, BLACK = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#56B4E9",
    "#000000",
)
FIXED, MOVING = BLUE, ORANGE
TARGET_COLORS = (ORANGE, BLUE, GREEN, PINK, YELLOW, SKY)
FAR = 45.0  # m: outliers beyond lie outside the scene
ERROR_LIMITS = {"m": (0.01, 12.0), "deg": (0.05, 50.0)}


def use_style() -> None:
    """Switch matplotlib to the book's style."""
    with as_file(files("d2d.study") / "book.mplstyle") as path:
        plt.style.use(path)


def letters(axes: NDArray[np.object_]) -> None:
    """Put (a), (b), ... before the titles of the panels."""
    for letter, ax in zip("abcdefghijkl", axes.ravel(), strict=False):
        title = ax.get_title()
        ax.set_title("")
        ax.set_title(f"({letter}) {title}" if title else f"({letter})", loc="left")


def ellipses(ax: Axes, points: PointSet, sigmas: float = 3.0, **style: Any) -> None:
    """The error ellipses of a planar point set, ``sigmas`` standard deviations wide."""
    angle = np.linspace(0.0, 2.0 * np.pi, 60)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    outline = points.means[:, None, :] + sigmas * np.swapaxes(
        np.linalg.cholesky(points.covariances) @ circle, -1, -2
    )
    settings: dict[str, Any] = {"facecolor": "none", "edgecolor": FIXED, "linewidth": 0.9} | style
    ax.add_collection(PolyCollection(list(outline), **settings))


def planar_axes(ax: Axes, title: str = "") -> None:
    """Equal scales in metres."""
    ax.set_aspect("equal", adjustable="box")
    ax.set_xlabel("x (m)")
    ax.set_ylabel("y (m)")
    ax.set_title(title)


def error_bands(ax: Axes, times: Array, errors: Array, sigma: Array, unit: str, name: str) -> None:
    """Errors as dots over the band of three estimated standard deviations."""
    ax.fill_between(times, -3.0 * sigma, 3.0 * sigma, color=SKY, alpha=0.45, lw=0, label="3σ")
    ax.plot(times, errors, ".", color=BLACK, ms=2, label="error")
    ax.set_ylabel(f"{name} ({unit})")
    ax.margins(x=0.0)


def line_targets(ax: Axes, points: PointSet, true: Array, names: Sequence[str]) -> None:
    """Targets of a 1D set: true position (circle), observed one (star), density (curve)."""
    low, high = true.min() - 2.0, true.max() + 2.0
    x = np.linspace(low, high, 1201)
    for k, name in enumerate(names):
        mean, variance = points.means[k, 0], points.covariances[k, 0, 0]
        density = np.exp(-0.5 * (x - mean) ** 2 / variance) / np.sqrt(2.0 * np.pi * variance)
        color = TARGET_COLORS[k]
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


def radar_scan(
    ax: Axes,
    scan: RadarScan,
    mounting: Mounting,
    pose: Array | None = None,
    *,
    seconds: float = 2.0,
) -> None:
    """A scan in the vehicle frame, or in the world if the vehicle's ``pose`` is given.

    Targets with their 3-sigma ellipses; a dashed line along the line of sight shows how far the
    Doppler velocity takes the target in so many seconds.
    """
    frame = mounting.pose if pose is None else rigid.compose(pose, mounting.pose)
    targets = PointSet.from_polar(scan.range, scan.azimuth, scan.sigma_range, scan.sigma_azimuth)
    placed = targets.transformed(frame)
    sight = placed.means - frame[:2]
    ends = placed.means + sight / np.linalg.norm(sight, axis=-1, keepdims=True) * (
        seconds * scan.doppler[:, None]
    )
    lines = np.stack([placed.means, ends], axis=1)
    ax.add_collection(LineCollection(list(lines), colors=ORANGE, linestyles="--", linewidths=0.8))
    ax.plot(*placed.means.T, "*", color=BLUE, ms=5)
    ellipses(ax, placed, edgecolor=BLUE, linewidth=0.7)
    ax.plot(*frame[:2], "^", color=BLACK)


def path(ax: Axes, poses: Array, *, color: str, label: str) -> None:
    """A driven path in metres."""
    ax.plot(poses[:, 0], poses[:, 1], color=color, label=label)


def planar_scene(ax: Axes, scenario: Scenario, fixed: PointSet, moving: PointSet) -> None:
    """Both scans of a scene, each in its own frame, with 3-sigma ellipses.

    Outliers have a ring around them: grey close to a target, green far from all.
    """
    for points, lone, color, name in (
        (fixed, scenario.outliers_fixed, FIXED, "previous F"),
        (moving, scenario.outliers_moving, MOVING, "current M"),
    ):
        ellipses(ax, points, edgecolor=color)
        ax.plot(*points.means.T, ".", color=color, ms=4, label=name)
        far = np.hypot(*lone.T) > FAR
        for mask, ring, kind in ((~far, "0.45", "close"), (far, GREEN, "far")):
            if mask.any():
                label = f"{kind} outlier" if color == FIXED else None
                ax.plot(*lone[mask].T, "o", color=ring, mfc="none", ms=15, mew=1.4, label=label)
    ax.plot(0.0, 0.0, "^", color=BLACK)
    planar_axes(ax)


def density_map(ax: Axes, offsets: Array, log_values: Array, title: str = "") -> None:
    """A fused density over t_x and t_y around the truth (cross), relative to the highest."""
    relative = np.exp(log_values - log_values.max())
    picture = ax.pcolormesh(offsets, offsets, relative, vmin=0.0, vmax=1.0, rasterized=True)
    _map_axes(ax, title)
    _map_bar(ax, picture, [0.0, 0.5, 1.0])


def cost_map(ax: Axes, offsets: Array, log_values: Array, title: str = "") -> None:
    """A cost over t_x and t_y around the truth, above its lowest value.

    Contours enclose where the density is above 50 %, 10 % and 1 % of its highest.
    """
    above = log_values.max() - log_values
    picture = ax.pcolormesh(offsets, offsets, above, cmap="viridis_r", rasterized=True)
    levels = -np.log([0.5, 0.1, 0.01])
    ax.contour(offsets, offsets, above, levels, colors=BLACK, linewidths=0.5)
    _map_axes(ax, title)
    _map_bar(ax, picture, None)


def _map_axes(ax: Axes, title: str) -> None:
    ax.plot(0.0, 0.0, "+", color=ORANGE, ms=9, mew=1.4)
    ax.grid(False)
    ax.set_aspect("equal")
    ax.set(xlabel="$t_x$ − truth (m)", ylabel="$t_y$ − truth (m)", title=title)


def _map_bar(ax: Axes, picture: Any, ticks: Sequence[float] | None) -> None:
    bar = ax.figure.colorbar(picture, ax=ax, shrink=0.8, pad=0.02, ticks=ticks)
    bar.ax.tick_params(labelsize=7)


def rotation_profiles(axes: Sequence[Axes], turns: Array, log_values: Array) -> None:
    """A density relative to its highest, and the cost above its lowest, over the rotation."""
    degrees = np.rad2deg(turns)
    above = log_values.max() - log_values
    for ax, values, label in (
        (axes[0], np.exp(-above), "density"),
        (axes[1], above, "−log density"),
    ):
        ax.plot(degrees, values, color=BLACK)
        ax.axvline(0.0, color=ORANGE, ls="--", lw=0.8)
        ax.set(xlabel="φ − truth (deg)", ylabel=label, ylim=(0.0, None))
        ax.margins(x=0.0)


def error_shares(ax: Axes, errors: Mapping[str, Array], unit: str, title: str = "") -> None:
    """Share of the runs whose error is below, for each named array of errors (N,).

    ``unit`` is m or deg.
    """
    for (name, values), color in zip(errors.items(), (ORANGE, BLUE, GREEN), strict=False):
        ordered = np.sort(values)
        share = np.arange(1, len(ordered) + 1) / len(ordered)
        ax.step(ordered, share, where="post", color=color, label=name)
    ax.set_xscale("log")
    ax.set(xlabel=f"error ({unit})", ylabel="share of runs", title=title, ylim=(0.0, 1.02))
    ax.set_xlim(*ERROR_LIMITS[unit])


def credibility_panels(axes: Sequence[Axes], result: Credibility, title: str = "") -> None:
    """NEES, NEES of the credible estimator and credibility ratio of every run, top to bottom.

    Bands: where 95 % of a credible estimator's NEES lie (chi-square with three degrees of freedom).
    """
    run = np.arange(len(result.nees))
    region = chi2.ppf([0.025, 0.975], 3)
    for ax, values, name in (
        (axes[0], result.nees, "NEES"),
        (axes[1], result.credible_nees, "credible NEES"),
    ):
        ax.axhspan(*region, color=SKY, alpha=0.4, lw=0)
        ax.plot(run, values, ".", color=BLACK, ms=1.5)
        ax.set_yscale("log")
        ax.set(ylabel=name, ylim=(5e-3, 1e3))
    axes[2].plot(run, 10.0 * np.log10(result.ratio), ".", color=BLACK, ms=1.5)
    axes[2].axhline(0.0, color=BLUE, lw=0.8)
    axes[2].axhline(result.inclination, color=ORANGE, ls="--", lw=1.0)
    axes[2].set(ylabel="ratio (dB)", xlabel="run", ylim=(-24.0, 24.0))
    axes[0].set_title(title)
    for ax in axes:
        ax.margins(x=0.0)


def basin_map(ax: Axes, distances: Array, turns: Array, shares: Array, title: str = "") -> Any:
    """Share of starts (turns, distances) that end at the truth; returns the coloured mesh."""
    picture = ax.pcolormesh(
        distances, np.rad2deg(turns), shares, vmin=0.0, vmax=1.0, shading="nearest", rasterized=True
    )
    ax.grid(False)
    ax.set(xlabel="start off by (m)", ylabel="start off by (deg)", title=title)
    return picture
