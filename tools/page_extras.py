"""A Sphinx extension that adds to each page what the theme lacks.

Each page gets a description, and loads only the parts of MathJax and the icons that are used; what
it asks of its readers is marked, and its first picture stands at its top; the tests that a page
names are links to their source; there is a page for addresses that do not exist.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from html import escape
from pathlib import Path
from typing import Any

from docutils import nodes

MATHJAX = "mathjax/startup.js"
# Without the menu, which makes every formula a tab stop, and the parts that speak.
MATHJAX_PARTS = ["core", "input/tex", "output/chtml", "a11y/assistive-mml"]
DESCRIPTION = 160
ICONS = "_static/vendor/fontawesome"
ICON = re.compile(
    r'(?:"([a-z0-9-]+)"|([a-z0-9]+)):\[\d+,\d+,(\[[^\]]*\]),"[0-9a-f]+",(?:"[^"]*"|\[[^\]]*\])\],?'
)
PRELOADED = re.compile(r'<link rel="preload"[^>]*webfonts[^>]*>\s*')
GLYPH = re.compile(r'(?:\.fa-[a-z0-9-]+:{1,2}before,?)+\{content:"[^"]*"\}')
# A server shows this page in whatever folder was asked for: its links start from the book's root.
LOST_BASE = """<script>
const root = location.pathname.replace(/(chapters|api|_images|_static)\\/.*$|[^/]*$/, "");
document.write(`<base href="${root}">`);
</script>"""
TESTS = Path("tests")  # the pages are built in the repository's folder, from a copy without tests
TEST = re.compile(r"((?:\w+/)*test_\w+)::(test_\w+)")
LOST = """<section><h1>This page does not exist</h1>
<p>It may have moved. The <a href="intro.html">first page</a> has the contents, and
<a href="search.html">the search</a> finds words in all pages.</p></section>"""


def summary(document: nodes.document) -> str:
    """The first paragraph without its formulas and references, cut at a word."""
    for paragraph in document.findall(nodes.paragraph):
        copy = paragraph.deepcopy()
        for formula in [*copy.findall(nodes.math), *copy.findall(nodes.citation_reference)]:
            formula.parent.remove(formula)
        text = " ".join(copy.astext().split())
        if len(text) > DESCRIPTION // 4:
            short = text[:DESCRIPTION].rsplit(" ", 1)[0] + " …"
            return text if len(text) <= DESCRIPTION else short
    return ""


def without_unused(script: str, used: set[str]) -> str:
    """The icons' script without the icons of which no name is used."""

    def keep(match: re.Match[str]) -> str:
        names = {match[1] or match[2], *re.findall(r'"([a-z0-9-]+)"', match[3])}
        return match[0] if names & used else ""

    return re.sub(r",\}", "}", ICON.sub(keep, script))


def icons_of(pages: Iterator[str]) -> set[str]:
    """The names of the icons that pages or scripts mention."""
    return {name for page in pages for name in re.findall(r"\bfa-([a-z0-9-]+)", page)}


def choose_formulas(app: Any, config: Any) -> None:
    """Load only the parts of MathJax that typeset."""
    config.mathjax_path = MATHJAX
    config.mathjax3_config = {**(config.mathjax3_config or {}), "loader": {"load": MATHJAX_PARTS}}


def describe(app: Any, page: str, template: str, context: dict[str, Any], document: Any) -> None:
    """Give a page a description for search engines and previews."""
    text = summary(document) if document else ""
    if text:
        tag = f'<meta name="description" content="{escape(text)}" />\n'
        context["metatags"] = tag + context.get("metatags", "")


def load_formulas(
    app: Any, page: str, template: str, context: dict[str, Any], document: Any
) -> None:
    """Leave MathJax out of a page without a formula: the first one would load it for nothing."""
    if document is None or any(
        document.findall(lambda n: isinstance(n, nodes.math | nodes.math_block))
    ):
        return
    context["script_files"] = [
        file
        for file in context["script_files"]
        if not (
            str(file.filename).endswith(MATHJAX)
            or "window.MathJax" in file.attributes.get("body", "")
        )
    ]


def mark_needs(app: Any, document: nodes.document) -> None:
    """Mark the paragraph in italics below the first, which says what a page asks of its readers."""
    for section in document.findall(nodes.section):
        below = section.children[2:3] if section.parent is document else []
        if below and [type(part) for part in below[0].children] == [nodes.emphasis]:
            below[0]["classes"].append("needs")


def open_with_figure(app: Any, document: nodes.document) -> None:
    """Put the figure of a cell tagged ``opening`` before the first part, wherever it is drawn."""
    for cell in list(document.findall(nodes.container)):
        if "tag_opening" in cell["classes"]:
            page = document.next_node(nodes.section)
            first = page.next_node(nodes.section)
            cell.parent.remove(cell)
            page.insert(page.index(first), cell)


def lost_page(app: Any) -> Iterator[tuple[str, dict[str, Any], str]]:
    """The page that a server shows for an address that does not exist."""
    yield "404", {"title": "Not found", "body": LOST, "metatags": LOST_BASE}, "page.html"


def link_tests(app: Any, document: nodes.document, page: str) -> None:
    """Make a test that a page names, ``folder/test_module::test_name``, a link to its source."""
    for literal in list(document.findall(nodes.literal)):
        match = TEST.fullmatch(literal.astext())
        if match:
            address = f"{app.builder.get_relative_uri(page, 'tests')}#{anchor(*match.groups())}"
            literal.replace_self(nodes.reference("", "", literal.deepcopy(), refuri=address))


def anchor(module: str, test: str) -> str:
    """Where a test stands on the page of tests."""
    return f"{module.replace('/', '-')}-{test}"


def named_tests(app: Any) -> Iterator[tuple[str, dict[str, Any], str]]:
    """A page with the source of each test that a page of the book names."""
    chapters = (Path(app.srcdir) / "chapters").glob("*.md")
    pages = "".join(path.read_text(encoding="utf-8") for path in chapters)
    parts = ["<h1>Tests that the book names</h1>"]
    for module, test in sorted({match.groups() for match in TEST.finditer(pages)}):
        source = (TESTS / f"{module}.py").read_text(encoding="utf-8")
        (function,) = (each for each in ast.parse(source).body if getattr(each, "name", "") == test)
        lines = source.splitlines()[function.lineno - 1 : function.end_lineno]
        code = app.builder.highlighter.highlight_block("\n".join(lines), "python")
        parts.append(f'<h2 id="{anchor(module, test)}"><code>tests/{module}.py</code></h2>{code}')
    body = f"<section>{''.join(parts)}</section>"
    yield "tests", {"title": "Tests that the book names", "body": body}, "page.html"


def cut_icons(app: Any, exception: Exception | None) -> None:
    """Cut the icons that no page shows from the icons' script.

    The script draws the icons, so that their glyphs need no style, and no fonts to be loaded ahead.
    """
    folder = Path(app.outdir)
    if exception or app.builder.name != "html":
        return
    sources = [*folder.rglob("*.html"), *(folder / "_static" / "scripts").glob("*.js")]
    used = icons_of(path.read_text(encoding="utf-8") for path in sources)
    for path in folder.rglob("*.html"):
        page = path.read_text(encoding="utf-8")
        path.write_text(PRELOADED.sub("", page), encoding="utf-8")
    for path in (folder / ICONS).rglob("all.min.js"):
        path.write_text(without_unused(path.read_text(encoding="utf-8"), used), encoding="utf-8")
    for path in (folder / ICONS).rglob("all.min.css"):
        path.write_text(GLYPH.sub("", path.read_text(encoding="utf-8")), encoding="utf-8")


def setup(app: Any) -> dict[str, bool]:
    app.connect("config-inited", choose_formulas)
    app.connect("html-page-context", describe)
    app.connect("html-page-context", load_formulas, priority=900)
    app.connect("html-collect-pages", lost_page)
    app.connect("html-collect-pages", named_tests)
    app.connect("doctree-read", mark_needs)
    app.connect("doctree-read", open_with_figure, priority=600)  # with both forms (two_forms.py)
    app.connect("doctree-resolved", link_tests)
    app.connect("build-finished", cut_icons)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
