"""Lines of the pages do not end before a unit or a comma."""

from docutils import nodes
from docutils.utils import new_document

from tools.unbroken_lines import CLASS, keep_punctuation, keep_units


def document(*children: nodes.Node) -> nodes.document:
    page = new_document("page")
    page += nodes.paragraph("", "", *children)
    return page


def test_text_keeps_its_units_and_code_does_not():
    """Breaks if code is changed, which a reader may copy."""
    page = document(nodes.Text("at 20 m: "), nodes.literal("", "20 m"))
    keep_units(page)
    assert page.astext() == "at 20\N{NO-BREAK SPACE}m: 20 m"


def test_a_formula_and_its_comma_are_in_one_piece():
    """Breaks if a line can begin with the comma after a formula."""
    page = document(nodes.Text("the slope ("), nodes.math("", "x"), nodes.Text("), then"))
    keep_punctuation(page)
    (piece,) = [node for node in page.findall(nodes.inline) if CLASS in node["classes"]]
    assert piece.astext() == "(x),"
    assert page.astext() == "the slope (x), then"


def test_a_formula_among_words_is_left_alone():
    """Breaks if every formula is wrapped, or a word is drawn to it."""
    page = document(nodes.Text("with "), nodes.math("", "x"), nodes.Text(" and "), nodes.math())
    keep_punctuation(page)
    assert not list(page.findall(nodes.inline))
