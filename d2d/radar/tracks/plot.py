"""The picture of a track: its path, its velocities with their uncertainty, its failures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from d2d._types import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOR, MARKER = "#009E73", "o"  # Okabe and Ito's bluish green, which colour-blind readers tell
LINE = (0, (6.0, 1.2, 1.2, 1.2))  # dash-dotted
ESTIMATE: dict[str, Any] = {"color": COLOR, "ls": LINE}
REFERENCE: dict[str, Any] = {"color": "#000000", "ls": "--", "lw": 0.9}
_LABELS = ("$v_x$ (m/s)", "$v_y$ (m/s)", "$ω$ (°/s)")


def draw(driven: Any) -> Figure:
    """Draw the path of a `Track`, its velocities in a band of 3 sigma, and its inliers if known.

    The panels stand one below the other, so that the picture fits a phone.
    """
    from matplotlib import pyplot as plt

    path, times, converged = driven.poses(), driven.times, driven.converged
    rows = 3 + (driven.inliers is not None)
    figure = plt.figure(figsize=(5.5, 3.2 + rows), layout="constrained")
    grid = figure.add_gridspec(1 + rows, height_ratios=(3.5, *[1.0] * rows))
    ax = figure.add_subplot(grid[0])
    ax.plot(path[:, 0], path[:, 1], **ESTIMATE, lw=1.5)
    ax.plot(*path[0, :2], MARKER, color=COLOR, label="start")
    for i, outline in enumerate(_regions(driven)):
        ax.plot(*outline.T, color=COLOR, lw=0.8, label="_" if i else "95 %")
    if not converged.all():
        ax.plot(*path[1:][~converged, :2].T, "x", ms=4, color="black", label="failed")
    ax.set(xlabel="x (m)", ylabel="y (m)", aspect="equal", adjustable="datalim")
    ax.legend()
    first = figure.add_subplot(grid[1])
    axes = [first, *(figure.add_subplot(grid[i], sharex=first) for i in range(2, 1 + rows))]
    in_units = np.array([1.0, 1.0, np.rad2deg(1.0)])
    shown = np.where(converged[:, None], driven.theta, np.nan) * in_units
    spread = 3.0 * np.sqrt(np.diagonal(driven.covariance, axis1=1, axis2=2)) * in_units
    for ax, label, value, width in zip(axes, _LABELS, shown.T, spread.T, strict=False):
        ax.fill_between(times, value - width, value + width, color=COLOR, alpha=0.3, lw=0.0)
        ax.plot(times, value, **ESTIMATE, lw=1.0)
        ax.set_ylabel(label)
        if converged.any():  # a band may be thinner than its line
            middle = np.median(width[converged])
            unit = label.partition("(")[2].rstrip(")")
            ax.set_title(f"band: ±3 sigma, mostly ±{middle:.2g} {unit}", loc="right", fontsize=9)
    if driven.inliers is not None:
        axes[3].plot(times, driven.inliers, MARKER, ms=2, color=COLOR)
        axes[3].set(ylabel="inlier share", ylim=(-0.05, 1.05))
    for ax in axes:
        bottom = np.full(np.count_nonzero(~converged), 0.04)  # of the axes' height
        where = ax.get_xaxis_transform()
        ax.plot(times[~converged], bottom, "|", color="black", transform=where)
        ax.tick_params(labelbottom=ax is axes[-1])
    axes[-1].set_xlabel("time (s)")
    return figure


def _regions(driven: Any) -> Array:
    """Outlines (m, 60, 2) of the ellipses along the path; none without a budget."""
    accepted = driven.times[driven.converged]
    if driven.errors is None or not len(accepted):
        return np.empty((0, 60, 2))
    ends = np.unique(accepted[np.linspace(0, len(accepted) - 1, 9).astype(int)[1:]])
    began = driven.times[0] - driven.intervals[0]
    motion, covariance = driven.displacement(np.full(len(ends), began), ends)
    known = np.isfinite(motion).all(axis=1)
    angle = np.linspace(0.0, 2.0 * np.pi, 60)
    circle = np.sqrt(-2.0 * np.log(0.05)) * np.stack([np.cos(angle), np.sin(angle)])
    spread = np.linalg.cholesky(covariance[known, :2, :2]) @ circle
    return np.asarray(motion[known, None, :2] + np.swapaxes(spread, -1, -2))
