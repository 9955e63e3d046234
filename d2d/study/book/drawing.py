"""Drawings that several chapters share: ellipses, errors over time, intervals, scans."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from numpy.typing import ArrayLike

from d2d._types import Array
from d2d.point_set import PointSet
from d2d.radar import Mounting, RadarScan
from d2d.study.book.grammar import BLACK, FIXED, GREY, MOVING, OCHRE, set_marks


def ellipses(ax: Axes, points: PointSet, sigmas: float = 3.0, **style: Any) -> None:
    """The error ellipses of a planar point set, drawn at ``sigmas`` standard deviations."""
    angle = np.linspace(0.0, 2.0 * np.pi, 60)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    outline = points.means[:, None, :] + sigmas * np.swapaxes(
        np.linalg.cholesky(points.covariances) @ circle, -1, -2
    )
    settings: dict[str, Any] = {"facecolor": "none", "edgecolor": FIXED, "linewidth": 0.9} | style
    ax.add_collection(PolyCollection(list(outline), **settings))


def error_bands(ax: Axes, times: Array, errors: Array, sigma: Array, name: str, color: str) -> None:
    """Errors in the band of three estimated standard deviations; those outside are larger."""
    ax.fill_between(times, -3.0 * sigma, 3.0 * sigma, color=color, alpha=0.25, lw=0)
    outside = np.abs(errors) > 3.0 * sigma
    ax.scatter(times, errors, np.where(outside, 9.0, 2.5), np.where(outside, BLACK, GREY), lw=0)
    for side in (-3.0, 3.0):
        ax.plot(times, side * sigma, color=color, lw=1.0)
    ax.set_ylabel(name)
    ax.margins(x=0.0)


def intervals(ax: Axes, values: Array, bounds: Array, places: ArrayLike, **style: Any) -> None:
    """Values (n,) with bars between their bounds (n, 2), at these places of the y axis."""
    spread = np.abs(bounds.T - values)
    ax.errorbar(values, places, xerr=spread, ms=6, elinewidth=1.2, **style)


def label(ax: Axes, where: Any, text: str, color: str, shift: tuple[float, float]) -> None:
    """Write a name beside what it names, in its colour, shifted by points."""
    style: dict[str, Any] = {"textcoords": "offset points", "fontsize": 9.5, "clip_on": False}
    ax.annotate(text, where, shift, color=color, **style)


def radar_scan(ax: Axes, scan: RadarScan, mounting: Mounting, *, seconds: float = 2.0) -> None:
    """A scan in the vehicle frame.

    Targets are drawn with their 3-sigma ellipses; a dashed line along the line of sight shows how
    far the Doppler velocity moves each target in that many ``seconds``.
    """
    targets = PointSet.from_polar(scan.range, scan.azimuth, scan.sigma_range, scan.sigma_azimuth)
    placed = targets.transformed(mounting.pose)
    sight = placed.means - mounting.pose[:2]
    ends = placed.means + sight / np.linalg.norm(sight, axis=-1, keepdims=True) * (
        seconds * scan.doppler[:, None]
    )
    lines = np.stack([placed.means, ends], axis=1)
    ax.add_collection(LineCollection(list(lines), colors=OCHRE, linestyles="--", linewidths=0.8))
    ax.plot(*placed.means.T, **set_marks("moving") | {"ms": 4, "label": None})
    ellipses(ax, placed, edgecolor=MOVING, linewidth=0.7)
    ax.plot(mounting.x, mounting.y, "D", color=BLACK, mfc="none")
