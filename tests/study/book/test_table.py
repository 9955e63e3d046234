"""Tables hold the same numbers as text and as HTML."""

from __future__ import annotations

import re
from html import unescape

import numpy as np
import pytest

from d2d.study.book.table import Table, cell, quantities, significant, table


def words(html: str) -> list[str]:
    """What a reader of the HTML sees, cell by cell, as it would be printed."""
    found = re.findall(r"<(?:th|td)[^>]*>(.*?)</(?:th|td)>", html)
    return [unescape(re.sub("<[^>]*>", "", each)).replace("−", "-") for each in found]


def some_table() -> Table:
    """Two methods with an error each, and what one of them lacks."""
    return table(
        {"ICP & co.": (-14.94, True), "NDT": (np.nan, None)},
        ["method", ("error", "mm", ".1f"), "converged"],
        "Errors <of> two methods.",
    )


def test_the_text_is_aligned_under_its_headings():
    """Breaks if a column loses its unit, its format or its alignment."""
    assert str(some_table()).splitlines() == [
        "Errors <of> two methods.",
        "method     error (mm)  converged",
        "ICP & co.       -14.9        yes",
        "NDT                 –          –",
    ]


def test_the_html_says_the_same():
    """Breaks if what is compared is not what is read, or a sign of HTML is not escaped."""
    html = some_table()._repr_html_()
    header = ["method", "error mm", "converged"]
    assert words(html) == [*header, "ICP & co.", "-14.9", "yes", "NDT", "–", "–"]
    assert "<figcaption>Errors &lt;of&gt; two methods.</figcaption>" in html
    assert html.count('scope="col"') == 3
    assert html.count('scope="row"') == 2


def test_numbers_are_set_flush_right_and_words_are_not():
    """Breaks if a column of words is aligned as numbers are."""
    shown = table([("a", 1, "one"), ("b", 10, "ten")], ["name", "number", "word"])
    assert shown.numeric == (False, True, False)
    assert str(shown).splitlines()[-1] == "b         10  ten"


def test_a_group_stands_over_its_columns():
    """Breaks if a heading over several columns is set over others, or read to others."""
    shown = table({"a": (1, 2, 3)}, ["name", "x", "y", "z"], groups={"one": 2, "other": 1})
    assert str(shown).splitlines() == [
        "      one-  other",
        "name  x  y      z",
        "a     1  2      3",
    ]
    assert '<td colspan="1"></td><th scope="colgroup" colspan="2">one</th>' in shown._repr_html_()


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ({"a": {"x": 1, "y": 2}}, ("a", "1", "2")),
        ({"a": np.array([1.5, 2.0])}, ("a", "1.5", "2")),
        ([["a", 1, 2]], ("a", "1", "2")),
        ({"a": {"y": 2}}, ("a", "–", "2")),
    ],
)
def test_rows_are_given_as_is_handiest(rows: object, expected: tuple[str, ...]):
    """Breaks if a mapping's values are taken in another order than the headings'."""
    assert table(rows, ["name", "x", "y"]).rows == (expected,)


def test_a_mapping_of_single_values_has_two_columns():
    """Breaks if a number is taken for a row."""
    assert table({"a": 1.0, "b": 2.5}, ["name", "x"]).rows == (("a", "1"), ("b", "2.5"))


def test_single_quantities_stand_one_below_the_other():
    """Breaks if a unit or format is dropped."""
    shown = quantities(("points", 180), ("motion, x", 0.5, "m", ".2f"), ("share", 0.07, "", ".0%"))
    assert str(shown).splitlines() == [
        "points        180",
        "motion, x  0.50 m",
        "share          7%",
    ]
    assert "<thead>" not in shown._repr_html_()


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (6080.0, "6080"),
        (12345.6, "12346"),
        (0.00123456, "0.00123"),
        (np.float64(2.0), "2"),
        (float("inf"), "inf"),
        (float("nan"), "–"),
    ],
)
def test_three_digits_are_kept(value: float, shown: str):
    """Breaks if a large number is shown with an exponent, or a whole one is rounded."""
    assert significant(value) == shown


def test_a_truth_value_is_a_word():
    """Breaks if NumPy's truth is shown as 1."""
    assert [cell(np.True_), cell(False)] == ["yes", "no"]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: table([], ["a"]), "^rows: a table needs at least one"),
        (lambda: table([("a", 1)], ["a"]), r"^rows: .* has 2 cells for 1 columns"),
        (lambda: table([("a", 1)], ["a", ("b", "m", ".1f", "?")]), "^columns: expected a heading"),
        (lambda: table([("a", 1)], ["a", "b"], groups={"c": 2}), "^groups: .* leave no column"),
        (lambda: quantities(), "^named: at least one"),
        (lambda: quantities(("a",)), "^named: expected"),
    ],
)
def test_what_is_no_table_is_refused(call, message: str):
    """Breaks if a value slips into another column."""
    with pytest.raises(ValueError, match=message):
        call()
