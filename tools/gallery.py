"""A Sphinx extension with a directive ``gallery``: links to all laboratories and figures."""

from __future__ import annotations

import html
import itertools
import re
from pathlib import Path

from docutils import nodes
from laboratories import LABORATORY
from PIL import Image, ImageOps
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

SMALL = (480, 360)  # pixels, the most
_NAME = re.compile(r"(?:\([^)]*\)|[.:;](?! |$)|[^.:;(])*")  # up to a stop, brackets whole
_FRAME = re.compile(r"<svg.*?</svg>|<img .*?>", re.DOTALL)


class gallery(nodes.General, nodes.Element):
    """The gallery's place, filled once all pages are read."""


class Gallery(SphinxDirective):
    """The directive, without arguments."""

    def run(self) -> list[nodes.Node]:
        self.env.note_reread()  # the other pages change it
        return [gallery()]


def laboratories(document: nodes.document, address: str) -> list[nodes.Node]:
    """A link to each laboratory of a page, by the heading above it."""
    links: list[nodes.Node] = []
    for raw in document.findall(nodes.raw):
        if LABORATORY.search(raw.astext()):
            section = raw
            while not isinstance(section, nodes.section):
                section = section.parent
            title = section.next_node(nodes.title).astext().removeprefix("Laboratory: ")
            links.append(entry(f"Laboratory: {title}", f"{address}#{section['ids'][0]}"))
    return links


def figures(document: nodes.document, address: str, images: str) -> list[nodes.Node]:
    """A link to each figure of a page: its picture, and its caption up to the first stop."""
    links: list[nodes.Node] = []
    for figure in document.findall(nodes.figure):
        image, caption = figure.next_node(nodes.image), figure.next_node(nodes.caption)
        if caption is None or not figure["ids"]:
            continue
        picture: list[nodes.Node] = []
        if image is not None:
            name, alt = Path(image["uri"]), html.escape(image["alt"])
            small = f'<img src="{images}/{name.stem}.small.webp" alt="{alt}" loading="lazy">'
            drawn = nodes.image(uri=image["uri"], candidates=image["candidates"], alt=image["alt"])
            picture = [nodes.raw("", small, format="html") if name.suffix == ".png" else drawn]
        elif frame := _FRAME.search(figure.astext()):  # of an animation
            picture = [nodes.raw("", frame[0], format="html")]
        words = itertools.takewhile(lambda part: not isinstance(part, nodes.math), caption)
        title = _NAME.match("".join(part.astext() for part in words))[0]
        links.append(entry(title, f"{address}#{figure['ids'][0]}", *picture))
    return links


def entry(text: str, address: str, *picture: nodes.Node) -> nodes.paragraph:
    """A link with the picture above its text."""
    link = nodes.reference("", "", *picture, nodes.Text(text), internal=True, refuri=address)
    return nodes.paragraph("", "", link, classes=["gallery-figure"] if picture else [])


def fill(app: Sphinx, document: nodes.document, here: str) -> None:
    """Fill the page that has the directive."""
    env, root = app.env, app.config.root_doc
    for place in list(document.findall(gallery)):
        sections: list[nodes.Node] = []
        for page in (root, *env.toctree_includes[root]):
            read, address = env.get_doctree(page), app.builder.get_relative_uri(here, page)
            images = f"{'../' * here.count('/')}{app.builder.imagedir}"
            links = [*laboratories(read, address), *figures(read, address, images)]
            if links:
                title = nodes.title("", env.titles[page].astext())
                pictures = nodes.container("", *links, classes=["gallery"])
                ids = [nodes.make_id(f"of {page}")]
                sections.append(nodes.section("", title, pictures, ids=ids))
        place.replace_self(sections)


def write_small(app: Sphinx, error: Exception | None) -> None:
    """Write the small pictures beside the others."""
    for path in (Path(app.outdir) / app.builder.imagedir).glob("*.png"):
        with Image.open(path) as picture:
            small = ImageOps.contain(picture.convert("RGB"), SMALL)
            small.save(path.with_suffix(".small.webp"), quality=55)


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_node(gallery)
    app.add_directive("gallery", Gallery)
    app.connect("doctree-resolved", fill)
    app.connect("build-finished", write_small, priority=900)  # once there are dark ones
    return {"parallel_read_safe": True}
