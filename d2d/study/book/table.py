"""Tables that end a cell: HTML for a reader, and aligned text of the same words for the tests."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
import pandas as pd

from d2d.study.book.templates import render

Column = str | tuple[str, ...]
"""A heading, or a heading with a unit ("" for none) and the format of its numbers."""

ABSENT = "–"
_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?%?")


def significant(value: float) -> str:
    """Three significant digits; whole numbers and numbers of at least 1000 without decimals."""
    if not math.isfinite(value):
        return ABSENT if math.isnan(value) else str(value)
    whole = float(value).is_integer() or abs(value) >= 1000
    return f"{value:.0f}" if whole else f"{value:.3g}"


def cell(value: Any, specification: str = "") -> str:
    """One value as it is printed; a dash if it is missing (``None``, nan), "yes" for ``True``."""
    if value is None:
        return ABSENT
    if isinstance(value, str):
        return value
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if specification and np.isfinite(value):
        return format(value, specification)
    return significant(float(value))


def _is_number(value: Any) -> bool:
    """Whether a value is a number, missing, a truth, or a text that reads as a number."""
    return not isinstance(value, str) or _NUMBER.fullmatch(value) is not None


@dataclass(frozen=True)
class Table:
    """A table of finished cells, which shows itself; `table` makes one."""

    header: tuple[tuple[str, str, str], ...]  # group, heading and unit of each column; may be empty
    rows: tuple[tuple[str, ...], ...]  # the first cell of each names the row
    numeric: tuple[bool, ...]  # which columns hold numbers, and so are set flush right
    caption: str = ""

    def __str__(self) -> str:
        heads = [
            (f"{group}: " if group else "") + (f"{name} ({unit})" if unit else name)
            for group, name, unit in self.header
        ]
        lines = [*([heads] if heads else []), *self.rows]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        aligned = [
            "  ".join(
                text.rjust(width) if right else text.ljust(width)
                for text, width, right in zip(line, widths, self.numeric, strict=True)
            ).rstrip()
            for line in lines
        ]
        return "\n".join([self.caption, *aligned] if self.caption else aligned)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        groups = [(group, len([*run])) for group, run in groupby(head[0] for head in self.header)]
        return render("table.html", groups=groups, **vars(self))


def table(
    rows: Mapping[Any, Any] | Iterable[Sequence[Any]] | pd.DataFrame,
    columns: Sequence[Column],
    caption: str = "",
    *,
    groups: Mapping[str, int] | None = None,
) -> Table:
    """Set values as a table; end a cell with it.

    The first cell of each of the ``rows`` is its name.  Of a mapping, the keys name the rows, and a
    value is the rest of a row: a sequence or array, or a single value.  Each of the ``columns`` has
    a heading, or (heading, unit), or (heading, unit, format); without a format, numbers have three
    significant digits.  Numbers, and texts that read as numbers, are set flush right.  ``groups``
    are headings over several columns, with how many columns each; together the last ones.

    Examples
    --------
    >>> columns = ["method", ("translation", "mm", ".0f"), ("rotation", "deg")]
    >>> table({"ICP": (14.9, 0.46)}, columns)
    method  translation (mm)  rotation (deg)
    ICP                   15            0.46
    """
    padded = [((column,) if isinstance(column, str) else column) + ("", "") for column in columns]
    if isinstance(rows, pd.DataFrame):
        listed = list(rows.itertuples(index=False, name=None))
    elif isinstance(rows, Mapping):
        listed = [(name, *np.atleast_1d(np.array(rest, object))) for name, rest in rows.items()]
    else:
        listed = [tuple(row) for row in rows]
    cells = tuple(
        tuple(cell(value, spec[2]) for value, spec in zip(row, padded, strict=True))
        for row in listed
    )
    numeric = [all(map(_is_number, column)) for column in zip(*listed, strict=True)]
    over = [group for group, span in (groups or {}).items() for _ in range(span)]
    over = [""] * (len(padded) - len(over)) + over
    header = tuple((group, spec[0], spec[1]) for group, spec in zip(over, padded, strict=True))
    return Table(header, cells, (False, *numeric[1:]), caption)


def quantities(*named: tuple[Any, ...], caption: str = "") -> Table:
    """Set single quantities one below the other; end a cell with it.

    Each has a name, a value and, if wanted, a unit ("" for none) and a format, as in `table`.

    Examples
    --------
    >>> quantities(("points", 180), ("true motion, x", 0.5, "m", ".1f"))
    points            180
    true motion, x  0.5 m
    """
    padded = [(*quantity, "", "")[:4] for quantity in named]
    rows = tuple(
        (str(name), f"{cell(value, form)} {unit}".rstrip()) for name, value, unit, form in padded
    )
    return Table((), rows, (False, True), caption)
