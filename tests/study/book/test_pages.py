"""Tables, ledger and figures of the book, as text and as HTML."""

import re
from collections import Counter
from html import unescape
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

from d2d.study.book import grammar
from d2d.study.book.claim import Claim, Evidence
from d2d.study.book.ledger import LEDGER, SIGNS, badge, count_verdicts, ledger, page_claims
from d2d.study.book.measured import Measured
from d2d.study.book.table import cell, significant, table
from d2d.study.book.thesis_figures import FIGURES, page_of
from d2d.study.claims import CLAIMS, claims_on
from d2d.study.plane import figures

CHAPTERS = Path(__file__).resolve().parents[3] / "chapters"
RATIO = Measured(1.23456, 1.1, 2.0, True, (-2.0, -1.0, 0.5))
SHARE = Measured(1.0, 0.996, 1.0)
NUMBERS = {"steps": 6080.0, "ratio < 2": RATIO, "slope": -0.5, "share": SHARE}
PARTS = {"the one": "holds if", "the other": "fails"}
RECORD = {
    "a": Evidence({"it is": "holds"}, "it is so.", NUMBERS, "Not said.", "9 draws"),
    "b": Evidence(PARTS, f"it is {'very ' * 40}wrong.", {"ratio": RATIO}, "Never.", "a drive"),
}
TWO = [
    Claim("a", "4.4", "12", "A is right.", "outlier-cost", lambda: RECORD["a"]),
    Claim("b", "6.3", "34, 56", "B is wrong.", "all-scenes", lambda: RECORD["b"]),
]


def read(html: str) -> str:
    """What a reader of the HTML sees."""
    return " ".join(unescape(re.sub("<[^>]*>", " ", html)).replace("−", "-").split())


@pytest.fixture
def rows():
    """The two rows of the ledger, as HTML."""
    return ledger(TWO, RECORD)._repr_html_().split('<details class="ledger-row')[1:]


def test_row_unfolds_to_all_that_is_on_record(rows):
    """Breaks if a reader sees other numbers than those that are compared, not the headlines first,
    or a condition of a claim that is confirmed.
    """
    line, body = rows[0].split("</summary>", 1)
    assert read(line).endswith("✓ confirmed A is right. 1.23 1.10 to 2.00 ratio < 2")
    shown = read(body)
    numbers = (
        "ratio < 2 1.10 to 2.00 1.23 Measured over 9 draws The other 3 numbers steps exact 6080"
    )
    assert f"It is so. {numbers} slope exact -0.5 share 0.996 to 1.000 1.000" in shown
    assert "Not said." not in shown
    assert "≈ the one: holds under a condition ✗ the other: fails Holds: Never." in read(rows[1])
    assert "<details>" not in rows[1]
    assert str(ledger(TWO, RECORD)).splitlines() == [
        "confirmed     a (4.4): ratio < 2 1.23 [1.10, 2.00]",
        "wrong in part b (6.3): ratio 1.23 [1.10, 2.00]",
    ]


def test_page_ends_with_its_claims_by_verdict():
    """Breaks if a page is told another page's claims, or none are told of a claim."""
    told = page_claims("05_outliers_and_clusters_1d", TWO, RECORD)
    assert str(told) == "1 confirmed: a"
    assert read(told._repr_markdown_()).endswith("✓ confirmed A is right.")
    assert f'href="{LEDGER}#claim-a"' in told._repr_markdown_()
    assert page_claims("results", TWO, RECORD).verdicts == {}
    ends = [claims_on(page) for page in {claim.page for claim in CLAIMS.values()}]
    assert sum(len(ids) for end in ends for ids in end.verdicts.values()) == len(CLAIMS)
    for page in {claim.page for claim in CLAIMS.values()}:
        assert f'claims_on(\\"{page}\\")' in (CHAPTERS / f"{page}.ipynb").read_text("utf-8")


def test_verdicts_are_counted():
    """Breaks if a count is typed, or a verdict without claims is left out."""
    counted = "2 claims: 1 confirmed, 0 conditional, 1 wrong in part, 0 refuted"
    assert count_verdicts(RECORD) == counted
    assert len({read(badge(verdict)).split()[0] for verdict in SIGNS}) == 4  # not by colour alone


COLUMNS = ["method", ("v_x", "mm", ".1f"), "share", "converged"]
ROWS = {"ICP & co.": (-14.94, "9%", True), "NDT": (np.nan, None, None), "P2D": (2, "0.15", False)}


def words(html: str) -> list[str]:
    """What a reader of the HTML sees, cell by cell."""
    found = re.findall(r"<(?:th|td)[^>]*>(.*?)</(?:th|td)>", html)
    return [unescape(re.sub("<[^>]*>", "", each)) for each in found]


def test_text_and_html_say_the_same():
    """Breaks if a column loses unit, format or alignment, or the text is not what is read."""
    shown = table(ROWS, COLUMNS, "Errors <of> three methods.")
    assert str(shown).splitlines() == [
        "Errors <of> three methods.",
        "method     v_x (mm)  share  converged",
        "ICP & co.     -14.9     9%        yes",
        "NDT               –      –          –",
        "P2D             2.0   0.15         no",
    ]
    html = shown._repr_html_()
    assert words(html) == [
        *("method", "vx mm", "share", "converged", "ICP & co.", "−14.9", "9\u202f%", "yes"),
        *("NDT", "–", "–", "–", "P2D", "2.0", "0.15", "no"),
    ]
    assert all(part in html for part in ("&lt;of&gt; three methods.", "<i>v<sub>x</sub></i>"))


def test_a_value_is_shown_as_one_would_write_it():
    """Breaks if a large number has an exponent, a whole one is rounded, or a truth is a number."""
    shown = {6080.0: "6080", 12345.6: "12346", 0.00123456: "0.00123", np.float64(2.0): "2"}
    shown |= {float("inf"): "inf", float("nan"): "–"}
    for value, text in shown.items():
        assert significant(value) == text
    assert [cell(np.True_), cell(False), cell(None)] == ["yes", "no", "–"]


ROOT = Path(__file__).resolve().parents[3]


def test_low_cost_is_dark():
    """Breaks if a map is turned round: what a reader takes for a well would be a hill."""
    logs = -np.add.outer(np.linspace(-1, 1, 65) ** 2, np.linspace(-1, 1, 65) ** 2)
    mesh = figures.cost_map(plt.subplots()[1], np.linspace(-1.0, 1.0, 65), 500.0 * logs)
    values = np.asarray(mesh.get_array()).reshape(65, 65)
    at_truth, at_edge = (np.sum(mesh.to_rgba(values)[i, i, :3]) for i in (32, 0))
    assert at_truth < 0.5 * at_edge


MARKS = {"o": "circle", "^": "peak", "s": "square", "D": "diamond"}  # in the laboratories


@pytest.mark.parametrize("key", [*grammar.COSTS, *grammar.SETS])
def test_the_laboratories_have_the_colours_and_marks_of_the_figures(key):
    """Breaks if a cost or a set looks otherwise where one plays with it than in print."""
    look = (grammar.COSTS | grammar.SETS)[key]
    css, kit = ((ROOT / "_static" / "labs" / name).read_text() for name in ("labs.css", "kit.js"))
    assert f"--lab-{key}: {look.color.lower()};" in css
    assert re.search(rf'\n *{key}: {{ name: "[^"]+", mark: "{MARKS[look.marker]}"', kit)


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
