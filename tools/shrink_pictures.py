"""Make pictures small enough for a phone and for a repository: PNGs with a palette.

A figure has few colours; the shades along the edges of its lines are merged, so that 256 suffice.
Pictures that would look different (photographs, transparency) or not get smaller are left alone.
"""

from __future__ import annotations

import io
from base64 import b64decode, b64encode

from nbformat import NotebookNode
from PIL import Image, ImageChops, ImageStat

MAX_ERROR = 1.0  # of 255, mean of the worst colour channel; far less than the eye can see


def shrink(data: bytes) -> bytes:
    """Return the picture as a PNG with a palette, or ``data`` if that is not smaller."""
    with Image.open(io.BytesIO(data)) as picture:
        if getattr(picture, "is_animated", False) or picture.mode == "P":
            return data
        whole = picture.convert("RGBA")
    if whole.getextrema()[3] != (255, 255):
        return data
    opaque = whole.convert("RGB")
    reduced = opaque.quantize(256, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    off = ImageStat.Stat(ImageChops.difference(opaque, reduced.convert("RGB"))).mean
    if max(off) > MAX_ERROR:
        return data
    written = io.BytesIO()
    reduced.save(written, "PNG")
    return min(written.getvalue(), data, key=len)


def shrink_outputs(notebook: NotebookNode) -> None:
    """Shrink the pictures that the cells of a notebook put out."""
    for cell in notebook.cells:
        for output in cell.get("outputs", ()):
            if "image/png" in output.get("data", {}):
                small = shrink(b64decode(output.data["image/png"]))
                output.data["image/png"] = b64encode(small).decode()
