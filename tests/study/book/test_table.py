"""Tables hold the same numbers as text and as HTML."""

import re
from html import unescape

import numpy as np

from d2d.study.book.table import Table, cell, quantities, significant, table


def words(html: str) -> list[str]:
    """What a reader of the HTML sees, cell by cell, as it would be printed."""
    found = re.findall(r"<(?:th|td)[^>]*>(.*?)</(?:th|td)>", html)
    return [unescape(re.sub("<[^>]*>", "", each)).replace("−", "-") for each in found]


def some_table() -> Table:
    """Three methods with an error each, and what one of them lacks."""
    return table(
        {"ICP & co.": (-14.94, True), "NDT": (np.nan, None), "P2D": (2.0, False)},
        ["method", ("error", "mm", ".1f"), "converged"],
        "Errors <of> three methods.",
    )


def test_the_text_is_aligned_under_its_headings():
    """Breaks if a column loses its unit, its format or its alignment."""
    assert str(some_table()).splitlines() == [
        "Errors <of> three methods.",
        "method     error (mm)  converged",
        "ICP & co.       -14.9        yes",
        "NDT                 –          –",
        "P2D               2.0         no",
    ]


def test_the_html_says_the_same():
    """Breaks if what is compared is not what is read, or a sign of HTML is not escaped."""
    html = some_table()._repr_html_()
    header = ["method", "error mm", "converged"]
    assert words(html) == [
        *header,
        "ICP & co.",
        "-14.9",
        "yes",
        "NDT",
        "–",
        "–",
        "P2D",
        "2.0",
        "no",
    ]
    assert "<figcaption>Errors &lt;of&gt; three methods.</figcaption>" in html
    assert html.count('scope="col"') == 3
    assert html.count('scope="row"') == 3


def test_numbers_are_set_flush_right_and_words_are_not():
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
    html = shown._repr_html_()
    assert '<tr><td colspan="1"></td><th scope="colgroup" colspan="2">one</th>' in html
    assert "<tr><tr>" not in html


def test_rows_are_given_as_is_handiest():
    """Breaks if a mapping's values are taken in another order than the headings'."""
    for rows, expected in (
        ({"a": {"x": 1, "y": 2}}, ("a", "1", "2")),
        ({"a": np.array([1.5, 2.0])}, ("a", "1.5", "2")),
        ([["a", 1, 2]], ("a", "1", "2")),
        ({"a": {"y": 2}}, ("a", "–", "2")),
    ):
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


def test_a_single_row_is_a_line_and_more_is_a_table():
    """Breaks if a row alone gets the rules and heads of a table, or many numbers a line."""
    columns = ["", ("v_x", "m/s"), ("v_y", "m/s"), ("usable", "", ".0%"), "ANEES"]
    alone, two = (table([("car", 1, 2, 0.9, 1)] * rows, columns) for rows in (1, 2))
    assert alone._repr_html_().startswith('<p class="measured">')
    assert two._repr_html_().startswith('<figure class="measured">')


def test_a_few_numbers_stand_in_a_line():
    """Breaks if two numbers get the rules and heads of a table, or lose their heads and units."""
    line = '<p class="measured">'
    one = quantities(("error", -0.96, "m", ".2f"), caption="On the road.")
    assert one._repr_html_() == f"{line}On the road. Error: <b>-0.96 m</b></p>"
    two = table({"NDT": 1.0, "ICP": 2.0}, ["", ("RMSE", "m")])
    shown = f"{line}NDT: <b>RMSE 1 m</b>; ICP: "
    assert two._repr_html_().startswith(shown)


def test_a_value_is_shown_as_one_would_write_it():
    """Breaks if a large number has an exponent, a whole one is rounded, or a truth is a number."""
    shown = {6080.0: "6080", 12345.6: "12346", 0.00123456: "0.00123", np.float64(2.0): "2"}
    shown |= {float("inf"): "inf", float("nan"): "–"}
    for value, text in shown.items():
        assert significant(value) == text
    assert [cell(np.True_), cell(False), cell(None)] == ["yes", "no", "–"]
