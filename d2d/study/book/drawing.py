"""Drawings that several chapters share: ellipses, errors over time, intervals."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from numpy.typing import ArrayLike

from d2d._types import Array
from d2d.point_set import PointSet
from d2d.study.book.grammar import BLACK, FIXED, SKY


def ellipses(ax: Axes, points: PointSet, sigmas: float = 3.0, **style: Any) -> None:
    """The error ellipses of a planar point set, drawn at ``sigmas`` standard deviations."""
    angle = np.linspace(0.0, 2.0 * np.pi, 60)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    outline = points.means[:, None, :] + sigmas * np.swapaxes(
        np.linalg.cholesky(points.covariances) @ circle, -1, -2
    )
    settings: dict[str, Any] = {"facecolor": "none", "edgecolor": FIXED, "linewidth": 0.9} | style
    ax.add_collection(PolyCollection(list(outline), **settings))


def error_bands(ax: Axes, times: Array, errors: Array, sigma: Array, unit: str, name: str) -> None:
    """Errors as dots in the band of three estimated standard deviations, whose edges are drawn."""
    ax.fill_between(times, -3.0 * sigma, 3.0 * sigma, color=SKY, alpha=0.45, lw=0, label="3σ")
    ax.plot(times, errors, ".", color=BLACK, ms=1.5, label="error")
    for side in (-3.0, 3.0):
        ax.plot(times, side * sigma, color=SKY, lw=1.0)
    ax.set_ylabel(f"{name} ({unit})")
    ax.margins(x=0.0)


def intervals(ax: Axes, values: Array, bounds: Array, places: ArrayLike, **style: Any) -> None:
    """Values (n,) with bars between their bounds (n, 2), at these places of the y axis."""
    spread = np.abs(bounds.T - values)
    ax.errorbar(values, places, xerr=spread, ms=6, elinewidth=1.2, **style)


def label(ax: Axes, where: Any, text: str, color: str, shift: tuple[float, float]) -> None:
    """Write a name beside what it names, in its colour, shifted by points."""
    style: dict[str, Any] = {"textcoords": "offset points", "fontsize": 9.5, "clip_on": False}
    ax.annotate(text, where, shift, color=color, **style)
