"""A Sphinx extension for figures that a notebook draws twice: narrow, and as wide as the page.

MyST-NB makes a figure of each picture of a cell.  Here the cell's second picture moves into the
figure of the first, and the style sheet shows the one that fits.
"""

from __future__ import annotations

import copy
import json
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

SECOND = "page-form"


def drawn_twice(cell: dict[str, Any]) -> bool:
    """Whether a cell has a caption and two pictures."""
    pictures = [out for out in cell.get("outputs", ()) if "image/png" in out.get("data", {})]
    return "figure" in cell["metadata"].get("mystnb", {}) and len(pictures) == 2


def divide(app: Sphinx, page: str, content: list[str]) -> None:
    """Give the second picture a cell of its own, without name or caption."""
    if not str(app.env.doc2path(page)).endswith(".ipynb"):
        return
    notebook = json.loads(content[0])
    cells = []
    for cell in notebook["cells"]:
        cells.append(cell)
        if drawn_twice(cell):
            second = copy.deepcopy(cell)
            second["outputs"] = [cell["outputs"].pop()]
            second["metadata"]["tags"] = ["remove-input", SECOND]
            second["id"] = f"{cell['id']}-{SECOND}"[-64:]
            del second["metadata"]["mystnb"]["figure"]
            cells.append(second)
    notebook["cells"] = cells
    content[0] = json.dumps(notebook)


def join(app: Sphinx, document: nodes.document) -> None:
    """Put the second picture into the figure before it, and drop its cell."""
    for cell in list(document.findall(nodes.container)):
        if f"tag_{SECOND}" in cell["classes"]:
            drawn = cell.parent[cell.parent.index(cell) - 1]
            drawn.next_node(nodes.figure).insert(1, cell.next_node(nodes.image))
            cell.parent.remove(cell)


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("source-read", divide)
    app.connect("doctree-read", join)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
