"""Tables hold the same numbers as text and as HTML."""

import re
from html import unescape

import numpy as np

from d2d.study.book.table import cell, significant, table

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


def test_a_value_is_shown_as_one_would_write_it():
    """Breaks if a large number has an exponent, a whole one is rounded, or a truth is a number."""
    shown = {6080.0: "6080", 12345.6: "12346", 0.00123456: "0.00123", np.float64(2.0): "2"}
    shown |= {float("inf"): "inf", float("nan"): "–"}
    for value, text in shown.items():
        assert significant(value) == text
    assert [cell(np.True_), cell(False), cell(None)] == ["yes", "no", "–"]
