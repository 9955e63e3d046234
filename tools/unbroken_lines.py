"""A Sphinx extension that keeps together what a line should not divide.

A number and its unit, the digits of a number, "Fig." and its number; and a formula in the text and
the punctuation or bracket beside it, which browsers would set on a line of its own.  The tables of
Markdown are printed as those that cells make.
"""

from __future__ import annotations

import re
from html import escape
from typing import Any

from docutils import nodes
from sphinx.transforms.post_transforms import SphinxPostTransform

from d2d.study.book.typography import UNIT, typeset, unbroken

CLASS = "unbroken"
BEFORE = re.compile(r"[(\[]+$")
OF_COLUMN = re.compile(rf", (°|{UNIT})$")
AFTER = re.compile(r"^(?:[.,;:!?)\]]|’s?)+")


def print_tables(document: nodes.document) -> None:
    """Set numbers, indices and units in tables as print does: "−6.86", "12 %", "error (m)"."""
    for entry in document.findall(nodes.entry):
        head = isinstance(entry.parent.parent, nodes.thead)
        for text in list(entry.findall(nodes.Text)):
            if isinstance(text.parent, nodes.paragraph | nodes.strong | nodes.emphasis):
                said = OF_COLUMN.sub(r" (\1)", text.astext()) if head else text.astext()
                if (printed := typeset(said)) != escape(text.astext(), quote=False):
                    text.parent.replace(text, nodes.raw("", printed, format="html"))


def keep_units(document: nodes.document) -> None:
    """Put spaces that do not break into the text, but not into code and formulas."""
    literal = (nodes.literal, nodes.literal_block, nodes.math, nodes.math_block, nodes.raw)
    for text in list(document.findall(nodes.Text)):
        node: Any = text.parent
        while node is not None and not isinstance(node, literal):
            node = node.parent
        if node is None and (better := unbroken(text.astext())) != text.astext():
            text.parent.replace(text, nodes.Text(better))


def keep_punctuation(document: nodes.document) -> None:
    """Set each formula of the text in one piece with the brackets and signs that touch it."""
    for formula in list(document.findall(nodes.math)):
        parent = formula.parent
        place = parent.index(formula)
        before, after = _beside(parent, place - 1, BEFORE), _beside(parent, place + 1, AFTER)
        if not before and not after:
            continue
        together = nodes.inline("", "", classes=[CLASS])
        parent.replace(formula, together)
        together += [nodes.Text(before), formula, nodes.Text(after)]
        if after:
            rest = parent[place + 1].astext()[len(after) :]
            parent.replace(parent[place + 1], nodes.Text(rest))
        if before:
            start = parent[place - 1].astext()[: -len(before)]
            parent.replace(parent[place - 1], nodes.Text(start))


def _beside(parent: nodes.Element, place: int, touching: re.Pattern[str]) -> str:
    """What touches a formula in the text at a place among its siblings."""
    if not 0 <= place < len(parent) or not isinstance(parent[place], nodes.Text):
        return ""
    found = touching.search(parent[place].astext())
    return found[0] if found else ""


class UnbrokenLines(SphinxPostTransform):
    """After references have their text."""

    default_priority = 900
    formats = ("html",)

    def run(self, **kwargs: Any) -> None:
        """Keep together what belongs together."""
        print_tables(self.document)
        keep_units(self.document)
        keep_punctuation(self.document)


def setup(app: Any) -> dict[str, bool]:
    app.add_post_transform(UnbrokenLines)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
