"""The book's pictures get smaller without looking different."""

import io

import numpy as np
import pytest
from PIL import Image

from tools.shrink_pictures import main, shrink


def png(pixels, **options):
    written = io.BytesIO()
    Image.fromarray(np.asarray(pixels, dtype=np.uint8)).save(written, "PNG", **options)
    return written.getvalue()


def read(data):
    with Image.open(io.BytesIO(data)) as picture:
        return np.asarray(picture.convert("RGB"), dtype=float)


@pytest.fixture
def figure():
    """White with two curves whose edges fade: more than 256 colours, as matplotlib draws."""
    x, y = np.meshgrid(np.linspace(0, 1, 300), np.linspace(-1, 1, 200))
    pixels = np.full((200, 300, 4), 255.0)
    for color, curve in (((0, 114, 178), np.sin(9 * x)), ((213, 94, 0), np.cos(7 * x))):
        ink = np.clip(3 - 60 * np.abs(y - 0.8 * curve), 0, 1)[..., None]
        pixels[..., :3] += ink * (np.asarray(color) - pixels[..., :3])
    assert len(np.unique(pixels.astype(np.uint8).reshape(-1, 4), axis=0)) > 256
    return pixels


def test_a_figure_gets_smaller_and_looks_the_same(figure):
    """Breaks if the palette is too small, dithered, or loses the white of the ground."""
    data = png(figure)
    small = shrink(data)
    assert len(small) < 0.7 * len(data)
    assert np.abs(read(small) - read(data)).mean() < 0.5
    np.testing.assert_array_equal(read(small)[0, 0], 255)
    assert shrink(small) is small, "a second run changes nothing"


def test_photographs_transparency_and_motion_are_left_alone(figure):
    """Breaks if a photograph is spoiled, a logo gets a white box, or one frame stays of many."""
    photograph = png(np.random.default_rng(1).integers(0, 256, (60, 60, 3)))
    clear = figure.copy()
    clear[0, 0, 3] = 0
    moving = png(
        figure, save_all=True, append_images=[Image.fromarray(255 - figure.astype(np.uint8))]
    )
    for data in (photograph, png(clear), moving):
        assert shrink(data) is data


def test_a_folder_is_shrunk_in_place(figure, tmp_path, capsys):
    """Breaks if a file is lost, or one that is no PNG is touched."""
    (tmp_path / "a.png").write_bytes(png(figure))
    (tmp_path / "b.svg").write_text("<svg/>")
    assert main([str(tmp_path)]) == 0
    assert (tmp_path / "a.png").read_bytes() == shrink(png(figure))
    assert (tmp_path / "b.svg").read_text() == "<svg/>"
    assert "MB" in capsys.readouterr().out
