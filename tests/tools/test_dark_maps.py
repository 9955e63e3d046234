"""In the dark, a figure is inverted but for its maps."""

import io

import matplotlib.pyplot as plt
import numpy as np
import pytest
from dark_maps import maps
from PIL import Image


def picture(fig):
    """The pixels that matplotlib draws in the notebooks: two for each of the page."""
    written = io.BytesIO()
    fig.savefig(written, dpi=200)
    with Image.open(written) as image:
        return np.asarray(image.convert("RGB"))


def covered(axes, shape):
    """Mask of the pixels that an axes covers."""
    height, width = shape
    x0, y0, x1, y1 = axes.get_position().extents * [width, height, width, height]
    mask = np.zeros(shape, dtype=bool)
    mask[height - round(y1) : height - round(y0), round(x0) : round(x1)] = True
    return mask


@pytest.mark.parametrize("scale", ["viridis", "cividis", "viridis_r"])
def test_a_map_and_its_bar_stay(scale: str):
    """Breaks if dark means more in the dark, or black letters on a map become white."""
    fig, (left, right) = plt.subplots(1, 2, figsize=(5, 2.2))
    shown = left.imshow(np.add.outer(np.arange(40.0), np.arange(40.0)), cmap=scale)
    left.plot(20, 20, "+", color="white", markersize=12)
    left.text(30, 30, "0.9", color="black")
    bar = fig.colorbar(shown, ax=left, orientation="horizontal", fraction=0.06)
    right.plot([0, 1], [1, 0], color="#0072B2")
    fig.canvas.draw()
    found = maps(picture(fig))
    expected = covered(left, found.shape) | covered(bar.ax, found.shape)
    assert (found != expected).mean() < 0.02


def test_lines_bars_and_greys_are_no_map():
    """Breaks if a curve or a band stays dark on the dark page, or a flat bar in a map's green."""
    fig, axes = plt.subplots(figsize=(5, 3))
    x = np.linspace(0, 20, 400)
    for k in range(12):
        axes.plot(x, np.sin(x + 0.05 * k), "--", color="0.48", lw=2)
    axes.fill_between(x, -0.5, 0.5, color="#56B4E9", alpha=0.45)
    axes.bar([5, 9], [0.9, 0.7], color=["#1f9e89", "#E69F00"])
    assert not maps(picture(fig)).any()
