"""The reference page of `d2d.radar` shows all of its public names."""

import inspect
import re
from pathlib import Path

import d2d.radar

PAGE = Path(__file__).resolve().parents[2] / "api" / "radar.md"


def test_the_page_shows_every_public_name():
    """Breaks if the page is narrowed to some names, or a name is handed on without `__all__`."""
    text = PAGE.read_text(encoding="utf-8")
    block = re.search(r"automodule:: d2d\.radar\n((?:   :.*\n)+)", text)
    assert block is not None
    options = {line.strip() for line in block[1].splitlines()}
    assert {":members:", ":imported-members:"} <= options  # those of __all__
    public = {
        name
        for name, value in vars(d2d.radar).items()
        if not name.startswith("_") and not inspect.ismodule(value)
    }
    assert public == set(d2d.radar.__all__)
