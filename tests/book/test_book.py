"""The built book in a real browser without a network; `make test-book` runs this."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from selenium import webdriver
from selenium.webdriver.common.by import By

from d2d.study.book.ledger import anchor
from d2d.study.book.record import read_record
from d2d.study.book.thesis_figures import FIGURES
from d2d.study.claims import CLAIMS
from tests.book import browser, links

ROOT = Path(__file__).resolve().parents[2]
TOC = Path(os.environ.get("D2D_BOOK_TOC", ROOT / "_toc.yml"))
MAX_BYTES = 3_000_000  # of a page with its pictures, on a phone


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


PAGES = list(pages(yaml.safe_load(TOC.read_text(encoding="utf-8"))))


def faults(driver: webdriver.Chrome, address: str, page: str, book: Path) -> dict[str, object]:
    """What is wrong with a page, by kind."""
    browser.drain(driver)
    browser.resize(driver, browser.WIDE)
    driver.execute_cdp_cmd("Network.clearBrowserCache", {})  # a first visitor's is empty
    driver.get(f"{address}{page}.html")
    driver.execute_script(browser.INSPECT)
    formulas = browser.ask(driver, "inspectBook.formulas()")
    complaints, size = browser.traffic(driver, address)
    found: dict[str, object] = {"formulas": formulas, "complaints": complaints}
    found["bytes"] = [size] if size > MAX_BYTES else []  # without pictures out of view
    found["pictures"] = browser.ask(driver, "await inspectBook.pictures()")
    found["unresolved"] = browser.ask(driver, "inspectBook.unresolved()")
    found["links"] = links.dead(browser.ask(driver, "inspectBook.links()"), address, book)
    browser.ask(driver, "inspectBook.unfold()")
    for width in (browser.WIDE, browser.NARROW):
        browser.resize(driver, width)
        found[f"wider than {width} px"] = browser.ask(driver, "inspectBook.overflows()")
    return {kind: places for kind, places in found.items() if places}


@pytest.mark.parametrize("page", PAGES)
def test_page(page: str, resized: webdriver.Chrome, address: str, book: Path):
    """Breaks if a page logs an error or asks another machine for something, a picture is missing or
    without alternative text, a formula stays TeX, a link leads nowhere, or something is wider than
    a desk or a phone without a box to scroll in.
    """
    assert faults(resized, address, page, book) == {}


def test_every_figure_of_the_thesis_is_on_its_page(book: Path):
    for figure in FIGURES:
        source = (book / "chapters" / f"{figure.page}.html").read_text(encoding="utf-8")
        assert f'id="fig-{figure.id}"' in source


def test_a_search_finds_a_word_of_the_book(driver: webdriver.Chrome, address: str):
    driver.get(f"{address}search.html?q=credibility")
    links = "[...document.querySelectorAll('#search-results .search li a')]"
    browser.wait(driver, f"return {links}.some(a => a.href.includes('09_credibility_2d.html'))")


def test_the_ledger_is_filtered_from_the_keyboard(driver: webdriver.Chrome, address: str):
    """Breaks if a choice shows other claims, or a link leads to a hidden or folded row."""
    driver.get(f"{address}chapters/claims.html")
    browser.wait(driver, "return document.querySelector('.ledger-filter') !== null")
    shown = "[...document.querySelectorAll('.ledger-row')].filter(r => r.checkVisibility())"
    assert driver.execute_script(f"return {shown}.length") == len(CLAIMS)
    verdict = driver.find_element(By.CSS_SELECTOR, ".ledger-filter select")
    verdict.send_keys("wrong in part")
    expected = {id for id, evidence in read_record().items() if evidence.verdict == "wrong in part"}
    chosen = driver.execute_script(f"return {shown}.map(r => r.id)")
    assert set(chosen) == {anchor(id) for id in expected}
    hidden = anchor(next(id for id in CLAIMS if id not in expected))
    driver.execute_script(f"location.hash = '{hidden}'")
    row = f"document.getElementById('{hidden}')"
    browser.wait(driver, f"return {row}.checkVisibility() && {row}.open")


@pytest.mark.parametrize("theme", browser.THEMES)
def test_the_book_follows_the_system(resized: webdriver.Chrome, address: str, theme: str):
    """Breaks if the book opens light on a dark screen, or the other way round."""
    browser.prefer(resized, theme)
    resized.get(f"{address}{PAGES[0]}.html")
    browser.wait(resized, f"return document.documentElement.dataset.theme === '{theme}'")


def test_in_the_dark_figures_are_light_and_maps_stay(resized: webdriver.Chrome, address: str):
    """Breaks if a figure is a white plate on a dark page, or a map shows low values as high."""
    browser.prefer(resized, "dark")
    resized.get(f"{address}chapters/d_panels_and_readings.html")
    browser.wait(resized, "return document.documentElement.dataset.theme === 'dark'")
    filters = "return [...document.querySelectorAll('{}')].map(i => getComputedStyle(i).filter)"
    drawn = resized.execute_script(filters.format("figure:not(#fig-scenes-surfaces) > img"))
    assert len(drawn) > 5
    assert all("invert" in each for each in drawn)
    assert set(resized.execute_script(filters.format("#fig-scenes-surfaces > img"))) == {"none"}
    # The picture on a dark ground is there.
    dark = "getComputedStyle(document.querySelector('#fig-scenes-surfaces > img')).backgroundImage"
    loaded = f"""(async () => {{
        const picture = new Image();
        picture.src = {dark}.slice(5, -2);
        await picture.decode();
        return picture.src;
    }})()"""
    assert browser.ask(resized, f"await {loaded}").endswith(".dark.png")


def test_one_form_of_a_wide_figure_is_shown(resized: webdriver.Chrome, address: str):
    """Breaks if a phone shows the wide form, whose labels nobody can read there, or both."""
    page = f"{address}chapters/09_credibility_2d.html"
    forms = "[...document.querySelectorAll('figure > img.page')].map(i => i.checkVisibility())"
    for width, shown in ((browser.WIDE, [False, True]), (browser.NARROW, [True, False])):
        browser.resize(resized, width)
        resized.get(page)
        visible = resized.execute_script(f"return {forms}")
        assert len(visible) >= 2
        assert visible == shown * (len(visible) // 2)


def test_the_gallery_leads_to_every_figure_of_a_page(book: Path):
    gallery = (book / "chapters" / "gallery.html").read_text(encoding="utf-8")
    for figure in (each for each in FIGURES if not each.number.startswith("Table")):
        assert f'href="{figure.page}.html#fig-{figure.id}"' in gallery
