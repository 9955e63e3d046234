"""The figure style of the book; the meaning of the colours is in `d2d.study.book.grammar`."""

from collections.abc import Sequence
from importlib.resources import as_file, files
from textwrap import fill

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.font_manager import fontManager
from numpy.typing import NDArray

PAGE = 7.45
"""Width in inches of a figure that reaches across text and margin.

A figure of many panels is drawn twice, in a column and as wide as the page, and its cell has the
class ``page``: the page shows the one that fits.
"""


def use_style() -> None:
    """Switch matplotlib to the book's style, with the letters of its pages."""
    with as_file(files("d2d.study.book")) as folder:
        for face in sorted((folder / "fonts").glob("*.ttf")):
            fontManager.addfont(face)
        plt.style.use(folder / "book.mplstyle")


def letter_panels(axes: NDArray[np.object_]) -> None:
    """Put (a), (b), ... before the titles, and each label at the panel with the axis's numbers."""
    for letter, ax in zip("abcdefghijkl", axes.ravel(), strict=False):
        ax.set_title(f"({letter}) {ax.get_title('left')}".rstrip())
        for axis, side in ((ax.xaxis, "labelbottom"), (ax.yaxis, "labelleft")):
            if not axis.get_tick_params().get(side, True):
                axis.set_label_text("")


def headline(figure: Figure, finding: str) -> None:
    """Write above all panels what a figure shows, in lines that are as wide as the figure."""
    letters = round(13.3 * figure.get_figwidth())
    figure.suptitle(fill(finding, letters), x=0.01, ha="left")


def write_out_ticks(axis: Axis, ticks: Sequence[float]) -> None:
    """The only ticks of a logarithmic axis, with plain numbers instead of powers of ten."""
    axis.set_ticks(ticks, [f"{tick:g}".replace("-", "−") for tick in ticks])
    axis.minorticks_off()


def label_planar_axes(ax: Axes, title: str = "") -> None:
    """Label both axes in metres and give them the same scale."""
    ax.set_aspect("equal", adjustable="box")
    ax.set_xlabel("x (m)")
    ax.set_ylabel("y (m)")
    ax.set_title(title)
