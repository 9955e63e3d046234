"""Cards and boxes say what is on record, as text and as HTML."""

from __future__ import annotations

import re
from html import unescape

import pytest

from d2d.study.book.card import LEDGER, SIGNS, anchor, badge, cards
from d2d.study.book.chapter_box import ChapterBox, chapter_box
from d2d.study.book.claim import Claim, Evidence
from d2d.study.book.ledger import claims_table
from d2d.study.book.measured import Measured
from d2d.study.book.record import read_record
from d2d.study.claims import CLAIMS, show

NUMBERS = {"ratio < 2": 1.23456, "steps": 6080.0, "slope": -0.5}
RECORD = {
    "a": Evidence("confirmed", "it is so.", NUMBERS, "Not told."),
    "b": Evidence("refuted", f"it is {'very ' * 40}wrong.", {"steps": 1.0}, "Never."),
}
A, B = (
    Claim("a", "4.4", "A is right.", "outlier-cost", ("ratio < 2",), lambda: RECORD["a"]),
    Claim("b", "6.3", "B is wrong.", "all-scenes", ("steps",), lambda: RECORD["b"]),
)


def read(html: str) -> str:
    """What a reader of the HTML sees."""
    return unescape(re.sub("<[^>]*>", " ", html)).replace("−", "-")


def test_verdicts_differ_by_sign_and_word():
    """Breaks if two verdicts can be told apart by their colour alone."""
    shown = {re.sub("<[^>]*>", "", badge(verdict)) for verdict in SIGNS}
    assert len({text.split()[0] for text in shown}) == len({text.split()[1] for text in shown}) == 3


def test_the_text_of_a_card_is_wrapped_and_complete():
    """Breaks if a reason runs off the page, or nbval no longer sees a number."""
    text = str(cards([A, B], RECORD))
    assert max(map(len, text.splitlines())) <= 88
    assert text.splitlines()[:5] == [
        "[a] A is right. (thesis 4.4)",
        "confirmed: it is so.",
        "  ratio < 2: 1.23 [exact]",
        "  steps: 6080 [exact]",
        "  slope: -0.5 [exact]",
    ]
    assert "holds: Never." in text
    assert "Not told." not in text


def test_the_card_says_what_its_text_says():
    """Breaks if a reader sees other numbers than those that are compared."""
    html = cards([A, B], RECORD)._repr_html_()
    for shown in ("✓ confirmed", "A is right.", "It is so.", "1.23", "6080", "-0.5", "Never."):
        assert shown in read(html)
    first, _ = html.split('aria-label="Claim b"')
    assert "Not told." not in first
    assert first.index("ratio &lt; 2") < first.index("<details>") < first.index("steps")
    assert "<details>" not in html[len(first) :]


def test_a_number_has_its_interval_and_a_card_its_draws():
    """Breaks if a number is told without how well it is known, or that it is exact."""
    numbers = {"ratio < 2": Measured(1.5, 1.4, 1.6), "steps": 6080.0}
    evidence = Evidence("confirmed", "so.", numbers, over="9 draws")
    shown = cards([A], {"a": evidence})
    assert "  ratio < 2: 1.5 [1.4, 1.6]" in str(shown)
    assert "1.4 to 1.6" in read(shown._repr_html_())
    assert re.search(r"steps +exact +6080", read(shown._repr_html_()))
    for told in (str(shown), read(shown._repr_html_())):
        assert "easured over 9 draws" in told


def test_each_card_leads_to_its_row_of_the_ledger():
    """Breaks if the link's target and the ledger's rows are named differently."""
    html = cards([A, B], RECORD)._repr_html_()
    assert re.findall(r'href="([^"]*)"', html) == [f"{LEDGER}#{anchor(id)}" for id in "ab"]
    rows = claims_table([A, B], RECORD)
    assert re.findall(r'<span id="([^"]*)">', rows) == [anchor(id) for id in "ab"]


def test_a_claim_without_evidence_is_refused():
    """Breaks if a chapter could show what has not been measured."""
    with pytest.raises(ValueError, match=r"^record: has no evidence for b"):
        cards([B], {"a": RECORD["a"]})


def test_show_shows_what_is_on_record():
    """Breaks if a chapter shows another claim's evidence."""
    recorded = read_record()["nci-not-enough"]
    assert show(CLAIMS["nci-not-enough"]).shown == ((CLAIMS["nci-not-enough"], recorded),)


def some_box(chapter: str = "04b") -> ChapterBox:
    """The box of a chapter that one of the two claims belongs to."""
    return chapter_box(
        chapter, [A, B], RECORD, asked=["What?", "Why?"], found="This.", minutes=20, needs="Time."
    )


def test_a_box_has_the_verdicts_of_its_chapter():
    """Breaks if a claim is told on another page, or a verdict without claims is shown."""
    assert some_box("04b").verdicts == {"confirmed": ["a"]}
    assert some_box("06").verdicts == {"refuted": ["b"]}
    assert some_box("04").verdicts == {}


def test_a_box_says_the_same_as_text_and_as_markdown():
    """Breaks if something is told to the tests only, or to the reader only."""
    for told in (str(some_box()), read(some_box()._repr_markdown_())):
        for part in ("What?", "Why?", "This.", "1 ", "confirmed", " a", "20 minutes", "Time."):
            assert part in told


def test_the_sentences_of_a_box_stand_apart_from_its_html():
    """Breaks if Markdown within the box would not be parsed: a blank line ends a block of HTML."""
    lines = some_box()._repr_markdown_().splitlines()
    assert lines[:2] == ['<div class="chapter-box">', ""]
    assert lines[-2:] == ["", "</div>"]


def test_a_chapter_takes_time():
    """Breaks if a box could say that it takes none."""
    with pytest.raises(ValueError, match=r"^minutes: expected a positive number, got 0"):
        chapter_box("04b", [], {}, asked="What?", found="This.", minutes=0, needs="Time.")
