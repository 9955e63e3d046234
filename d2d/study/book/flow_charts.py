r"""Flow charts from a few lines of text.

A chart is a table of boxes and the arrows between them::

    fixed: (Fixed set) |                           | moving: (Moving set)
                       | pair: Nearest // partners | move: Move
                       | fit: Fit the motion       | guess: Current guess
                       | end: (Motion)             | start: (Initial guess)

    moving -> move -> pair -> fit -> end: converged
    fixed |- pair
    start -> guess -> move
    fit -> guess

Each line of boxes is a row; ``|`` separates its columns, and a cell may stay empty.  A box is a
name and a label: ``//`` starts a new line of the label, round brackets around it make a terminal,
and stars around it mark what is new in this chart.  ``->`` joins boxes in one row or column,
``-|`` goes across first and then up or down, ``|-`` the other way round.  A text after the last
box of a line of arrows labels its last arrow.
"""

import re
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

FONT_SIZE = 10.5  # pt: eleven pixels high if a three-column chart is 370 pixels wide
LINE_HEIGHT, PADDING, GAP = 0.19, 0.17, 0.34  # inches: of a text line, inside and between boxes
BOX_SHARE = 0.84  # of a column's width
WHITE, BLUE, MARKED, DARK = "#FFFFFF", "#DCEEF8", "#DDDDDD", "#333333"

ARROW: dict[str, Any] = {"arrowstyle": "-|>", "mutation_scale": 10.0, "lw": 1.2, "color": DARK}
EDGE_OF_ARROW: dict[str, Any] = {"arrowstyle": "-", "lw": 6.0, "color": WHITE}
CONNECTIONS = {
    "->": "arc3",  # straight
    "-|": "angle,angleA=0,angleB=90",
    "|-": "angle,angleA=90,angleB=0",
}
_ARROW = re.compile(r"\s(->|-\||\|-)\s")


class Box(NamedTuple):
    """A box as it is drawn: its patch, its centre and its height in inches."""

    patch: FancyBboxPatch
    x: float
    y: float
    height: float


def flow_chart(text: str, width: float = 4.8) -> Figure:
    """Draw the chart that ``text`` defines, ``width`` inches wide.

    Raises ``KeyError`` with the name if an arrow starts or ends at no box.
    """
    lines = [line for line in text.splitlines() if line.strip()]
    rows = [line.split("|") for line in lines if not _ARROW.search(line)]
    heights = [max(map(_height, row)) for row in rows]
    column = width / max(map(len, rows))
    total = sum(heights) + GAP * (len(rows) - 1) + 0.1

    figure = plt.figure(figsize=(width, total), layout="none")
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set(xlim=(0.0, width), ylim=(0.0, total))
    ax.axis("off")
    boxes = {}
    top = total - 0.05
    for row, height in zip(rows, heights, strict=True):
        for place, cell in enumerate(row):
            if cell.strip():
                name, _, label = cell.partition(":")
                x, y = (place + 0.5) * column, top - 0.5 * height
                boxes[name.strip()] = _draw_box(ax, label.strip(), x, y, BOX_SHARE * column)
        top -= height + GAP
    for line in filter(_ARROW.search, lines):
        chain, _, label = line.partition(":")
        parts = [part.strip() for part in _ARROW.split(chain)]
        names, kinds = parts[::2], parts[1::2]
        labels = [""] * (len(kinds) - 1) + [label.strip()]
        for tail, head, kind, said in zip(names[:-1], names[1:], kinds, labels, strict=True):
            _draw_arrow(ax, boxes[tail], boxes[head], kind, said)
    return figure


def _height(label: str) -> float:
    return LINE_HEIGHT * (1 + label.count("//")) + PADDING


def _draw_box(ax: Axes, label: str, x: float, y: float, width: float) -> Box:
    height = _height(label)
    terminal, new = label.startswith("("), label.startswith("*")
    rounding = min(0.5 * height, 0.18) if terminal else 0.04
    patch = FancyBboxPatch(
        (x - 0.5 * width, y - 0.5 * height),
        width,
        height,
        boxstyle=f"round,pad=0,rounding_size={rounding}",
        facecolor=BLUE if terminal else MARKED if new else WHITE,
        edgecolor=DARK,
        linewidth=2.0 if new else 1.0,
        zorder=3.0,
    )
    ax.add_patch(patch)
    inner = label[1:-1] if terminal or new else label
    ax.text(
        x,
        y,
        "\n".join(line.strip() for line in inner.split("//")),
        ha="center",
        va="center",
        fontsize=FONT_SIZE,
        linespacing=1.25,
        zorder=4.0,
    )
    return Box(patch, x, y, height)


def _draw_arrow(ax: Axes, tail: Box, head: Box, kind: str, label: str) -> None:
    # a white edge: where two lines cross, the earlier one passes visibly below the later
    for style in (EDGE_OF_ARROW, ARROW):
        arrow = FancyArrowPatch(
            (tail.x, tail.y),
            (head.x, head.y),
            connectionstyle=CONNECTIONS[kind],
            patchA=tail.patch,
            patchB=head.patch,
            shrinkA=0.0,
            shrinkB=0.0,
            zorder=2.0,  # below the boxes
            **style,
        )
        ax.add_patch(arrow)
    if label:  # beside the head
        side = 1.0 if tail.y > head.y else -1.0
        y = head.y + side * 0.5 * (head.height + GAP)
        ax.text(head.x + 0.06, y, label, va="center", fontsize=FONT_SIZE - 1.5)
