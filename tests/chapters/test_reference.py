"""The names that the reference pages give are names in the code, and all of them."""

import inspect
import pkgutil
import re
from pathlib import Path

import d2d
import d2d.radar

ROOT = Path(__file__).resolve().parents[2]
API, NOTATION = (
    (ROOT / page).read_text(encoding="utf-8") for page in ("api/radar.md", "chapters/notation.md")
)
NAMES = sorted(set(re.findall(r"`~?([A-Za-z]\w*(?:\.\w+)+)`", NOTATION)))


def test_the_page_shows_every_public_name():
    """Breaks if the page lacks a name or a class's members, or a name is not in `__all__`."""
    entries = r"auto(?:function:: d2d\.radar\.(\w+)|class:: d2d\.radar\.(\w+)\n   :members:)\n"
    shown = {function or kind for function, kind in re.findall(entries, API)}
    public = {
        name
        for name, value in vars(d2d.radar).items()
        if not name.startswith("_") and not inspect.ismodule(value)
    }
    assert shown == public == set(d2d.radar.__all__)


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
        if path[0] != "d2d":
            path.insert(0, "d2d" if hasattr(d2d, path[0]) else "d2d.radar")
        assert has(pkgutil.resolve_name(".".join(path)), last), name
