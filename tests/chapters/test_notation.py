"""The names that the notation page gives to symbols are names in the code."""

import importlib
import re
from pathlib import Path

import d2d
import d2d.radar

PAGE = Path(__file__).resolve().parents[2] / "chapters" / "notation.md"
NAMES = sorted(set(re.findall(r"`([A-Za-z]\w*\.\w+(?:\.\w+)?)`", PAGE.read_text(encoding="utf-8"))))


def has(owner: object, name: str) -> bool:
    """Whether a module or class has it, as a field of a dataclass too."""
    return hasattr(owner, name) or name in getattr(owner, "__dataclass_fields__", {})


def test_names_on_the_page_are_in_the_code() -> None:
    """Breaks if something is renamed and the page still gives its old name."""
    assert len(NAMES) >= 20
    for name in NAMES:
        *path, last = name.split(".")
        if path[0] in ("fixed", "moving"):
            continue
        if path[0] == "d2d":
            try:
                importlib.import_module(name)
            except ModuleNotFoundError:
                assert has(importlib.import_module(".".join(path)), last), name
        else:
            (owner,) = path
            found = getattr(d2d, owner, None) or getattr(d2d.radar, owner)
            assert has(found, last), name
