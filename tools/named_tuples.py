"""A Sphinx extension: the fields of a named tuple are described once, by its class.

Python documents each as "Alias for field number 0", and autodoc would list that as well.
"""

from __future__ import annotations

import inspect
from typing import Any

from sphinx.application import Sphinx


def skip_field(
    app: Sphinx, what: str, name: str, member: Any, skip: bool, options: Any
) -> bool | None:
    """Say that a named tuple's field is skipped; None leaves the decision to others."""
    return (
        True
        if type(member).__name__ == "_tuplegetter" and inspect.isdatadescriptor(member)
        else None
    )


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("autodoc-skip-member", skip_field)
    return {"parallel_read_safe": True}
