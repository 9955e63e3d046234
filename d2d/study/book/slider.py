"""Animations that need no server: all frames in one piece of HTML, with a slider."""

import base64
from collections.abc import Sequence
from html import escape
from io import BytesIO

import matplotlib.pyplot as plt
from matplotlib.figure import Figure
from PIL import Image

from d2d.study.book.templates import render


def picture(figure: Figure, alt: str) -> str:
    """Return a figure as an HTML image, reduced to a few colours, and close it."""
    drawn, stored = BytesIO(), BytesIO()
    figure.savefig(drawn, dpi=150)
    Image.open(drawn).convert("RGB").quantize(128).save(stored, "PNG", optimize=True)
    plt.close(figure)
    data = base64.b64encode(stored.getvalue()).decode()
    return f'<img alt="{escape(alt)}" style="width:100%" src="data:image/png;base64,{data}">'


def animate(name: str, frames: Sequence[str], captions: Sequence[str], *, first: int = 0) -> str:
    """Return HTML that shows a frame at a time, chosen with a slider; ``first`` without scripts.

    Frames are HTML, captions plain text, and ``name`` is an id of the page.
    """
    return render(
        "slider.html", name=name, frames=list(zip(frames, captions, strict=True)), first=first
    )
