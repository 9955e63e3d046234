"""A Sphinx extension that describes the fields of a named tuple once, with its class.

Python documents each field as "Alias for field number 0", and autodoc would list that as well.
"""

from __future__ import annotations

from typing import Any

from sphinx.application import Sphinx


def skip_field(app: Sphinx, what: str, name: str, member: Any, *_: Any) -> bool | None:
    """Skip the fields of named tuples; None leaves the decision to other extensions."""
    return True if type(member).__name__ == "_tuplegetter" else None


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("autodoc-skip-member", skip_field)
    return {"parallel_read_safe": True}
