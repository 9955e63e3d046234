"""Animated scans in the vehicle frame, each target coloured by how far it is trusted."""

from collections.abc import Sequence
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from d2d._types import Array
from d2d.radar import Mounting, RadarScan
from d2d.study.book import slider
from d2d.study.book.grammar import BLACK, MOVING, OUTLIER, PINK

MARGIN = 3.0  # m around the targets
# Classes of the inlier probability: lower and upper limit, colour, label.
CLASSES = (
    (-1.0, 0.2, OUTLIER, "below 0.2"),
    (0.2, 0.8, PINK, "0.2 to 0.8"),
    (0.8, 1.01, MOVING, "above 0.8"),
)


class WeighedScan(NamedTuple):
    """The scan of one sensor, and the inlier probability (K,) of each of its targets."""

    scan: RadarScan
    mounting: Mounting
    probabilities: Array

    @property
    def positions(self) -> Array:
        """Positions (K, 2) of the targets in the vehicle frame, in m."""
        angle = self.scan.azimuth + self.mounting.yaw
        sight = np.column_stack([np.cos(angle), np.sin(angle)])
        return np.asarray(self.mounting.pose[:2] + self.scan.range[:, None] * sight)


Epoch = Sequence[WeighedScan]
"""The scans of several sensors at about one time."""


def animate_scans(name: str, epochs: Sequence[Epoch], ahead: float = 60.0) -> str:
    """Animate epochs, with ``ahead`` metres in front of the vehicle in the picture.

    The x axis, forward, points up.  The picture shows as much of the ground as nearly all targets
    need that are not farther than ``ahead``.
    """
    positions = np.concatenate([view.positions for views in epochs for view in views])
    x, y = positions[np.hypot(*positions.T) < ahead].T
    low, high = np.percentile(x, [3.0, 97.0]) + np.array([-MARGIN, MARGIN])
    aside = float(np.percentile(np.abs(y), 97.0)) + MARGIN
    frames, captions = [], []
    for views in epochs:
        time = views[0].scan.time - epochs[0][0].scan.time
        shares = np.concatenate([view.probabilities for view in views])
        mean = shares.mean() if len(shares) else 0.0
        words = f"{time:.2f} s: {len(shares)} targets, mean inlier probability {mean:.2f}"
        figure = draw_epoch(views)
        figure.axes[0].set(xlim=(-aside, aside), ylim=(min(low, -5.0), max(high, 5.0)))
        frames.append(slider.picture(figure, f"Targets around the vehicle, {words}", 32))
        captions.append(words)
    return slider.animate(name, frames, captions)


def draw_epoch(views: Epoch) -> Figure:
    """Draw the targets of an epoch around the vehicle, forward up."""
    figure, ax = plt.subplots(figsize=(5.0, 5.2))
    positions = np.concatenate([view.positions for view in views])
    shares = np.concatenate([view.probabilities for view in views])
    for low, high, color, label in CLASSES:
        x, y = positions[(shares >= low) & (shares < high)].T
        ax.plot(-y, x, "o", color=color, ms=5, label=label)
    ax.plot(0.0, 0.0, "^", color=BLACK, ms=10)
    ax.set(xlabel="to the right (m)", ylabel="forward (m)", aspect="equal")
    figure.legend(loc="outside upper center", ncols=3)
    return figure
