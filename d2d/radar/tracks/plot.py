"""The picture of a track: its path, its velocities with their uncertainty, its failures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from d2d._types import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOR, MARKER = "#009E73", "o"  # Okabe and Ito's bluish green, which colour-blind readers tell
LINE = (0, (6.0, 1.2, 1.2, 1.2))  # dash-dotted
ESTIMATE: dict[str, Any] = {"color": COLOR, "ls": LINE}
REFERENCE: dict[str, Any] = {"color": "#000000", "ls": "--", "lw": 0.9}
_LABELS = ("$v_x$ (m/s)", "$v_y$ (m/s)", "$ω$ (°/s)")
_FAILED = "black"


def draw(
    path: Array,
    times: Array,
    theta: Array,
    covariance: Array,
    converged: NDArray[np.bool_],
    inliers: Array | None,
    regions: Array,
) -> Figure:
    """Draw a path (n + 1, 3), velocities (n, 3) in a band of 3 sigma, and inliers (n,) if known.

    ``regions`` (m, k, 2) are the outlines of the position's 95 % regions along the path.
    The panels stand one below the other, so that the picture fits a phone.
    """
    from matplotlib import pyplot as plt

    rows = 3 + (inliers is not None)
    figure = plt.figure(figsize=(5.0, 3.2 + 1.0 * rows), layout="constrained")
    grid = figure.add_gridspec(1 + rows, height_ratios=(3.2, *[1.0] * rows))
    ax = figure.add_subplot(grid[0])
    ax.plot(path[:, 0], path[:, 1], **ESTIMATE, lw=1.5)
    ax.plot(*path[0, :2], MARKER, color=COLOR, label="start")
    for i, outline in enumerate(regions):
        ax.plot(*outline.T, color=COLOR, lw=0.8, label="_" if i else "95 %")
    if not converged.all():
        ax.plot(*path[1:][~converged, :2].T, "x", ms=4, color=_FAILED, label="failed")
    ax.set(xlabel="x (m)", ylabel="y (m)")
    ax.set_aspect("equal", adjustable="datalim")
    ax.legend()
    first = figure.add_subplot(grid[1])
    axes = [first, *(figure.add_subplot(grid[i], sharex=first) for i in range(2, 1 + rows))]
    in_units = np.array([1.0, 1.0, np.rad2deg(1.0)])
    shown = np.where(converged[:, None], theta, np.nan) * in_units
    spread = 3.0 * np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)) * in_units
    for ax, label, value, width in zip(axes, _LABELS, shown.T, spread.T, strict=False):
        ax.fill_between(
            times, value - width, value + width, color=COLOR, alpha=0.3, lw=0.0, label="±3 sigma"
        )
        ax.plot(times, value, **ESTIMATE, lw=1.0, label="estimate")
        ax.set_ylabel(label)
    if inliers is not None:
        axes[3].plot(times, inliers, MARKER, ms=2, color=COLOR)
        axes[3].set(ylabel="inlier share", ylim=(-0.05, 1.05))
    for ax in axes:
        if not converged.all():
            bottom = np.full(np.count_nonzero(~converged), 0.04)  # of the axes' height
            where = ax.get_xaxis_transform()
            ax.plot(times[~converged], bottom, "|", color=_FAILED, transform=where, label="failed")
        ax.tick_params(labelbottom=ax is axes[-1])
    axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, frameon=False)
    axes[-1].set_xlabel("time (s)")
    return figure
