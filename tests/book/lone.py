"""A laboratory on a page of its own, opened from a folder as the pages of a downloaded book are."""

import shutil
from pathlib import Path
from typing import Any

from selenium import webdriver

from tests.book import browser
from tests.book.test_labs import Hand, Laboratory
from tools import laboratories

LABS = Path(__file__).resolve().parents[2] / "_static" / "labs"
# As wide as the text of the book, below a title of two lines.
PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>A page</title>
<link rel="icon" href="data:,">{head}
<style>body {{ font: 16px/1.65 sans-serif; margin: 0 auto; max-width: 800px; padding: 0 16px;
background: var(--ground); color: var(--pst-color-text-base) }}
html {{ --ground: #fff }}
html[data-theme=dark] {{ --ground: #121212; --pst-color-background: #121212;
--pst-color-text-base: #ced6dd; --pst-color-surface: #29313d; color-scheme: dark }}
h1 {{ font-size: 40px; line-height: 1.15; margin: 64px 0 16px }}</style>
<article><h1>A title that is so long that<br>it takes two lines</h1>
<p>One sentence on what to do.</p>
<div class="lab" data-lab="{name}" id="lab-{name}">It needs JavaScript.</div></article></html>"""


class Loaded:
    """Stands for Sphinx, and writes down what a page loads."""

    def __init__(self) -> None:
        self.head: list[str] = []

    def add_css_file(self, name: str) -> None:
        self.head.append(f'<link rel="stylesheet" href="{name}">')

    def add_js_file(self, name: str, **how: Any) -> None:
        self.head.append(f'<script src="{name}" {how["loading_method"]}></script>')


def page_of(folder: Path, name: str) -> str:
    """Write a page with one laboratory; its address."""
    shutil.copytree(LABS, folder / "labs")
    app: Any = Loaded()
    body = PAGE.format(name=name, head="")
    laboratories.load(app, name, "", {"body": body}, None)
    page = folder / f"{name}.html"
    page.write_text(PAGE.format(name=name, head="\n".join(app.head)), encoding="utf-8")
    return page.as_uri()


def hand_on(driver: webdriver.Chrome, name: str) -> Hand:
    """A hand on the laboratory, which `Hand.open` shows."""
    return Hand(driver, Laboratory(name, f"lab-{name}", "", "", ""))


def assert_usable(hand: Hand, address: str, width: int, theme: str) -> None:
    """Everything fits, can be read, has a name, shows that it has the focus, and is spoken."""
    hand.open(address, width)
    hand.driver.execute_script("document.documentElement.dataset.theme = arguments[0]", theme)
    hand.driver.execute_script(browser.INSPECT)
    contrast, smallest = browser.CONTRAST, browser.SMALLEST
    for look in ("overflows()", f"faint({contrast})", f"tiny({smallest})", "unmarked()"):
        assert browser.ask(hand.driver, f"inspectBook.{look}") == [], look
    controls = """[...lab.element.querySelectorAll('input, button, textarea')]"""
    nameless = f"{controls}.filter((each) => !each.labels?.length && !each.textContent.trim())"
    assert hand.ask(f"{nameless}.length") == 0
    large = "not([type=radio])"  # whose labels are large
    heights = f"{controls}.filter((each) => each.matches(':{large}'))"
    assert min(hand.ask(f"{heights}.map((each) => each.getBoundingClientRect().height)")) >= 24.0
    spoken = f"document.querySelector('#{hand.lab.id} [aria-live=polite]').textContent"
    browser.wait(hand.driver, f"return {spoken}.length > 20")
    complaints, *_ = browser.traffic(hand.driver, address)
    assert complaints == []
