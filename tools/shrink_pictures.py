"""Make the pictures of the built book small enough for a phone: PNGs with a palette.

    python tools/shrink_pictures.py _build/html/_images

A figure has few colours; the shades along the edges of its lines are merged, so that 256 suffice.
Pictures that would look different (photographs, transparency) or not get smaller are left alone.
"""

from __future__ import annotations

import io
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from PIL import Image, ImageChops, ImageStat

MAX_ERROR = 1.0
"""Mean error (0 to 255) of the worst colour channel; far less than the eye can see."""


def shrink(data: bytes) -> bytes:
    """The same picture as a PNG with a palette, or `data` if that is not smaller."""
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


def shrink_file(path: Path) -> tuple[int, int]:
    """Shrink a PNG in its place; return its size before and after."""
    data = path.read_bytes()
    small = shrink(data)
    if small is not data:
        path.write_bytes(small)
    return len(data), len(small)


def main(folders: list[str]) -> int:
    """Shrink every PNG in the folders; return the exit code."""
    if not folders:
        print(__doc__, file=sys.stderr)
        return 2
    paths = [path for folder in folders for path in sorted(Path(folder).glob("*.png"))]
    with ThreadPoolExecutor() as pool:
        sizes = list(pool.map(shrink_file, paths))
    before, after = sum(size for size, _ in sizes), sum(size for _, size in sizes)
    print(f"Pictures: {before / 1e6:.1f} MB before, {after / 1e6:.1f} MB now")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
