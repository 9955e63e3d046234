"""A Sphinx extension with a directive ``gallery``: every laboratory and every figure, with a link.

They stand in the order of the book, under the titles of their pages.
"""

from __future__ import annotations

import itertools
import re

from docutils import nodes
from laboratories import LABORATORY
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

Numbers = dict[str, tuple[int, ...]]
_FRAME = re.compile(r"<svg.*?</svg>", re.DOTALL)
_LETTERING = re.compile(r"<text.*?</text>", re.DOTALL)


class gallery(nodes.General, nodes.Element):
    """Where the gallery goes once all pages are read."""


class Gallery(SphinxDirective):
    """The directive, without arguments."""

    def run(self) -> list[nodes.Node]:
        self.env.note_reread()  # the other pages change it
        return [gallery()]


def laboratories(document: nodes.document, address: str) -> list[nodes.Node]:
    """A link to each laboratory of a page, by the heading that it stands under."""
    found: list[nodes.Node] = []
    for raw in document.findall(nodes.raw):
        if not LABORATORY.search(raw.astext()):
            continue
        section = raw
        while not isinstance(section, nodes.section):
            section = section.parent
        title = section.next_node(nodes.title).astext().removeprefix("Laboratory: ")
        where = "at the top" if section.parent is document else title
        link = entry(f"Laboratory: {where}", f"{address}#{section['ids'][0]}")
        found.append(nodes.paragraph("", "", link, classes=["gallery-laboratory"]))
    return found


def figures(document: nodes.document, address: str, numbers: Numbers) -> list[nodes.Node]:
    """Each figure of a page, with its number and what its caption says before the first stop."""
    found: list[nodes.Node] = []
    for figure in document.findall(nodes.figure):
        number = next((numbers[name] for name in figure["ids"] if name in numbers), None)
        image, caption = figure.next_node(nodes.image), figure.next_node(nodes.caption)
        if number is None or caption is None:
            continue
        shown: list[nodes.Node] = [nodes.emphasis("", f"Fig. {number[0]} ")]
        if image is not None:
            small = nodes.image(uri=image["uri"], candidates=image["candidates"], alt=image["alt"])
            small["classes"], small["loading"] = image["classes"], "lazy"
            shown.insert(0, small)
        elif first := _FRAME.search(figure.astext()):  # of an animation
            drawn = _LETTERING.sub("", first[0])  # which nobody could read
            shown.insert(0, nodes.raw("", drawn, format="html"))
        link = entry(beginning(caption), f"{address}#{figure['ids'][0]}", *shown)
        found.append(nodes.paragraph("", "", link, classes=["gallery-figure"]))
    return found


def beginning(caption: nodes.caption) -> str:
    """What a caption says before its first stop or formula."""
    words = itertools.takewhile(lambda part: not isinstance(part, nodes.math), caption.children)
    said = re.sub(r"^\(a\) ", "", "".join(part.astext() for part in words))
    # without (a), (dots), and what a formula cuts off
    said = re.sub(r"\s\([^()]*(?:\)|$)", "", said)
    return re.sub(r"( of| by| over)?[ .,]*$", "", re.split(r"[.:;] ", said)[0])


def entry(text: str, address: str, *before: nodes.Node) -> nodes.reference:
    """A link with what stands before its text."""
    return nodes.reference("", "", *before, nodes.Text(text), internal=True, refuri=address)


def fill(app: Sphinx, document: nodes.document, here: str) -> None:
    """Fill the page that has the directive."""
    env, root = app.env, app.config.root_doc
    for place in list(document.findall(gallery)):
        filled: list[nodes.Node] = []
        for page in (root, *env.toctree_includes[root]):
            read, address = env.get_doctree(page), app.builder.get_relative_uri(here, page)
            numbers = env.toc_fignumbers.get(page, {}).get("figure", {})
            found = [*laboratories(read, address), *figures(read, address, numbers)]
            if found:
                title = "The first page" if page == root else env.titles[page].astext()
                shown = nodes.container("", *found, classes=["gallery"])
                ids = [nodes.make_id(f"of {page}")]
                filled.append(nodes.section("", nodes.title("", title), shown, ids=ids))
        place.replace_self(filled)


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_node(gallery)
    app.add_directive("gallery", Gallery)
    app.connect("doctree-resolved", fill)
    return {"parallel_read_safe": True}
