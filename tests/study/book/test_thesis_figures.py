"""Every figure of the thesis is drawn again: the list of them, and the labels in the chapters."""

from collections import Counter

import pytest

from d2d.study.book.thesis_figures import FIGURES, page_of


def test_the_list_has_every_figure_of_the_thesis_once():
    """Breaks if a row is lost: the thesis counts without gaps, and has one table."""
    assert len({figure.id for figure in FIGURES}) == len(FIGURES)
    numbered = [figure.number for figure in FIGURES if not figure.number.startswith("Table")]
    assert [figure.number for figure in FIGURES if figure.number not in numbered] == ["Table 5.1"]
    counts = Counter(number.split(".")[0] for number in numbered)
    assert counts == {"2": 6, "3": 8, "4": 17, "5": 4, "6": 18, "7": 8}
    assert set(numbered) == {f"{c}.{n}" for c, last in counts.items() for n in range(1, last + 1)}


def test_a_figure_is_filed_under_the_chapter_that_numbers_it():
    """Breaks if number and section are of different chapters."""
    for figure in FIGURES:
        assert figure.number.removeprefix("Table ").split(".")[0] == figure.section.split(".")[0]


def test_page_of_an_unknown_section_is_refused():
    """Breaks if a claim of a chapter without a page gets a link to nowhere."""
    with pytest.raises(ValueError, match=r"^section: no page treats thesis section '9\.1'"):
        page_of("9.1")
