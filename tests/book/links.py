"""Links of a built page that lead nowhere."""

from collections.abc import Iterable
from functools import cache
from html.parser import HTMLParser
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


class Anchors(HTMLParser):
    """Collects the ids of a page, and the names of its anchors."""

    def __init__(self) -> None:
        super().__init__()
        self.found: set[str] = set()

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        for name, value in attributes:
            if value and (name == "id" or (tag == "a" and name == "name")):
                self.found.add(value)


@cache
def anchors(path: Path) -> frozenset[str]:
    parser = Anchors()
    parser.feed(path.read_text(encoding="utf-8"))
    return frozenset(parser.found)
