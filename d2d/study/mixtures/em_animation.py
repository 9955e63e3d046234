"""Expectation maximisation step by step, as an animation."""

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import to_hex, to_rgba_array
from numpy.typing import ArrayLike

from d2d._types import Array
from d2d.study.book import svg
from d2d.study.book.grammar import BLACK, GREY, PURPLE, SKY, YELLOW
from d2d.study.mixtures import gaussian
from d2d.study.mixtures.gaussian import GaussianMixture

COLOURS = (PURPLE, YELLOW, SKY, GREY)
WIDTH, HEIGHT, STRIP, MARGIN = svg.PHONE, 330.0, 124.0, 36.0  # of the drawing, in SVG units


def em_frame(
    x: ArrayLike, steps: Sequence[GaussianMixture], log_likelihoods: Sequence[float], step: int
) -> str:
    """SVG of one step of EM in the plane: data and components, and the log-likelihood below.

    The data ``x`` (N, 2), in m, are coloured by the responsibilities of ``steps[step]``, a mixture
    of at most four components; each component is drawn as its ellipses of one and two standard
    deviations.
    """
    points = np.asarray(x, dtype=np.float64)
    mixture = steps[step]
    low, high = points.min(axis=0), points.max(axis=0)
    low, high = low - 0.08 * (high - low), high + 0.08 * (high - low)
    scale = float(min((WIDTH - 2 * MARGIN) / (high - low)[0], (HEIGHT - MARGIN) / (high - low)[1]))
    origin = np.array([0.5 * WIDTH, 0.5 * (HEIGHT - MARGIN)]) - 0.5 * scale * (low + high) * [1, -1]

    def place(where: Array) -> Array:
        return np.asarray(origin + scale * where * np.array([1.0, -1.0]))

    # each point has the mean of the components' colours
    mixed = mixture.responsibilities(points) @ to_rgba_array(COLOURS[: mixture.components])[:, :3]
    marks = [
        svg.circle(px, py, 2.6, colour)
        for (px, py), colour in zip(place(points), map(to_hex, mixed), strict=True)
    ]
    for k in range(mixture.components):
        marks += _component(mixture, k, place(mixture.means[k]), scale)
    bar = f"M {MARGIN:.0f} {HEIGHT - 30.0:.0f} h {svg.number(scale)}"
    marks.append(svg.path(bar, stroke="#111", stroke_width=3.0))
    marks.append(svg.text(MARGIN, HEIGHT - 38.0, "1 m"))
    marks += _likelihood_strip(np.asarray(log_likelihoods), step)
    label = f"Step {step} of EM: data, components and log-likelihood"
    return svg.picture(WIDTH, HEIGHT + STRIP, label, marks)


def _component(mixture: GaussianMixture, k: int, centre: Array, scale: float) -> list[str]:
    # 39.3 % of the probability lies within one standard deviation
    one_sigma = gaussian.confidence_ellipse(mixture.covariances[k], 1.0 - float(np.exp(-0.5)))
    x, y = centre
    turn = -float(np.rad2deg(one_sigma.angle))
    place = f"translate({svg.number(x)} {svg.number(y)}) rotate({svg.number(turn)})"
    ellipses = [
        svg.element(
            "ellipse",
            rx=n * scale * one_sigma.semi_axes[0],
            ry=n * scale * one_sigma.semi_axes[1],
            transform=place,
            fill="none",
            stroke=COLOURS[k],
            stroke_width=2.5,
        )
        for n in (1, 2)
    ]
    weight = svg.text(
        x,
        y + 6.0,
        f"{mixture.weights[k]:.2f}",
        text_anchor="middle",
        font_weight="bold",
        stroke="#fff",
        stroke_width=4.0,
        paint_order="stroke",
    )
    return [*ellipses, weight]


def _likelihood_strip(values: Array, step: int) -> list[str]:
    top, bottom = HEIGHT + 14.0, HEIGHT + STRIP - 40.0
    span = float(np.ptp(values)) or 1.0
    xs = np.linspace(MARGIN, WIDTH - MARGIN, len(values)) if len(values) > 1 else [0.5 * WIDTH]
    ys = bottom - (values - values.min()) / span * (bottom - top)
    middle, low = 0.5 * WIDTH, HEIGHT + STRIP - 9.0
    return [
        svg.path(f"M {MARGIN:.0f} {bottom + 8:.0f} H {WIDTH - MARGIN:.0f}", stroke="#999"),
        svg.polyline(np.column_stack([xs, ys]), "#111", 2.0),
        svg.circle(xs[step], ys[step], 6.0, BLACK),
        svg.text(middle, low, "log-likelihood over the steps", text_anchor="middle"),
    ]
