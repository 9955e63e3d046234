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
from scipy.spatial import KDTree

STYLES = "dark-maps.css"
SUFFIX = ".dark.png"
SCALES = KDTree(
    [colormaps[name](i, bytes=True)[:3] for name in ("viridis", "cividis") for i in range(256)]
)
NEAR = 8  # of 255, how far off a scale a channel may be: pictures have few colours
AREA = 600  # pixels of the smallest map, which is a colour bar
GAP = 9  # pixels between parts of a map: its contours and letters
THIN = 5  # pixels of a line, which is no map
SHADES = 3  # of a scale in a map, at least
GREY = 20  # of 255 by which the channels of a colour differ: cividis has some, but few
CLOSE, OPEN = ndimage.grey_closing, ndimage.grey_opening
FULL = 0.6  # of its rectangle; a surface seen from the side covers less
# What the filter invert(1) hue-rotate(180deg) of the style sheet makes of red, green and blue.
TURN = np.array([[-0.574, 1.430, 0.144], [0.426, 0.430, 0.144], [0.426, 1.430, -0.856]])
SHOWN = 'html[data-theme="dark"] body .bd-content article :is({pictures})'
PICTURE = 'img[src$="/{name}"]'
COMMON = """ {
  background-repeat: no-repeat;
  background-size: 100% 100%;
  filter: none;
  mix-blend-mode: screen;
  object-position: -9999px 0;
}
"""


def maps(picture: np.ndarray) -> np.ndarray:
    """Which pixels of a picture (height, width, 3) belong to a map."""
    code = picture.astype(int) @ [65536, 256, 1]
    codes, inverse = np.unique(code, return_inverse=True)
    colors = codes[:, None] // [65536, 256, 1] % 256
    off, nearest = SCALES.query(colors, p=np.inf)
    place = np.where(off <= NEAR, nearest, -1)[inverse].reshape(code.shape)
    vivid = (np.ptp(colors, axis=1) > GREY)[inverse].reshape(code.shape)
    found = np.zeros(code.shape, dtype=bool)
    if (vivid & (place >= 0)).sum() < AREA:
        return found
    labels, _ = ndimage.label(closed(place >= 0))
    for label, where in enumerate(ndimage.find_objects(labels), start=1):
        part = labels[where] == label
        shades = len(np.unique(place[where][part]))
        if part.sum() >= AREA and shades >= SHADES and vivid[where][part].mean() >= 0.5:
            found[where] |= True if part.mean() >= FULL else ndimage.binary_fill_holes(part)
    return found


def closed(mask: np.ndarray) -> np.ndarray:
    """A mask with its gaps closed, and without thin lines."""
    for change, size in ((CLOSE, THIN), (OPEN, THIN), (CLOSE, GAP)):
        mask = change(mask, size=size)
    return mask


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


def styles(dark: dict[str, str]) -> str:
    """Rules that show in the dark the second pictures, by the names of the first."""
    if not dark:
        return ""
    pictures = {name: PICTURE.format(name=name) for name in dark}
    rules = [SHOWN.format(pictures=", ".join(pictures.values())) + COMMON]
    for name, second in dark.items():
        shown = SHOWN.format(pictures=pictures[name])
        rules.append(f'{shown} {{ background-image: url("../_images/{second}"); }}\n')
    return "".join(rules)


def write(app: Any, exception: Exception | None) -> None:
    """Write the pictures beside the others of the built book, and the style sheet."""
    if exception or app.builder.name != "html":
        return
    dark = {}
    for path in sorted((Path(app.outdir) / "_images").glob("*.png")):
        picture = None if path.name.endswith(SUFFIX) else dark_picture(path)
        if picture is not None:
            second = path.with_suffix(SUFFIX)
            Image.fromarray(picture).save(second)
            dark[path.name] = second.name
    (Path(app.outdir) / "_static" / STYLES).write_text(styles(dark), encoding="utf-8")


def setup(app: Any) -> dict[str, bool]:
    app.add_css_file(STYLES)
    app.connect("build-finished", write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
