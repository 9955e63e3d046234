"""What the book's own Sphinx extension does to a page."""

import shutil
from pathlib import Path
from types import SimpleNamespace

from docutils import nodes
from docutils.core import publish_doctree

from tools.page_extras import (
    DESCRIPTION,
    GLYPH,
    PRELOADED,
    icons_of,
    link_tests,
    mark_needs,
    named_tests,
    open_with_figure,
    summary,
    without_unused,
)

CHAPTERS = Path(__file__).resolve().parents[2] / "chapters"

ICONS = (
    'var s={"circle-half-stroke":[512,512,[9680,"adjust"],"f042","M448 256c0"],'
    'bars:[448,512,["navicon"],"f0c9","M0 96"],'
    'two:[448,512,[],"f0ca",["M0 96","M1 97"]],'
    "f:function(c){return c.x}}"
)


def test_only_the_icons_that_are_used_are_kept():
    """Breaks if an icon is lost that a page calls by another of its names, or code is cut."""
    kept = without_unused(ICONS, {"adjust"})
    assert kept == (
        'var s={"circle-half-stroke":[512,512,[9680,"adjust"],"f042","M448 256c0"],'
        "f:function(c){return c.x}}"
    )
    assert without_unused(ICONS, {"bars", "two", "circle-half-stroke"}) == ICONS
    assert without_unused('var s={bars:[448,512,[],"f0c9","M0"]}', set()) == "var s={}"


def test_icons_are_found_in_pages_and_scripts():
    """Breaks if an icon that a script puts in is cut."""
    assert icons_of(iter(['<i class="fa-solid fa-bars">', "add('fa-xmark')"])) == {
        "solid",
        "bars",
        "xmark",
    }


def test_glyphs_are_cut_and_other_styles_are_not():
    """Breaks if the size or the turning of icons is lost."""
    styles = (
        '.fa-lg{font-size:1.25em}.fa-bars:before,.fa-navicon:before{content:"\\f0c9"}.fa-spin{a:b}'
    )
    assert GLYPH.sub("", styles) == ".fa-lg{font-size:1.25em}.fa-spin{a:b}"


def test_only_fonts_of_icons_are_no_longer_loaded_ahead():
    font = (
        '<link rel="preload" as="font" href="../_static/vendor/x/webfonts/fa-solid-900.woff2" />\n'
    )
    script = '<link rel="preload" as="script" href="_static/scripts/bootstrap.js" />'
    assert PRELOADED.sub("", font + script) == script


def test_a_description_is_the_first_paragraph_without_formulas():
    """Breaks if TeX is shown, half a word ends it, or a page of pictures cannot be built."""

    def described(text: str) -> str:
        return summary(publish_doctree(f"Title\n=====\n\n{text}\n"))

    sentence = "The motion :math:`\\theta` is what a registration of two scans finds."
    found = described(f"Short.\n\n{sentence}")
    assert found == "The motion is what a registration of two scans finds."
    cut = described("word " * 100)
    assert cut.endswith("word …")
    assert len(cut) <= DESCRIPTION + 2
    assert described(".. image:: x.png") == ""


def test_a_test_that_a_page_names_is_a_link_to_its_source(tmp_path):
    (tmp_path / "chapters").mkdir()
    shutil.copy(CHAPTERS / "errata.md", tmp_path / "chapters")
    builder = SimpleNamespace(
        get_relative_uri=lambda page, to: f"../{to}.html",
        highlighter=SimpleNamespace(highlight_block=lambda code, language: code),
    )
    app = SimpleNamespace(srcdir=str(tmp_path), builder=builder)
    page = publish_doctree("It is ``chapters/test_errata::test_the_nci_has_no_sign``, ``not_one``.")
    link_tests(app, page, "chapters/errata")
    (link,) = page.findall(nodes.reference)
    address, place = link["refuri"].split("#")
    ((name, context, _),) = named_tests(app)
    assert address == f"../{name}.html"
    after = context["body"].split(f'id="{place}"')[1]
    assert after.index("def test_the_nci_has_no_sign") < after.index("<h2")


def test_what_a_page_needs_is_marked_and_no_other_paragraph():
    """Breaks if a question in italics goes to the margin, or what a page needs stays in the way."""
    title = "A page\n======\n\nIt says this.\n\n"
    below = "\n\nMore.\n\nA part\n------\n\nThis.\n\n*But why?*\n"
    marked = {"*Ten minutes.*": ["*Ten minutes.*"], "*Why?* And how.": [], "- *one*": []}
    for second, expected in marked.items():
        document = publish_doctree(title + second + below, settings_overrides={"doctitle_xform": 0})
        mark_needs(SimpleNamespace(), document)
        needs = [p.rawsource for p in document.findall(nodes.paragraph) if "needs" in p["classes"]]
        assert needs == expected


def test_a_figure_that_opens_a_page_stands_before_its_parts():
    """Breaks if the picture stays with the cell that draws it, or another one moves."""
    title = "A page\n======\n\nIt says this.\n\n"
    parts = "One part\n--------\n\n.. container:: cell\n\n   one\n\n"
    parts += parts.replace("One", "Other").replace("---", "-----").replace("one", "other")
    document = publish_doctree(title + parts, settings_overrides={"doctitle_xform": 0})
    *_, cell = document.findall(nodes.container)
    cell["classes"].append("tag_opening")
    open_with_figure(SimpleNamespace(), document)
    shown = [type(part) for part in document.next_node(nodes.section)]
    assert shown == [nodes.title, nodes.paragraph, nodes.container, nodes.section, nodes.section]
    assert document.next_node(nodes.container) is cell
