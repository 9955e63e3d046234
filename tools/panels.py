"""A Sphinx extension that shows the subsections of a section as tabs.

Cells of a notebook cannot stand inside a directive such as ``tab-set``, but they do stand in
sections.  A section whose heading has the class ``panels`` (in MyST Markdown, ``{.panels}`` on the
line above it) has each of its subsections behind a tab with its title.  The tab that a reader
chooses is chosen in all such sections of the page.
"""

from __future__ import annotations

from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.transforms.post_transforms import SphinxPostTransform
from sphinx_design.shared import create_component

CLASS = "panels"


def as_tabs(section: nodes.section) -> None:
    """Move the subsections of a section into a set of tabs at its end.

    Links to a subsection lead to its tab.
    """
    panels = [child for child in section.children if isinstance(child, nodes.section)]
    tabs = create_component("tab-set", classes=["sd-tab-set"])
    for panel in panels:
        title, *content = panel.children
        label = nodes.rubric("", "", *title.children, classes=["sd-tab-label"])
        label["sync_id"], label["sync_group"] = title.astext(), CLASS
        shown = create_component("tab-content", classes=["sd-tab-content"], children=content)
        tab = create_component("tab-item", classes=["sd-tab-item"], children=[label, shown])
        tab["ids"] = panel["ids"]
        tabs += tab
        section.remove(panel)
    section += tabs


class PanelsAsTabs(SphinxPostTransform):
    """Before sphinx_design turns its components into HTML."""

    default_priority = 150
    formats = ("html",)

    def run(self, **kwargs: Any) -> None:
        """Turn each marked section of the page into tabs."""
        for section in list(self.document.findall(nodes.section)):
            if CLASS in section["classes"]:
                as_tabs(section)


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_post_transform(PanelsAsTabs)
    return {"parallel_read_safe": True}
