"""A Sphinx extension that links each test that a page names to its source.

The errata name their evidence as ``folder/test_module::test_name``.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from docutils import nodes

PAGE = "tests"
TITLE = "Tests that the book names"
TESTS = Path("tests")  # the pages are built in the repository's folder, from a copy without tests
TEST = re.compile(r"((?:\w+/)*test_\w+)::(test_\w+)")


def anchor(module: str, test: str) -> str:
    """The id of a test on the page of tests."""
    return f"{module.replace('/', '-')}-{test}"


def link(app: Any, document: nodes.document, page: str) -> None:
    """Make each test that a page names a link to its source."""
    for literal in list(document.findall(nodes.literal)):
        if match := TEST.fullmatch(literal.astext()):
            address = f"{app.builder.get_relative_uri(page, PAGE)}#{anchor(*match.groups())}"
            literal.replace_self(nodes.reference("", "test", refuri=address, reftitle=match[0]))


def source_of(module: str, test: str) -> str:
    """The lines of a test function."""
    source = (TESTS / f"{module}.py").read_text(encoding="utf-8")
    (function,) = (node for node in ast.parse(source).body if getattr(node, "name", "") == test)
    return ast.get_source_segment(source, function)


def collect(app: Any) -> Iterator[tuple[str, dict[str, Any], str]]:
    """Yield the page with the source of each test that a page of the book names."""
    chapters = (Path(app.srcdir) / "chapters").glob("*.md")
    pages = "".join(path.read_text(encoding="utf-8") for path in chapters)
    parts = [f"<h1>{TITLE}</h1>"]
    for module, test in sorted({match.groups() for match in TEST.finditer(pages)}):
        code = app.builder.highlighter.highlight_block(source_of(module, test), "python")
        parts.append(f'<h2 id="{anchor(module, test)}"><code>tests/{module}.py</code></h2>{code}')
    yield PAGE, {"title": TITLE, "body": f"<section>{''.join(parts)}</section>"}, "page.html"


def setup(app: Any) -> dict[str, bool]:
    app.connect("doctree-resolved", link)
    app.connect("html-collect-pages", collect)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
