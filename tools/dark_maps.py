"""A Sphinx extension that gives a figure with maps a second picture, for the dark theme.

In the dark the style sheet inverts the lightness of a figure.  A map must not be inverted: dark
means less in it.  So this makes a picture in which everything but the maps and their colour bars is
inverted, and a style sheet that shows it in the dark.  A map is an area with several colours of
viridis or cividis.
"""

from __future__ import annotations

import io
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import pandas
from matplotlib import colormaps
from PIL import Image
from scipy import ndimage
from scipy.spatial import KDTree
from shrink_pictures import shrink

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
# The style sheet's filter invert(1) hue-rotate(180deg) brightness(1.3) of red, green and blue.
INVERT = 1.3 * np.array([[-0.574, 1.43, 0.144], [0.426, 0.43, 0.144], [0.426, 1.43, -0.856]])
RULE = """html[data-theme="dark"] body .bd-content article img[src$="/{name}"] {{
  background: url("../_images/{dark}") 0 0 / contain no-repeat;
  filter: none;
  object-position: -9999px 0;
}}
"""


def grown(mask: np.ndarray, size: int) -> np.ndarray:
    """The pixels of a mask, each with a square of so many pixels, an odd number, about it."""
    for _ in range(2):
        rows = np.pad(mask, ((size // 2, size // 2), (0, 0)))
        mask = reduce(np.logical_or, [rows[i : len(mask) + i] for i in range(size)]).T
    return mask


def maps(picture: np.ndarray) -> np.ndarray:
    """Mask of the pixels of a picture (height, width, 3) that belong to a map."""
    inverse, codes = pandas.factorize(picture.reshape(-1, 3).astype(float) @ [65536, 256, 1])
    colors = codes[:, None] // [65536, 256, 1] % 256
    off, shade = SCALES.query(colors, p=np.inf)
    shades = np.where(off <= NEAR, shade, -1)[inverse].reshape(picture.shape[:2])
    vivid = (np.ptp(colors, axis=1) > GREY)[inverse].reshape(shades.shape)
    areas = ~grown(~grown(shades >= 0, THIN), 2 * THIN - 1)  # closed, and thinned to be opened
    labels, _ = ndimage.label(~grown(~grown(grown(areas, THIN), GAP), GAP))
    found = np.zeros(labels.shape, dtype=bool)
    for label, box in enumerate(ndimage.find_objects(labels), start=1):
        area = labels[box] == label
        several = len(np.unique(shades[box][area])) >= SHADES
        if area.sum() >= AREA and several and vivid[box][area].mean() >= 0.25:
            found[box] |= ndimage.binary_fill_holes(area)
    return found


def inverted(picture: np.ndarray) -> np.ndarray:
    """The picture with its lightness inverted, as the style sheet does it."""
    light = (255 - picture.astype(float)) @ INVERT.T
    return np.clip(light.round(), 0, 255).astype(np.uint8)


def write(app: Any, exception: Exception | None) -> None:
    """Write the dark pictures beside the others of the built book, and the style sheet."""
    if exception or app.builder.name != "html":
        return
    rules = []
    for path in sorted((Path(app.outdir) / "_images").glob("*.png")):
        with Image.open(path) as image:
            picture = np.asarray(image.convert("RGB"))
        kept = maps(picture)
        if kept.any():
            dark, written = path.with_suffix(SUFFIX), io.BytesIO()
            drawn = np.where(kept[..., None], picture, inverted(picture))
            Image.fromarray(drawn).save(written, "PNG")
            dark.write_bytes(shrink(written.getvalue()))
            for name in (path.name, f"{path.stem}.small.webp"):  # the gallery has small ones
                rules.append(RULE.format(name=name, dark=name.replace(".", ".dark.", 1)))
    (Path(app.outdir) / "_static" / STYLES).write_text("".join(rules), encoding="utf-8")


def setup(app: Any) -> dict[str, bool]:
    app.add_css_file(STYLES)
    app.connect("build-finished", write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
