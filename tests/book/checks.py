"""The checks of a page: each returns what it found wrong, nothing if all is well."""

from collections.abc import Callable, Iterator
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from tests.book.browser import Visit

MAX_BYTES = 3_000_000
MAX_SHARED_BYTES = 1_800_000
MAX_SCREENS = 16
BLANK = 30
"""Pixels of a picture that differ by less than this in each channel, of 255, show nothing."""

Check = Callable[[Visit, Path], list[str]]


def too_heavy(visit: Visit, book: Path) -> list[str]:
    """More bytes than a phone should have to load."""
    return [f"{visit.bytes / 1e6:.2f} MB"] if visit.bytes > MAX_BYTES else []


def pictures(visit: Visit, book: Path) -> list[str]:
    """Pictures that did not load, show nothing, or say nothing to who cannot see them."""
    return [
        f"{image['source']}: {problem}"
        for image in visit.images
        for problem in (
            "did not load" if image["variation"] < 0 else "",
            "blank" if 0 <= image["variation"] < BLANK else "",
            "" if image["alternative"] else "no alternative text",
        )
        if problem
    ]


def references(visit: Visit, book: Path) -> list[str]:
    """Links within the book that lead nowhere, external ones that are no addresses."""
    home = urlsplit(visit.address)
    found = [f"not a link: {reference}" for reference in visit.unresolved]
    for link in visit.links:
        target = urlsplit(link["resolved"])
        if (target.scheme, target.netloc) == (home.scheme, home.netloc):
            place = unquote(target.fragment).split("?")[0]  # a laboratory's state may follow
            problem = dead(book / unquote(target.path).lstrip("/"), place)
        else:
            problem = malformed(link["resolved"])
        if problem:
            found.append(f"{link['written']} ({link['label']}): {problem}")
    return found


def dead(path: Path, anchor: str) -> str:
    """Why a link to a file of the book and a place in it leads nowhere, or nothing."""
    if path.is_dir():
        path /= "index.html"
    if not path.is_file():
        return "no such file"
    if anchor and path.suffix == ".html" and anchor not in anchors(path):
        return "no such place on that page"
    return ""


def malformed(link: str) -> str:
    """Why an external link is none, or nothing."""
    target = urlsplit(link)
    if target.scheme == "mailto":
        return "" if "@" in target.path else "no address"
    if target.scheme not in ("http", "https"):
        return "neither http, https nor mailto"
    host = target.hostname or ""
    return "" if "." in host and not host.endswith("example.org") else "no host"


class Anchors(HTMLParser):
    """Collects what a link can point at on a page."""

    def __init__(self) -> None:
        super().__init__()
        self.found: set[str] = set()

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        """Take the element's id, or an anchor's name."""
        for name, value in attributes:
            if value and (name == "id" or (tag == "a" and name == "name")):
                self.found.add(value)


@cache
def anchors(path: Path) -> frozenset[str]:
    parser = Anchors()
    parser.feed(path.read_text(encoding="utf-8"))
    return frozenset(parser.found)


def shared(visit: Visit, book: Path) -> list[str]:
    """More bytes of icons, formulas and styles than half of what they once were."""
    size = visit.shared_bytes
    return [f"{size / 1e6:.2f} MB"] if size > MAX_SHARED_BYTES else []


def too_long(visit: Visit, book: Path) -> list[str]:
    """A page of more windows than a reader stays with."""
    return [f"{visit.screens:.1f} screens"] if visit.screens > MAX_SCREENS else []


def private(visit: Visit, book: Path) -> list[str]:
    """The folder in which the book was built, as a path in a signature would show it."""
    home = str(book.resolve().parents[1])
    page = book / unquote(urlsplit(visit.address).path).lstrip("/")
    return [home] if home in page.read_text(encoding="utf-8") else []


# What the browser itself finds, and what is made of what it tells.
FOUND = (
    *("complaints", "formulas", "overflows", "shrunken", "pushed", "crowded", "tiny", "orphans"),
    *("faint", "cut", "pale", "unmarked", "uncited"),
)
CHECKS: dict[str, Check] = {
    **{name: lambda visit, book, name=name: visit.found[name] for name in FOUND},
    **{
        each.__name__: each for each in (too_heavy, pictures, references, shared, too_long, private)
    },
}


def pages(toc: object) -> Iterator[str]:
    """The pages of a table of contents in the order of reading."""
    if isinstance(toc, dict):
        for key in ("root", "file"):
            if key in toc:
                yield toc[key]
        for key in ("parts", "chapters", "sections"):
            yield from pages(toc.get(key, []))
    elif isinstance(toc, list):
        for entry in toc:
            yield from pages(entry)
