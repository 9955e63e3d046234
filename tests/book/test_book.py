"""The built book in a real browser without a network.

Breaks if a page logs an error or asks another machine for something, if a formula stays TeX, if a
picture is missing, blank or without alternative text, if a link leads nowhere, if something is
wider than a phone, or if text is hard to tell from its ground. The checks are in checks.py;
test_checks.py shows that each finds what it is for. `make test-book` runs both.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest
import yaml
from selenium import webdriver

from d2d.study.book.thesis_figures import FIGURES
from tests.book import browser
from tests.book.checks import CHECKS, Check, pages

ROOT = Path(__file__).resolve().parents[2]
TOC = Path(os.environ.get("D2D_BOOK_TOC", ROOT / "_toc.yml"))
PAGES = list(pages(yaml.safe_load(TOC.read_text(encoding="utf-8"))))
# One worker's browser visits a page once, for all checks.
EACH_PAGE = pytest.mark.parametrize(
    "page", [pytest.param(page, id=page, marks=pytest.mark.xdist_group(page)) for page in PAGES]
)

Visit = Callable[[str], browser.Visit]


@EACH_PAGE
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_page(page: str, check: Check, visit: Visit, book: Path):
    assert check(visit(page), book) == []


@EACH_PAGE
def test_figures_of_the_thesis_are_shown(page: str, visit: Visit):
    """Breaks if a figure of the thesis is not a picture or a table on its page."""
    expected = {f"fig-{figure.id}" for figure in FIGURES if f"chapters/{figure.page}" == page}
    assert expected <= set(visit(page).figures)


def test_every_page_with_figures_of_the_thesis_is_in_the_book():
    """Breaks if a page leaves the table of contents: its figures would no longer be looked for."""
    assert {f"chapters/{figure.page}" for figure in FIGURES} <= set(PAGES)


@EACH_PAGE
def test_next_leads_to_the_next_page(page: str, visit: Visit, address: str):
    expected = dict(pairwise(PAGES)).get(page)
    assert visit(page).next == (f"{address}{expected}.html" if expected else "")


def test_most_chapters_have_formulas(visit: Visit):
    """Breaks if formulas are no longer found at all: none would be found faulty either."""
    assert visit("chapters/03_point_set_registration").formulas > 10


def test_search_finds_a_word_of_the_book(driver: webdriver.Chrome, address: str):
    driver.get(f"{address}search.html?q=credibility")
    browser.wait(driver, "return document.querySelector('#search-results .search li a') !== null")
    browser.wait(
        driver, "return document.querySelectorAll('#search-results .search li a').length > 2"
    )
    found = driver.execute_script(
        "return [...document.querySelectorAll('#search-results .search li a')].map(a => a.href)"
    )
    assert any("06_credibility_2d.html" in link for link in found)


def test_search_finds_nothing_for_a_word_that_is_nowhere(driver: webdriver.Chrome, address: str):
    """Breaks if the search lists pages whatever is asked."""
    driver.get(f"{address}search.html?q=qwertzuiop")
    browser.wait(driver, "return document.querySelector('.search-summary') !== null")
    summary = "document.querySelector('.search-summary').textContent"
    browser.wait(driver, f"return /did not match|no results/i.test({summary})")
    assert (
        driver.execute_script("return document.querySelector('#search-results .search li a')")
        is None
    )


@pytest.mark.parametrize("theme", browser.THEMES)
def test_the_book_follows_the_system(driver: webdriver.Chrome, address: str, theme: str):
    """Breaks if the book opens light on a dark screen, or the other way round."""
    try:
        browser.prefer(driver, theme)
        driver.get(f"{address}{PAGES[0]}.html")
        browser.wait(driver, f"return document.documentElement.dataset.theme === '{theme}'")
    finally:
        browser.prefer(driver, "")
