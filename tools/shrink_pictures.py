"""Make the pictures of the built book small enough for a phone: PNGs with a palette.

    python tools/shrink_pictures.py _build/html/_images

A figure has few colours; the shades along the edges of its lines are merged, so that 256 suffice.
Pictures that would look different (photographs, transparency) or not get smaller are left alone.
"""

from __future__ import annotations

import io
import sys
from pathlib import Path

import numpy as np
from PIL import Image

MAX_ERROR = 1.0
"""Mean error of a colour channel (0 to 255) over the picture; far less than the eye can see."""


def shrink(data: bytes) -> bytes:
    """The same picture as a PNG with a palette, or `data` if that is not smaller."""
    with Image.open(io.BytesIO(data)) as picture:
        if getattr(picture, "is_animated", False) or picture.mode == "P":
            return data
        pixels = np.asarray(picture.convert("RGBA"))
    if pixels[..., 3].min() < 255:
        return data
    opaque = Image.fromarray(np.ascontiguousarray(pixels[..., :3]))
    reduced = opaque.quantize(256, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    error = np.abs(np.asarray(reduced.convert("RGB"), dtype=float) - pixels[..., :3]).mean()
    if error > MAX_ERROR:
        return data
    written = io.BytesIO()
    reduced.save(written, "PNG", optimize=True)
    return min(written.getvalue(), data, key=len)


def main(folders: list[str]) -> int:
    """Shrink every PNG in the folders; return the exit code."""
    if not folders:
        print(__doc__, file=sys.stderr)
        return 2
    before = after = 0
    for path in (path for folder in folders for path in sorted(Path(folder).glob("*.png"))):
        data = path.read_bytes()
        small = shrink(data)
        if small is not data:
            path.write_bytes(small)
        before, after = before + len(data), after + len(small)
    print(f"Pictures: {before / 1e6:.1f} MB before, {after / 1e6:.1f} MB now")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
