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
from typing import NamedTuple

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

FONT_SIZE = 10.5  # pt: eleven pixels high if a three-column chart is 370 pixels wide
LINE_HEIGHT, PADDING, GAP = 0.19, 0.17, 0.34  # inches: of a text line, inside and between boxes
BOX_SHARE = 0.84  # of a column's width
FILL, TERMINAL_FILL, NEW_FILL, EDGE = "#FFFFFF", "#DCEEF8", "#FFE7B3", "#333333"

_ARROW = re.compile(r"\s(->|-\||\|-)\s")


class Box(NamedTuple):
    """A box: its label, its place in the table, whether it starts or ends the chart or is new."""

    label: str
    row: int
    column: int
    terminal: bool
    new: bool


class Arrow(NamedTuple):
    """An arrow between two named boxes: its kind ``->``, ``-|`` or ``|-`` and its label."""

    tail: str
    head: str
    kind: str
    label: str


class Chart(NamedTuple):
    """The boxes by name, and the arrows."""

    boxes: dict[str, Box]
    arrows: tuple[Arrow, ...]


def parse(text: str) -> Chart:
    """Read a chart from its text.

    Raises
    ------
    ValueError
        If a box has no label, a name is used twice, an arrow starts or ends at no box, or a
        straight arrow joins boxes that are not aligned.  The message names the boxes.
    """
    lines = [line for line in text.splitlines() if line.strip()]
    boxes: dict[str, Box] = {}
    for row, line in enumerate(line for line in lines if not _ARROW.search(line)):
        for column, cell in enumerate(line.split("|")):
            if cell.strip():
                name, box = _box(cell, row, column)
                if name in boxes:
                    raise ValueError(f"text names the box {name!r} twice")
                boxes[name] = box
    arrows = tuple(arrow for line in lines if _ARROW.search(line) for arrow in _arrows(line, boxes))
    return Chart(boxes, arrows)


def flow_chart(text: str, width: float = 4.8) -> Figure:
    """Draw the chart that ``text`` defines, ``width`` inches wide.

    Raises
    ------
    ValueError
        As `parse` does.
    """
    chart = parse(text)
    columns = 1 + max(box.column for box in chart.boxes.values())
    rows = 1 + max(box.row for box in chart.boxes.values())
    heights = [
        max(_height(box) for box in chart.boxes.values() if box.row == row) for row in range(rows)
    ]
    total = sum(heights) + GAP * (rows - 1) + 0.1
    tops = [total - 0.05 - sum(heights[:row]) - GAP * row for row in range(rows)]
    box_width = BOX_SHARE * width / columns

    def centre(box: Box) -> tuple[float, float]:
        return (box.column + 0.5) * width / columns, tops[box.row] - 0.5 * heights[box.row]

    figure = plt.figure(figsize=(width, total), layout="none")
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set(xlim=(0.0, width), ylim=(0.0, total))
    ax.axis("off")
    for box in chart.boxes.values():
        _draw_box(ax, box, centre(box), box_width)
    for order, arrow in enumerate(chart.arrows):
        tail, head = chart.boxes[arrow.tail], chart.boxes[arrow.head]
        path = _path(arrow.kind, centre(tail), centre(head))
        path[0] = _border_point(path[0], path[1], 0.5 * box_width, 0.5 * _height(tail))
        path[-1] = _border_point(path[-1], path[-2], 0.5 * box_width, 0.5 * _height(head))
        _draw_arrow(ax, path, arrow.label, order)
    return figure


def _box(cell: str, row: int, column: int) -> tuple[str, Box]:
    name, colon, label = (part.strip() for part in cell.partition(":"))
    if not colon or not name or not label:
        raise ValueError(f"text must define a box as 'name: label', but has {cell.strip()!r}")
    new = label.startswith("*") and label.endswith("*")
    label = label.strip("*").strip() if new else label
    terminal = label.startswith("(") and label.endswith(")")
    lines = (label[1:-1] if terminal else label).split("//")
    return name, Box("\n".join(line.strip() for line in lines), row, column, terminal, new)


def _arrows(line: str, boxes: dict[str, Box]) -> list[Arrow]:
    chain, _, label = line.partition(":")
    parts = [part.strip() for part in _ARROW.split(f" {chain} ")]
    names, kinds = parts[::2], parts[1::2]
    for name in names:
        if name not in boxes:
            raise ValueError(f"text has the arrow {chain.strip()!r}, but no box {name!r}")
    labels = [""] * (len(kinds) - 1) + [label.strip()]
    arrows = list(map(Arrow, names[:-1], names[1:], kinds, labels))
    for tail, head, kind, _ in arrows:
        start, end = boxes[tail], boxes[head]
        if kind == "->" and start.row != end.row and start.column != end.column:
            raise ValueError(
                f"text must join {tail!r} and {head!r} with -| or |-: they are not aligned"
            )
    return arrows


def _height(box: Box) -> float:
    return LINE_HEIGHT * (1 + box.label.count("\n")) + PADDING


Point = tuple[float, float]


def _path(kind: str, tail: Point, head: Point) -> list[Point]:
    """The corners of an arrow from centre to centre."""
    if kind == "->":
        return [tail, head]
    return [tail, (head[0], tail[1]) if kind == "-|" else (tail[0], head[1]), head]


def _border_point(centre: Point, towards: Point, half_width: float, half_height: float) -> Point:
    """Where the line from a box's centre to a point straight beside or above it leaves the box."""
    (x, y), (u, v) = centre, towards
    if abs(u - x) > abs(v - y):
        return x + (half_width if u > x else -half_width), y
    return x, y + (half_height if v > y else -half_height)


def _draw_box(ax: Axes, box: Box, centre: Point, width: float) -> None:
    height = _height(box)
    corner = (centre[0] - 0.5 * width, centre[1] - 0.5 * height)
    rounding = 0.5 * min(height, 0.36) if box.terminal else 0.04
    ax.add_patch(
        FancyBboxPatch(
            corner,
            width,
            height,
            boxstyle=f"round,pad=0,rounding_size={rounding}",
            facecolor=NEW_FILL if box.new else TERMINAL_FILL if box.terminal else FILL,
            edgecolor=EDGE,
            linewidth=2.0 if box.new else 1.0,
            zorder=3.0,
        )
    )
    ax.text(
        *centre,
        box.label,
        ha="center",
        va="center",
        fontsize=FONT_SIZE,
        linespacing=1.25,
        zorder=4.0,
    )


def _draw_arrow(ax: Axes, path: list[Point], label: str, order: int) -> None:
    *_, (x, y), (u, v) = path
    level = 2.0 + 0.01 * order  # below the boxes
    # a white edge: where two lines cross, the earlier one passes visibly below the later
    ax.plot(*zip(*path, strict=True), color=FILL, linewidth=6.0, zorder=level)
    if len(path) > 2:
        corner = zip(*path[:-1], strict=True)
        ax.plot(*corner, color=EDGE, linewidth=1.2, solid_capstyle="round", zorder=level)
    style: dict[str, str | float] = {
        "arrowstyle": "-|>",
        "color": EDGE,
        "linewidth": 1.2,
        "shrinkA": 0,
        "shrinkB": 0,
    }
    ax.annotate("", (u, v), (x, y), arrowprops=style, zorder=level)
    if label:
        (x, y), (u, v) = path[-2:]
        upright = abs(v - y) > abs(u - x)
        ax.text(
            0.5 * (x + u) + (0.06 if upright else 0.0),
            0.5 * (y + v) + (0.0 if upright else 0.05),
            label,
            ha="left" if upright else "center",
            va="center" if upright else "bottom",
            fontsize=FONT_SIZE - 1.5,
        )
