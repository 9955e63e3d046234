"""A Sphinx extension that gives a figure with maps a second picture, for the dark theme.

In the dark the style sheet turns the lightness of a figure round.  A map must not be turned: dark
means less in it.  So this makes a picture in which everything but the maps and their colour bars
is turned, and a style sheet that shows it in the dark.  A map is known by its colours, those of
viridis or cividis, many of which cover an area; a flat area in one of them is none.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from PIL import Image
from scipy import ndimage

STYLES = "dark-maps.css"
SUFFIX = ".dark.png"
SCALES = np.concatenate(
    [colormaps[name](np.arange(256), bytes=True)[:, :3] for name in ("viridis", "cividis")]
).astype(int)
NEAR = 8  # of 255, how far off a scale a channel may be: pictures have few colours
LEAST = 600  # pixels of the smallest map, which is a colour bar
GAP = 5  # pixels between parts of a map: its contours and letters
FULL = 0.6  # of its rectangle; a surface seen from the side covers less
# What the filter invert(1) hue-rotate(180deg) of the style sheet makes of red, green and blue.
TURN = np.array([[-0.574, 1.430, 0.144], [0.426, 0.430, 0.144], [0.426, 1.430, -0.856]])
RULE = """html[data-theme="dark"] .bd-content article img[src$="{name}"] {{
  background-image: url("../_images/{dark}");
  background-repeat: no-repeat;
  background-size: 100% 100%;
  filter: none;
  mix-blend-mode: screen;
  object-position: -9999px 0;
}}
"""


def maps(picture: np.ndarray) -> np.ndarray:
    """Which pixels of a picture (height, width, 3) belong to a map."""
    colors, inverse = np.unique(picture.reshape(-1, 3), axis=0, return_inverse=True)
    off = np.abs(colors[:, None].astype(int) - SCALES).max(axis=2)
    place = np.where(off.min(axis=1) <= NEAR, off.argmin(axis=1), -1)
    place = place[inverse.ravel()].reshape(picture.shape[:2])
    closed = ndimage.binary_closing(np.pad(place >= 0, GAP), iterations=GAP)[GAP:-GAP, GAP:-GAP]
    labels, _ = ndimage.label(ndimage.binary_opening(closed, iterations=GAP))
    found = np.zeros(labels.shape, dtype=bool)
    for label, where in enumerate(ndimage.find_objects(labels), start=1):
        part = labels[where] == label
        if part.sum() < LEAST or len(np.unique(place[where][part])) < 5:
            continue
        found[where] |= True if part.mean() >= FULL else ndimage.binary_fill_holes(part)
    return found


def turned(picture: np.ndarray) -> np.ndarray:
    """A picture with its lightness turned round, as the style sheet turns it."""
    light = (255 - picture.astype(float)) @ TURN.T
    return np.clip(light.round(), 0, 255).astype(np.uint8)


def dark_picture(path: Path) -> np.ndarray | None:
    """The picture for the dark theme; nothing if there is no map in it."""
    with Image.open(path) as image:
        picture = np.asarray(image.convert("RGB"))
    kept = maps(picture)
    return np.where(kept[..., None], picture, turned(picture)) if kept.any() else None


def write(app: Any, exception: Exception | None) -> None:
    """Write the pictures beside the others of the built book, and the style sheet."""
    if exception or app.builder.name != "html":
        return
    rules = []
    for path in sorted((Path(app.outdir) / "_images").glob("*.png")):
        if path.name.endswith(SUFFIX):
            continue
        picture = dark_picture(path)
        if picture is not None:
            dark = path.with_suffix(SUFFIX)
            Image.fromarray(picture).save(dark)
            rules.append(RULE.format(name=path.name, dark=dark.name))
    (Path(app.outdir) / "_static" / STYLES).write_text("".join(rules), encoding="utf-8")


def setup(app: Any) -> dict[str, bool]:
    app.add_css_file(STYLES)
    app.connect("build-finished", write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
