"""Tables that a cell shows: HTML for a reader, aligned text for the tests.

A cell ends with ``table(rows, columns)`` or ``quantities(...)``.  The book shows the HTML;
``nbval`` compares the text, which holds the same words and numbers.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from d2d.study.book.typography import typeset

Column = str | tuple[str, ...]
"""A heading, or a heading with a unit ("" for none) and the format of its numbers."""

GAP = "  "
ABSENT = "–"


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
    """A table of finished cells, which shows itself.

    Attributes
    ----------
    header : tuple of (str, str)
        The heading and the unit of each column; empty if the rows speak for themselves.
    rows : tuple of tuple of str
        The first cell of each names the row.
    numeric : tuple of bool
        Which columns hold numbers, and so are set flush right.
    caption : str
        What the table shows, in one sentence.
    groups : tuple of (str, int)
        Headings over several columns each, with how many, from the first column on.
    """

    header: tuple[tuple[str, str], ...]
    rows: tuple[tuple[str, ...], ...]
    numeric: tuple[bool, ...]
    caption: str = ""
    groups: tuple[tuple[str, int], ...] = ()

    def __str__(self) -> str:
        """The caption and the columns, aligned."""
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
        """A table in a box of its own that scrolls where it is wider than the page."""
        caption = f"<figcaption>{typeset(self.caption)}</figcaption>" if self.caption else ""
        head = "".join(
            f'<th scope="col"{_number(right)}>{typeset(name)}{_unit(unit)}</th>'
            for (name, unit), right in zip(self.header, self.numeric, strict=bool(self.header))
        )
        over = "".join(
            f'<th scope="colgroup" colspan="{span}">{typeset(title)}</th>'
            if title
            else f'<td colspan="{span}"></td>'
            for title, span in self.groups
        )
        over = f"<tr>{over}</tr>" if over else ""
        body = "\n".join(f"<tr>{self._html_row(row)}</tr>" for row in self.rows)
        return (
            f'<figure class="measured">{caption}<div class="measured-scroll"><table>\n'
            + (
                f"<thead>{f'<tr>{over}</tr>' if over else ''}<tr>{head}</tr></thead>\n"
                if head
                else ""
            )
            + f"<tbody>\n{body}\n</tbody></table></div></figure>"
        )

    def _html_row(self, row: Sequence[str]) -> str:
        first, *others = map(typeset, row)
        cells = [
            f"<td{_number(right)}>{text}</td>"
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

    Parameters
    ----------
    rows : mapping or iterable of sequences
        The rows, the first cell of each being its name.  Of a mapping, the keys name the rows, and
        a value is the rest of a row: a sequence or array, a mapping by heading, or a single value.
    columns : sequence of str or (str, str) or (str, str, str)
        For each column its heading, or (heading, unit), or (heading, unit, format): ``"method"``,
        ``("translation", "mm", ".0f")``, ``("share", "", ".0%")``.  Without a format, numbers have
        three significant digits.
    caption : str
        What the table shows.
    groups : mapping of str to int
        Headings over several columns, with how many columns each; together the last ones.

    Returns
    -------
    Table
        Shown as HTML in a notebook and printed as text.

    Raises
    ------
    ValueError
        If there are no rows, the number of cells of a row is wrong, or the groups have more columns
        than the table.

    Examples
    --------
    >>> table({"ICP": (14.9, 0.46)}, ["method", ("translation", "mm", ".0f"), ("rotation", "deg")])
    method  translation (mm)  rotation (deg)
    ICP                   15            0.46
    """
    specified = [_complete(column) for column in columns]
    headings = [name for name, _, _ in specified]
    if isinstance(rows, Mapping):
        listed = [(name, *_rest(value, headings[1:])) for name, value in rows.items()]
    else:
        listed = [tuple(row) for row in rows]
    if not listed:
        raise ValueError("rows: a table needs at least one")
    for row in listed:
        if len(row) != len(specified):
            raise ValueError(f"rows: {row} has {len(row)} cells for {len(specified)} columns")
    cells = tuple(
        tuple(cell(value, form) for value, (_, _, form) in zip(row, specified, strict=True))
        for row in listed
    )
    numeric = tuple(
        not any(isinstance(value, str) for value in column) for column in zip(*listed, strict=True)
    )
    header = tuple((name, unit) for name, unit, _ in specified)
    over = _groups(groups or {}, len(header))
    return Table(header, cells, (False, *numeric[1:]), caption, over)


def quantities(*named: tuple[Any, ...], caption: str = "") -> Table:
    """Set single quantities one below the other; end a cell with it.

    Parameters
    ----------
    *named : (str, value) or (str, value, str) or (str, value, str, str)
        The name of each with its value, unit ("" for none) and format, as in `table`.
    caption : str
        What they belong to.

    Raises
    ------
    ValueError
        If there are none, or one is not a name and a value.

    Examples
    --------
    >>> quantities(("points", 180), ("true motion, x", 0.5, "m", ".1f"))
    points            180
    true motion, x  0.5 m
    """
    if not named:
        raise ValueError("named: at least one is needed")
    rows = []
    for quantity in named:
        if not 2 <= len(quantity) <= 4:
            raise ValueError(f"named: expected (name, value, unit, format), got {quantity}")
        name, value, unit, form = (*quantity, "", "")[:4]
        rows.append((str(name), f"{cell(value, form)} {unit}".rstrip()))
    return Table((), tuple(rows), (False, True), caption)


def _complete(column: Column) -> tuple[str, str, str]:
    """Heading, unit and format of a column."""
    parts = (column,) if isinstance(column, str) else tuple(column)
    if not 1 <= len(parts) <= 3:
        raise ValueError(f"columns: expected a heading or (heading, unit, format), got {column!r}")
    name, unit, form = (*parts, "", "")[:3]
    return name, unit, form


def _groups(groups: Mapping[str, int], columns: int) -> tuple[tuple[str, int], ...]:
    """The groups, after one without a title over the columns before them."""
    before = columns - sum(groups.values())
    if before < 1:
        raise ValueError(f"groups: {dict(groups)} leave no column of {columns} for the rows' names")
    return (("", before), *groups.items()) if groups else ()


def _rest(value: Any, headings: Sequence[str]) -> tuple[Any, ...]:
    """The cells of a row that follow its name."""
    if isinstance(value, Mapping):
        return tuple(value.get(heading) for heading in headings)
    if isinstance(value, str) or np.ndim(value) == 0:
        return (value,)
    return tuple(value)


def _number(right: bool) -> str:
    return ' class="number"' if right else ""


def _unit(unit: str) -> str:
    return f' <span class="unit">{typeset(unit)}</span>' if unit else ""
