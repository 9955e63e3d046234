"""Tables that a cell shows: HTML for a reader, aligned text for the tests.

A cell ends with ``table(rows, columns)`` or ``quantities(...)``.  The book shows the HTML;
``nbval`` compares the text, which holds the same words and numbers.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np

Column = str | tuple[str, ...]
"""A heading, or a heading with a unit ("" for none) and the format of its numbers."""

GAP = "  "
ABSENT = "–"
NUMBER = ' class="number"'
FEW = 8  # cells that need no table


def significant(value: float) -> str:
    """Three significant digits; whole numbers and numbers of at least 1000 without decimals."""
    if not math.isfinite(value):
        return ABSENT if math.isnan(value) else str(value)
    whole = float(value).is_integer() or abs(value) >= 1000
    return f"{value:.0f}" if whole else f"{value:.3g}"


def cell(value: Any, specification: str = "") -> str:
    """One value as it is printed, with a format such as ``.2f`` or ``.0%``.

    Text stays as it is, ``True`` is "yes", and what is missing (``None``, nan) is a dash.
    """
    if value is None:
        return ABSENT
    if isinstance(value, str):
        return value
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if not np.isfinite(value):
        return significant(float(value))
    return format(value, specification) if specification else significant(float(value))


@dataclass(frozen=True)
class Table:
    """A table of finished cells, which shows itself; `table` makes one."""

    header: tuple[tuple[str, str], ...]  # heading and unit of each column; may be empty
    rows: tuple[tuple[str, ...], ...]  # the first cell of each names the row
    numeric: tuple[bool, ...]  # which columns hold numbers, and so are set flush right
    caption: str = ""
    groups: tuple[tuple[str, int], ...] = ()  # headings with their columns, from the first one on

    def __str__(self) -> str:
        heads = [f"{name} ({unit})" if unit else name for name, unit in self.header]
        lines = [tuple(heads), *self.rows] if heads else list(self.rows)
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        over, first = [], 0
        for title, span in self.groups:
            last = first + span - 1
            width = sum(widths[first : last + 1]) + len(GAP) * (span - 1)
            widths[last] += max(len(title) - width, 0)
            over.append(title.center(width, "-" if title else " "))
            first = last + 1
        aligned = [
            GAP.join(
                text.rjust(width) if right else text.ljust(width)
                for text, width, right in zip(line, widths, self.numeric, strict=True)
            ).rstrip()
            for line in lines
        ]
        above = [self.caption] if self.caption else []
        return "\n".join([*above, *([GAP.join(over)] if over else []), *aligned])

    __repr__ = __str__

    def _repr_html_(self) -> str:
        """A table in a box of its own that scrolls where it is wider than the page.

        A few numbers stand in a line: "After one second: **0.16 °/s**".
        """
        few = len(self.rows) == 1 or len(self.rows) * len(self.rows[0]) <= FEW
        if few and not self.groups:
            before = f"{escape(self.caption)} " if self.caption else ""
            line = "; ".join(map(self._html_line, self.rows))
            if line[:2].isalpha() and not self.caption.endswith(":"):  # not a symbol
                line = line[0].upper() + line[1:]
            return f'<p class="measured">{before}{line}</p>'
        parts = ['<figure class="measured">']
        if self.caption:
            parts.append(f"<figcaption>{escape(self.caption)}</figcaption>")
        parts.append('<div class="measured-scroll"><table>\n')
        if self.header:
            parts.append(f"<thead>{self._html_groups()}<tr>{self._html_header()}</tr></thead>\n")
        body = "\n".join(f"<tr>{self._html_row(row)}</tr>" for row in self.rows)
        parts.append(f"<tbody>\n{body}\n</tbody></table></div></figure>")
        return "".join(parts)

    def _html_line(self, row: Sequence[str]) -> str:
        header = self.header or [("", "")] * len(row)
        numbers = (
            " ".join(filter(None, (name, text, unit)))
            for (name, unit), text in zip(header[1:], row[1:], strict=True)
        )
        return f"{escape(row[0])}: <b>{escape(', '.join(numbers))}</b>"

    def _html_groups(self) -> str:
        cells = [
            f'<th scope="colgroup" colspan="{span}">{escape(title)}</th>'
            if title
            else f'<td colspan="{span}"></td>'
            for title, span in self.groups
        ]
        return f"<tr>{''.join(cells)}</tr>" if cells else ""

    def _html_header(self) -> str:
        cells = []
        for (name, unit), right in zip(self.header, self.numeric, strict=True):
            of_unit = f' <span class="unit">{escape(unit)}</span>' if unit else ""
            cells.append(f'<th scope="col"{NUMBER if right else ""}>{escape(name)}{of_unit}</th>')
        return "".join(cells)

    def _html_row(self, row: Sequence[str]) -> str:
        first, *others = map(escape, row)
        cells = [
            f"<td{NUMBER if right else ''}>{text}</td>"
            for text, right in zip(others, self.numeric[1:], strict=True)
        ]
        return "".join([f'<th scope="row">{first}</th>', *cells])


def table(
    rows: Mapping[Any, Any] | Iterable[Sequence[Any]],
    columns: Sequence[Column],
    caption: str = "",
    *,
    groups: Mapping[str, int] | None = None,
) -> Table:
    """Set values as a table; end a cell with it.

    The first cell of each of the ``rows`` is its name.  Of a mapping, the keys name the rows, and a
    value is the rest of a row: a sequence or array, a mapping by heading, or a single value.  Each
    of the ``columns`` has a heading, or (heading, unit), or (heading, unit, format); without a
    format, numbers have three significant digits.  ``groups`` are headings over several columns,
    with how many columns each; together the last ones.

    Examples
    --------
    >>> table({"ICP": (14.9, 0.46)}, ["method", ("translation", "mm", ".0f"), ("rotation", "deg")])
    method  translation (mm)  rotation (deg)
    ICP                   15            0.46
    """
    specified = [_padded((column,) if isinstance(column, str) else column) for column in columns]
    headings = [name for name, _, _ in specified]
    if isinstance(rows, Mapping):
        listed = [(name, *_rest(value, headings[1:])) for name, value in rows.items()]
    else:
        listed = [tuple(row) for row in rows]
    cells = tuple(
        tuple(cell(value, form) for value, (_, _, form) in zip(row, specified, strict=True))
        for row in listed
    )
    numeric = [
        not any(isinstance(value, str) for value in column) for column in zip(*listed, strict=True)
    ]
    header = tuple((name, unit) for name, unit, _ in specified)
    over = (("", len(header) - sum(groups.values())), *groups.items()) if groups else ()
    return Table(header, cells, (False, *numeric[1:]), caption, over)


def quantities(*named: tuple[Any, ...], caption: str = "") -> Table:
    """Set single quantities one below the other; end a cell with it.

    Each has a name, a value and, if wanted, a unit ("" for none) and a format, as in `table`.

    Examples
    --------
    >>> quantities(("points", 180), ("true motion, x", 0.5, "m", ".1f"))
    points            180
    true motion, x  0.5 m
    """
    rows = []
    for quantity in named:
        name, value, unit, form = (*quantity, "", "")[:4]
        rows.append((str(name), f"{cell(value, form)} {unit}".rstrip()))
    return Table((), tuple(rows), (False, True), caption)


def _padded(column: Sequence[str]) -> tuple[str, str, str]:
    name, unit, form = (*column, "", "")[:3]
    return name, unit, form


def _rest(value: Any, headings: Sequence[str]) -> tuple[Any, ...]:
    if isinstance(value, Mapping):
        return tuple(value.get(heading) for heading in headings)
    if isinstance(value, str) or np.ndim(value) == 0:
        return (value,)
    return tuple(value)
