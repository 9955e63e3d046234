"""Animated scans in the vehicle frame, each target coloured by how far it is trusted."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from d2d._types import Array
from d2d.radar import Mounting, RadarScan
from d2d.study.book import slider, svg
from d2d.study.book.grammar import MOVING, OUTLIER, PINK

WIDTH, KEY = svg.PHONE, 34.0  # of the drawing, and the height of its key, in SVG units
MARGIN = 3.0  # m around the targets
TALLEST = 1.1  # height of the field in units of its width
# Classes of the inlier probability: upper limit, colour, size of the points, label.
CLASSES = (
    (0.2, OUTLIER, 8.0, "below 0.2"),
    (0.8, PINK, 10.0, "0.2 to 0.8"),
    (1.01, MOVING, 10.0, "above 0.8"),
)


class WeighedScan(NamedTuple):
    """The scan of one sensor, and the inlier probability (K,) of each of its targets."""

    scan: RadarScan
    mounting: Mounting
    probabilities: Array


def animate_scans(name: str, rounds: Sequence[Sequence[WeighedScan]], ahead: float = 60.0) -> str:
    """Animate rounds of views, with ``ahead`` metres in front of the vehicle in the picture.

    The x axis, forward, points up.
    """
    captions = []
    for views in rounds:
        trusted = np.concatenate([view.probabilities for view in views])
        captions.append(
            f"{views[0].scan.time - rounds[0][0].scan.time:.2f} s: {len(trusted)} targets, "
            f"mean inlier probability {trusted.mean() if len(trusted) else 0.0:.2f}"
        )
    field = _field(rounds, ahead)
    return slider.animate(name, [_frame(views, *field) for views in rounds], captions)


def _places(view: WeighedScan) -> Array:
    """Positions (K, 2) of the targets in the vehicle frame, in m."""
    angle = view.scan.azimuth + view.mounting.yaw
    x = view.mounting.x + view.scan.range * np.cos(angle)
    return np.column_stack([x, view.mounting.y + view.scan.range * np.sin(angle)])


def _field(rounds: Sequence[Sequence[WeighedScan]], ahead: float) -> tuple[float, float, float]:
    """How much of the ground all frames show, behind, ahead and aside of the vehicle, in m.

    It is as much as most targets need that are not farther than ``ahead``.
    """
    where = np.concatenate([_places(view) for views in rounds for view in views])
    x, y = where[np.hypot(*where.T) < ahead].T
    low, high = (float(value) for value in np.percentile(x, [3.0, 97.0]))
    behind, before = max(-low, 2.0) + MARGIN, max(high, 2.0) + MARGIN
    aside = float(np.percentile(np.abs(y), 97.0)) + MARGIN
    return behind, before, max(aside, 0.5 * (behind + before) / TALLEST)


def _frame(views: Sequence[WeighedScan], behind: float, ahead: float, aside: float) -> str:
    scale = 0.5 * WIDTH / aside
    height = scale * (ahead + behind) + KEY
    origin = np.array([0.5 * WIDTH, scale * ahead])
    marks = _vehicle_and_key(origin, scale, height)
    lower = (-1.0, *(upper for upper, *_ in CLASSES))
    for low, (high, colour, size, _) in zip(lower, CLASSES, strict=False):
        places = []
        for view in views:
            inside = (view.probabilities >= low) & (view.probabilities < high)
            places.append(origin - scale * _places(view)[inside, ::-1])
        where = np.concatenate(places)
        shown = where[((where > 4.0) & (where < [WIDTH - 4.0, height - KEY])).all(axis=1)]
        # dots in one path take a fifth of the bytes that circles would
        dots = "".join(f"M{px:.0f} {py:.0f}h0" for px, py in shown)
        marks.append(svg.path(dots, stroke=colour, stroke_width=size, stroke_linecap="round"))
    label = "Targets around the vehicle, coloured by how far they are trusted"
    return svg.picture(WIDTH, height, label, marks)


def _vehicle_and_key(origin: Array, scale: float, height: float) -> list[str]:
    x, y = origin
    arrow = f"M{x - 6:.0f} {y + 10:.0f}L{x:.0f} {y - 12:.0f}L{x + 6:.0f} {y + 10:.0f}Z"
    scale_bar = svg.path(
        f"M20 {height - 44:.0f}h{10.0 * scale:.0f}", stroke="#111", stroke_width=3.0
    )
    marks = [svg.path(arrow), scale_bar, svg.text(20.0, height - 50.0, "10 m")]
    for i, (_, colour, _, label) in enumerate(CLASSES):
        left = 24.0 + 160.0 * i
        marks.append(svg.circle(left, height - 14.0, 5.0, colour))
        marks.append(svg.text(left + 12.0, height - 8.0, label))
    return marks
