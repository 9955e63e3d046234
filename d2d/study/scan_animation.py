"""Scans in the vehicle frame, target by target as much as the registration trusts them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from d2d._checks import Array
from d2d.radar import Mounting, RadarScan
from d2d.study.animation import slider
from d2d.study.drawing import BLUE, ORANGE, YELLOW

WIDTH, HEIGHT = 600.0, 560.0  # of the drawing, in SVG units
# Classes of the inlier probability by their upper ends, drawn as points of this size.
CLASSES = (
    (0.2, ORANGE, 3.0, "rejected: below 0.2"),
    (0.8, YELLOW, 4.5, "0.2 to 0.8"),
    (1.01, BLUE, 4.5, "trusted: above 0.8"),
)


class View(NamedTuple):
    """What one sensor sees, and the inlier probability (K,) of each target."""

    scan: RadarScan
    mounting: Mounting
    probabilities: Array


def scans_html(name: str, rounds: Sequence[Sequence[View]], reach: float = 60.0) -> str:
    """Animation of rounds of views, x forward pointing up, ``reach`` metres ahead.

    Raises ``ValueError`` without a round.
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
    return slider(name, [_frame(views, reach) for views in rounds], captions)


def _frame(views: Sequence[View], reach: float) -> str:
    scale = 0.62 * HEIGHT / reach
    origin = np.array([0.5 * WIDTH, 0.68 * HEIGHT])
    marks = [_axes(origin, scale)]
    for low, (high, colour, size, _) in zip(
        [-1.0, *(end for end, *_ in CLASSES)], CLASSES, strict=False
    ):
        places = []
        for scan, mounting, probability in views:
            angle = scan.azimuth + mounting.yaw
            x = mounting.x + scan.range * np.cos(angle)
            y = mounting.y + scan.range * np.sin(angle)
            inside = (probability >= low) & (probability < high)
            places.append(origin + scale * np.column_stack([-y, -x])[inside])
        where = np.concatenate(places)
        shown = where[((where > 4.0) & (where < [WIDTH - 4.0, HEIGHT - 30.0])).all(axis=1)]
        # a path of dots needs a fifth of the bytes of circles
        dots = "".join(f"M{px:.0f} {py:.0f}h0" for px, py in shown)
        marks.append(f'<path d="{dots}" stroke="{colour}" stroke-width="{size:g}"/>')
    return (
        f'<svg viewBox="0 0 {WIDTH:.0f} {HEIGHT:.0f}" width="100%" role="img" '
        'aria-label="Targets around the vehicle, coloured by how far they are trusted" '
        f'font-family="sans-serif" font-size="17" stroke-linecap="round">{"".join(marks)}</svg>'
    )


def _axes(origin: Array, scale: float) -> str:
    x, y = origin
    ten = 10.0 * scale
    text = [
        f'<path d="M{x - 6:.0f} {y + 10:.0f}L{x:.0f} {y - 12:.0f}L{x + 6:.0f} {y + 10:.0f}Z" '
        'fill="#111"/>',
        f'<path d="M20 {HEIGHT - 40:.0f}h{ten:.0f}" stroke="#111" stroke-width="3"/>',
        f'<text x="20" y="{HEIGHT - 48:.0f}">10 m</text>',
    ]
    for i, (_, colour, _, label) in enumerate(CLASSES):
        left = 20 + 195 * i
        text.append(f'<circle cx="{left}" cy="{HEIGHT - 14:.0f}" r="5" fill="{colour}"/>')
        text.append(f'<text x="{left + 12}" y="{HEIGHT - 8:.0f}">{label}</text>')
    return "".join(text)
