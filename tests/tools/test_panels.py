"""Subsections become tabs, and links to them keep their target."""

from docutils import nodes
from docutils.core import publish_doctree

from tools.panels import as_tabs

PAGE = """\
Page
====

Scene
-----

What it is.

Cost
^^^^

A surface.

Errors
^^^^^^

A curve.
"""


def test_each_subsection_is_a_tab_with_its_title_text_and_target():
    """Breaks if a panel is lost, tabs change places, or a link to one leads nowhere."""
    page = publish_doctree(PAGE, settings_overrides={"doctitle_xform": False})
    scene = next(node for node in page.findall(nodes.section) if node["ids"] == ["scene"])
    as_tabs(scene)
    *before, tabs = scene.children
    assert [node.astext() for node in before] == ["Scene", "What it is."]
    assert [[part.astext() for part in tab] for tab in tabs] == [
        ["Cost", "A surface."],
        ["Errors", "A curve."],
    ]
    assert [tab["ids"] for tab in tabs] == [["cost"], ["errors"]]
    assert [tab[0]["sync_id"] for tab in tabs] == ["Cost", "Errors"]
