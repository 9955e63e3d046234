"""A Sphinx extension for what is left out: code in the search's index, fields said twice."""

from typing import Any

from docutils import nodes
from sphinx.application import Sphinx


def skip_field(app: Sphinx, what: str, name: str, member: Any, *_: Any) -> bool | None:
    """Skip the fields of named tuples, which Python documents as "Alias for field number 0"."""
    return True if type(member).__name__ == "_tuplegetter" else None  # others may decide


def index_prose(app: Any) -> None:
    """Let the builder index each page without the inputs of its cells."""
    index = app.builder.index_page

    def index_page(page: str, document: nodes.document, title: str) -> None:
        prose = document.deepcopy()
        for cell in [c for c in prose.findall(nodes.container) if "cell_input" in c["classes"]]:
            cell.parent.remove(cell)
        index(page, prose, title)

    app.builder.index_page = index_page


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("autodoc-skip-member", skip_field)
    app.connect("builder-inited", index_prose)
    return {"parallel_read_safe": True}
