"""In the dark, a figure is turned round but for its maps."""

import io
from pathlib import Path
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from PIL import Image

from tools.dark_maps import STYLES, dark_picture, maps, turned, write


def picture(fig):
    """What matplotlib draws, as the notebooks do: with two pixels for each of the page."""
    written = io.BytesIO()
    fig.savefig(written, dpi=200)
    plt.close(fig)
    with Image.open(written) as image:
        return np.asarray(image.convert("RGB"))


def drawn(axes):
    """Which pixels of the picture an axes covers."""
    fig = axes.figure
    height, width = (round(200 * inches) for inches in fig.get_size_inches()[::-1])
    x0, y0, x1, y1 = axes.get_position().extents * [width, height, width, height]
    covered = np.zeros((height, width), dtype=bool)
    covered[height - round(y1) : height - round(y0), round(x0) : round(x1)] = True
    return covered


@pytest.mark.parametrize("scale", ["viridis", "cividis", "viridis_r"])
def test_a_map_its_bar_and_what_is_written_on_it_stay(scale: str):
    """Breaks if dark means more in the dark, or black letters become white on yellow."""
    fig, (left, right) = plt.subplots(1, 2, figsize=(5, 2.2))
    shown = left.imshow(np.add.outer(np.arange(40.0), np.arange(40.0)), cmap=scale)
    left.plot(20, 20, "+", color="white", markersize=12)
    left.text(30, 30, "0.9", color="black")
    bar = fig.colorbar(shown, ax=left, orientation="horizontal", fraction=0.06)
    right.plot([0, 1], [1, 0], color="#0072B2")
    fig.canvas.draw()
    expected = drawn(left) | drawn(bar.ax)
    pixels = picture(fig)
    assert (maps(pixels) != expected).mean() < 0.02
    assert maps(pixels)[expected].mean() > 0.95


def test_lines_bars_and_greys_are_no_map():
    """Breaks if a curve or a band stays dark on the dark page, or a flat bar in a map's green."""
    fig, axes = plt.subplots(figsize=(5, 3))
    x = np.linspace(0, 20, 400)
    for k in range(12):
        axes.plot(x, np.sin(x + 0.05 * k), "--", color="0.48", lw=2)
    axes.fill_between(x, -0.5, 0.5, color="#56B4E9", alpha=0.45)
    axes.bar([5, 9], [0.9, 0.7], color=["#1f9e89", "#E69F00"])
    assert not maps(picture(fig)).any()


def test_white_becomes_black_and_hues_stay():
    """Breaks if the picture is not turned as the style sheet turns the others."""
    colors = np.array([[[255, 255, 255], [0, 0, 0], [213, 94, 0], [0, 114, 178]]], dtype=np.uint8)
    white, black, orange, blue = turned(colors)[0].astype(int)
    assert white.max() <= 1
    assert black.min() >= 254
    assert orange[0] > orange[1] > orange[2]
    assert blue[2] > blue[1] > blue[0]


def test_only_a_figure_with_a_map_has_a_second_picture(tmp_path: Path):
    images = tmp_path / "_images"
    images.mkdir()
    (tmp_path / "_static").mkdir()
    fig, axes = plt.subplots(figsize=(3, 2))
    axes.imshow(np.arange(100.0).reshape(10, 10))
    Image.fromarray(picture(fig)).save(images / "map.png")
    Image.fromarray(np.full((90, 90, 3), 255, dtype=np.uint8)).save(images / "white.png")
    app = SimpleNamespace(outdir=tmp_path, builder=SimpleNamespace(name="html"))
    for _ in range(2):  # a second build finds the dark pictures there
        write(app, None)
        assert {path.name for path in images.iterdir()} == {
            "map.png",
            "map.dark.png",
            "white.png",
        }
    styles = (tmp_path / "_static" / STYLES).read_text(encoding="utf-8")
    assert styles.count('url("../_images/map.dark.png")') == 1
    assert "white" not in styles
    assert dark_picture(images / "white.png") is None
