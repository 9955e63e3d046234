"""Links of a built page that lead nowhere."""

import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from urllib.parse import unquote, urlsplit


def dead(links: Iterable[str], address: str, book: Path) -> list[str]:
    """Links within the book without a target, and external ones that are no addresses."""
    home = urlsplit(address)
    found = []
    for link in dict.fromkeys(links):
        target = urlsplit(link)
        if (target.scheme, target.netloc) == (home.scheme, home.netloc):
            place = unquote(target.fragment).split("?")[0]  # a laboratory's state may follow
            problem = missing(book / unquote(target.path).lstrip("/"), place)
        else:
            host = target.hostname or ""
            problem = "" if target.scheme in ("http", "https") and "." in host else "no address"
        if problem:
            found.append(f"{link}: {problem}")
    return found


def missing(path: Path, anchor: str) -> str:
    """Why a link to a file of the book and a place in it leads nowhere, or nothing."""
    if path.is_dir():
        path /= "index.html"
    if not path.is_file():
        return "no such file"
    if anchor and path.suffix == ".html" and anchor not in anchors(path):
        return "no such place on that page"
    return ""


@cache
def anchors(path: Path) -> frozenset[str]:
    """The ids of a page's elements, and the names of its anchors."""
    return frozenset(re.findall(r'(?:\sid=|<a name=)"([^"]+)"', path.read_text(encoding="utf-8")))
