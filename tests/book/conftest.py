"""The built book, a server for it, and one browser for all tests of a worker."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from selenium import webdriver

from tests.book import browser

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def book() -> Path:
    """The folder of the built book: that of `make book`, or D2D_BOOK."""
    folder = Path(os.environ.get("D2D_BOOK", ROOT / "_build" / "html"))
    if not (folder / "index.html").is_file():
        pytest.fail(f"no book in {folder}: build it with `make book`")
    return folder


@pytest.fixture(scope="session")
def driver(tmp_path_factory: pytest.TempPathFactory) -> Iterator[webdriver.Chrome]:
    """A browser, or the reason why these tests are skipped."""
    if missing := browser.missing():
        pytest.skip(f"not installed: {', '.join(missing)} (Debian: chromium chromium-driver)")
    with browser.chromium(tmp_path_factory.mktemp("profile")) as chromium:
        yield chromium


@pytest.fixture
def resized(driver: webdriver.Chrome) -> Iterator[webdriver.Chrome]:
    """The browser, whose window and colours are put back afterwards."""
    yield driver
    browser.resize(driver, browser.WIDE)
    browser.prefer(driver, "")


@pytest.fixture(scope="session")
def address(book: Path) -> Iterator[str]:
    with browser.serve(book) as served:
        yield served
