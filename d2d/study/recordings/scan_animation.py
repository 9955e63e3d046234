"""Animated scans in the vehicle frame, each target coloured by how far it is trusted."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from d2d._types import Array
from d2d.radar import Mounting, RadarScan
from d2d.study.book import slider, svg
from d2d.study.book.grammar import PINK, PURPLE, YELLOW

WIDTH, HEIGHT = 600.0, 560.0  # of the drawing, in SVG units
# Classes of the inlier probability: upper limit, colour, size of the points, label.
CLASSES = (
    (0.2, PINK, 6.0, "rejected: below 0.2"),
    (0.8, YELLOW, 8.0, "0.2 to 0.8"),
    (1.01, PURPLE, 8.0, "trusted: above 0.8"),
)


class View(NamedTuple):
    """What one sensor sees, and the inlier probability (K,) of each target."""

    scan: RadarScan
    mounting: Mounting
    probabilities: Array


def animate_scans(name: str, rounds: Sequence[Sequence[View]], ahead: float = 60.0) -> str:
    """Animate rounds of views, with ``ahead`` metres in front of the vehicle in the picture.

    The x axis, forward, points up.  Raises ``ValueError`` if there is no round.
    """
    if not rounds:
        raise ValueError("rounds must hold at least one round of views, but is empty")
    captions = []
    for views in rounds:
        trusted = np.concatenate([view.probabilities for view in views])
        captions.append(
            f"{views[0].scan.time - rounds[0][0].scan.time:.2f} s: {len(trusted)} targets, "
            f"mean inlier probability {trusted.mean() if len(trusted) else 0.0:.2f}"
        )
    return slider.animate(name, [_frame(views, ahead) for views in rounds], captions)


def _frame(views: Sequence[View], ahead: float) -> str:
    scale = 0.62 * HEIGHT / ahead
    origin = np.array([0.5 * WIDTH, 0.68 * HEIGHT])
    marks = _vehicle_and_key(origin, scale)
    lower = (-1.0, *(upper for upper, *_ in CLASSES))
    for low, (high, colour, size, _) in zip(lower, CLASSES, strict=False):
        places = []
        for scan, mounting, probability in views:
            angle = scan.azimuth + mounting.yaw
            x = mounting.x + scan.range * np.cos(angle)
            y = mounting.y + scan.range * np.sin(angle)
            inside = (probability >= low) & (probability < high)
            places.append(origin + scale * np.column_stack([-y, -x])[inside])
        where = np.concatenate(places)
        shown = where[((where > 4.0) & (where < [WIDTH - 4.0, HEIGHT - 30.0])).all(axis=1)]
        # dots in one path take a fifth of the bytes that circles would
        dots = "".join(f"M{px:.0f} {py:.0f}h0" for px, py in shown)
        marks.append(svg.path(dots, stroke=colour, stroke_width=size, stroke_linecap="round"))
    label = "Targets around the vehicle, coloured by how far they are trusted"
    return svg.picture(WIDTH, HEIGHT, label, marks)


def _vehicle_and_key(origin: Array, scale: float) -> list[str]:
    x, y = origin
    arrow = f"M{x - 6:.0f} {y + 10:.0f}L{x:.0f} {y - 12:.0f}L{x + 6:.0f} {y + 10:.0f}Z"
    scale_bar = svg.path(
        f"M20 {HEIGHT - 40:.0f}h{10.0 * scale:.0f}", stroke="#111", stroke_width=3.0
    )
    marks = [svg.path(arrow), scale_bar, svg.text(20.0, HEIGHT - 48.0, "10 m")]
    for i, (_, colour, _, label) in enumerate(CLASSES):
        left = 20.0 + 195.0 * i
        marks.append(svg.circle(left, HEIGHT - 14.0, 5.0, colour))
        marks.append(svg.text(left + 12.0, HEIGHT - 8.0, label))
    return marks
