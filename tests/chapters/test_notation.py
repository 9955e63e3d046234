"""The names that the notation page gives to symbols are names in the code."""

import importlib
import re
from pathlib import Path

import pytest

import d2d
import d2d.radar

PAGE = Path(__file__).resolve().parents[2] / "chapters" / "notation.md"
NAMES = sorted(set(re.findall(r"`([A-Za-z]\w*\.\w+(?:\.\w+)?)`", PAGE.read_text(encoding="utf-8"))))


def has(owner: object, name: str) -> bool:
    """Whether a module or class has it, as a field of a dataclass too."""
    return hasattr(owner, name) or name in getattr(owner, "__dataclass_fields__", {})


@pytest.mark.parametrize(
    "name", [name for name in NAMES if not name.startswith(("fixed", "moving"))]
)
def test_a_name_on_the_page_is_in_the_code(name: str) -> None:
    """Breaks if something is renamed and the page still gives its old name."""
    *path, last = name.split(".")
    if path[0] == "d2d":
        try:
            importlib.import_module(name)
        except ModuleNotFoundError:
            assert has(importlib.import_module(".".join(path)), last), name
    else:
        (owner,) = path
        found = getattr(d2d, owner, None) or getattr(d2d.radar, owner)
        assert has(found, last), name


def test_the_page_names_much() -> None:
    """Breaks if the pattern above finds nothing to check."""
    assert len(NAMES) >= 20
