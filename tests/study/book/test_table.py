"""Tables hold the same numbers as text and as HTML."""

import re
from html import unescape

import numpy as np
import pandas as pd
import pytest

from d2d.study.book.table import cell, quantities, significant, table

COLUMNS = ["method", ("error", "mm", ".1f"), "converged"]
ROWS = {"ICP & co.": (-14.94, True), "NDT": (np.nan, None), "P2D": (2.0, False)}


def words(html: str) -> list[str]:
    """What a reader of the HTML sees, cell by cell."""
    found = re.findall(r"<(?:th|td)[^>]*>(.*?)</(?:th|td)>", html)
    return [unescape(re.sub("<[^>]*>", "", each)) for each in found]


def test_text_and_html_say_the_same():
    """Breaks if a column loses its unit, its format or its alignment, or what is compared is not
    what is read."""
    shown = table(ROWS, COLUMNS, "Errors <of> three methods.")
    assert str(shown).splitlines() == [
        "Errors <of> three methods.",
        "method     error (mm)  converged",
        "ICP & co.       -14.9        yes",
        "NDT                 –          –",
        "P2D               2.0         no",
    ]
    html = shown._repr_html_()
    assert words(html) == [
        *("method", "error mm", "converged", "ICP & co.", "-14.9", "yes"),
        *("NDT", "–", "–", "P2D", "2.0", "no"),
    ]
    assert "Errors &lt;of&gt; three methods." in html


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ({"a": np.array([1.5, 2.0])}, ("a", "1.5", "2")),
        ([["a", 1, "two words"]], ("a", "1", "two words")),
        (pd.DataFrame({"name": ["a"], "x": [1.5], "y": [None]}), ("a", "1.5", "–")),
    ],
)
def test_rows_are_given_as_is_handiest(rows, expected):
    """Breaks if values are taken in another order than the headings'."""
    assert table(rows, ["name", "x", "y"]).rows == (expected,)


def test_single_quantities_stand_one_below_the_other():
    """Breaks if a unit or format is dropped."""
    shown = quantities(("points", 180), ("motion, x", 0.5, "m", ".2f"), ("share", 0.07, "", ".0%"))
    assert str(shown).splitlines() == [
        "points        180",
        "motion, x  0.50 m",
        "share          7%",
    ]


def test_a_value_is_shown_as_one_would_write_it():
    """Breaks if a large number has an exponent, a whole one is rounded, or a truth is a number."""
    shown = {6080.0: "6080", 12345.6: "12346", 0.00123456: "0.00123", np.float64(2.0): "2"}
    shown |= {float("inf"): "inf", float("nan"): "–"}
    for value, text in shown.items():
        assert significant(value) == text
    assert [cell(np.True_), cell(False), cell(None)] == ["yes", "no", "–"]
