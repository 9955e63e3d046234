"""Lines of the pages do not end before a unit or a comma."""

from docutils import nodes
from docutils.utils import new_document

from tools.unbroken_lines import CLASS, keep_punctuation, keep_units, print_tables


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


def test_tables_are_printed_and_their_code_is_not():
    """Breaks if Markdown's tables write -6.86 and 12% beside others that write −6.86 and 12 %."""
    cells = [
        nodes.Text("v_y, m/s"),
        nodes.Text("-6.86"),
        nodes.Text("12%"),
        nodes.literal("", "-1"),
    ]
    entries = [nodes.entry("", nodes.paragraph("", "", cell)) for cell in cells]
    head = nodes.thead("", nodes.row("", *entries[:2]))
    body = nodes.tbody("", *(nodes.row("", entry) for entry in entries[2:]))
    page = document(nodes.table("", nodes.tgroup("", head, body)), nodes.Text("At -6.86, m"))
    print_tables(page)
    printed = [node.astext() for node in page.findall(nodes.raw)]
    assert printed == ["<i>v</i><sub>y</sub> (m/s)", "−6.86", "12\N{NO-BREAK SPACE}%"]
    assert page.astext().endswith("-1At -6.86, m")
