"""Pictures as SVG text.

Coordinates are rounded to a tenth: that is less than can be seen, and keeps a picture short.
"""

from collections.abc import Iterable

from d2d._types import Array

PHONE = 480.0
"""Width of a drawing whose text a phone still shows at 11 pixels or more."""


def element(tag: str, *children: str, **attributes: str | float) -> str:
    """One element with its children; an attribute ``stroke_width`` becomes ``stroke-width``."""
    listed = "".join(
        f' {name.replace("_", "-")}="{value if isinstance(value, str) else number(value)}"'
        for name, value in attributes.items()
    )
    return f"<{tag}{listed}>{''.join(children)}</{tag}>" if children else f"<{tag}{listed}/>"


def number(value: float) -> str:
    """A coordinate, rounded to a tenth."""
    return f"{round(float(value), 1) + 0.0:g}"


def polyline(points: Array, colour: str, width: float) -> str:
    """A line through points (N, 2)."""
    coordinates = " ".join(f"{number(x)},{number(y)}" for x, y in points)
    return element("polyline", points=coordinates, fill="none", stroke=colour, stroke_width=width)


def path(d: str, **attributes: str | float) -> str:
    """A path given by its commands."""
    return element("path", d=d, **attributes)


def circle(x: float, y: float, radius: float, colour: str) -> str:
    """A filled circle."""
    return element("circle", cx=x, cy=y, r=radius, fill=colour)


def text(x: float, y: float, content: str, **attributes: str | float) -> str:
    """A line of text that begins at (x, y), or is placed as ``text_anchor`` says."""
    return element("text", content, x=x, y=y, **attributes)


def picture(width: float, height: float, label: str, parts: Iterable[str]) -> str:
    """A picture that fills the width of its place; ``label`` describes it to screen readers."""
    return element(
        "svg",
        "\n".join(parts),
        viewBox=f"0 0 {number(width)} {number(height)}",
        width="100%",
        role="img",
        aria_label=label,
        font_family="sans-serif",
        font_size=17.0,
        fill="#111",
    )
