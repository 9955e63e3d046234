"""The built book in a real browser without a network.

Breaks if a page logs an error or asks another machine for something, if a formula stays TeX, if a
picture is missing, blank or without alternative text, if a link leads nowhere, if something is
wider than a phone, or if text is hard to tell from its ground. The checks are in checks.py;
test_checks.py shows that each finds what it is for. `make test-book` runs both.
"""

import os
import re
import shutil
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import pytest
import yaml
from selenium import webdriver
from selenium.webdriver.common.by import By

from d2d.study.book.ledger import anchor
from d2d.study.book.record import read_record
from d2d.study.book.thesis_figures import FIGURES
from d2d.study.claims import CLAIMS
from tests.book import browser
from tests.book.checks import CHECKS, pages

ROOT = Path(__file__).resolve().parents[2]
TOC = Path(os.environ.get("D2D_BOOK_TOC", ROOT / "_toc.yml"))
PAGES = list(pages(yaml.safe_load(TOC.read_text(encoding="utf-8"))))
# One worker's browser visits a page once, for all checks.
EACH_PAGE = pytest.mark.parametrize(
    "page", [pytest.param(page, id=page, marks=pytest.mark.xdist_group(page)) for page in PAGES]
)

# Pages that are looked things up in, not read from the first line to the last.
LOOKED_UP = {
    "chapters/claims",
    "chapters/errata",
    "chapters/gallery",
    "chapters/notation",
    "chapters/benchmarks",
    "chapters/references",
    *(page for page in PAGES if page.startswith("api/")),
}

OPENING = 4  # lines of the first paragraph, on a desk

Visit = Callable[[str], browser.Visit]


@EACH_PAGE
@pytest.mark.parametrize("check", CHECKS)
def test_page(page: str, check: str, visit: Visit, book: Path):
    if check == "too_long" and page in LOOKED_UP:
        pytest.skip("looked things up in, not read from the first line to the last")
    assert CHECKS[check](visit(page), book) == []


def test_the_list_names_pages_of_the_book():
    """Breaks if a page is renamed or divided and its old name stays on the list."""
    assert set(PAGES) >= LOOKED_UP


@EACH_PAGE
def test_figures_of_the_thesis_are_shown(page: str, visit: Visit):
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
    assert visit("chapters/07_point_set_registration").formulas > 10


RESULTS = "[...document.querySelectorAll('#search-results .search li {}')]"


def test_search_finds_a_word_of_the_book(driver: webdriver.Chrome, address: str):
    """Breaks if a page is not found, or excerpts show imports or TeX."""
    links, excerpts = RESULTS.format("a"), RESULTS.format("p.context")
    driver.get(f"{address}search.html?q=credibility")
    # The list grows while one reads it.
    browser.wait(driver, f"return {links}.some(a => a.href.includes('10_credibility_2d.html'))")
    driver.get(f"{address}search.html?q=likelihood")
    browser.wait(driver, f"return {excerpts}.length > 5")
    shown = driver.execute_script(f"return {excerpts}.map(p => p.textContent)")
    assert [text for text in shown if "import " in text or "\\" in text] == []


def test_search_finds_nothing_for_a_word_that_is_nowhere(driver: webdriver.Chrome, address: str):
    """Breaks if the search lists pages whatever is asked."""
    driver.get(f"{address}search.html?q=qwertzuiop")
    browser.wait(driver, "return document.querySelector('.search-summary') !== null")
    summary = "document.querySelector('.search-summary').textContent"
    browser.wait(driver, f"return /did not match|no results/i.test({summary})")
    assert driver.execute_script(f"return {RESULTS.format('a')}.length") == 0


def test_the_ledger_is_filtered_from_the_keyboard(driver: webdriver.Chrome, address: str):
    """Breaks if a choice shows other claims, or the link of a card leads to a hidden row."""
    driver.get(f"{address}chapters/claims.html")
    browser.wait(driver, "return document.querySelector('.ledger-filter') !== null")
    rows = "return [...document.querySelectorAll('.ledger-row')]"
    everything = driver.execute_script(f"{rows}.length")
    assert everything == len(CLAIMS)
    verdict = driver.find_element(By.CSS_SELECTOR, ".ledger-filter select[name=verdict]")
    verdict.send_keys("wrong in part")
    expected = {id for id, evidence in read_record().items() if evidence.verdict == "wrong in part"}
    shown = driver.execute_script(f"{rows}.filter(r => r.checkVisibility()).map(r => r.id)")
    assert set(shown) == {anchor(id) for id in expected}
    chosen = driver.execute_script("return location.hash")
    assert chosen == "#ledger?verdict=wrong+in+part"
    driver.get("about:blank")
    driver.get(f"{address}chapters/claims.html{chosen}")
    browser.wait(driver, f"return {rows[7:]}.filter(r => !r.hidden).length === {len(expected)}")
    hidden = anchor(next(id for id in CLAIMS if id not in expected))
    driver.execute_script(f"location.hash = '{hidden}'")
    browser.wait(driver, f"return document.getElementById('{hidden}').checkVisibility()")


def test_search_puts_the_page_first_whose_title_has_the_words(
    driver: webdriver.Chrome, address: str
):
    """Breaks if pages that mention a word often come before the page about it."""
    driver.get(f"{address}search.html?q=covariance+too+small")
    links = RESULTS.format("a")
    browser.wait(driver, f"return {links}.length > 5")
    first = driver.execute_script(f"return {links}[0].href")
    assert "why_is_my_covariance_too_small.html" in first


def test_folded_code_takes_no_line_and_one_button_shows_all(driver: webdriver.Chrome, address: str):
    """Breaks if folded code pushes a figure down, or the imports cannot be seen at all."""
    driver.get(f"{address}chapters/04_outliers_and_clusters_1d.html")
    browser.wait(driver, "return document.querySelector('.code-switch') !== null")
    folds = "[...document.querySelectorAll('div.cell.tag_hide-input details.hide')]"
    heights = driver.execute_script(f"return {folds}.map(d => d.getBoundingClientRect().height)")
    assert len(heights) > 10
    assert max(heights) < 1.0
    signs = f"{folds}.map(d => d.querySelector('summary')).filter(s => s.checkVisibility())"
    sizes = driver.execute_script(f"return {signs}.map(s => s.getBoundingClientRect().width)")
    assert len(sizes) > 8
    assert min(sizes) > 12.0
    shown = f"{folds}.every(d => d.querySelector('pre').checkVisibility())"
    assert driver.execute_script(f"return {shown}") is False
    button = driver.find_element(By.CSS_SELECTOR, ".code-switch")
    button.click()
    assert driver.execute_script(f"return {shown}") is True
    button.click()
    assert driver.execute_script(f"return {folds}.some(d => d.open)") is False


def test_the_sidebar_opens_on_the_part_of_the_page(resized: webdriver.Chrome, address: str):
    browser.resize(resized, browser.WIDE)
    shown = """
        const sidebar = document.querySelector(".bd-sidebar-primary");
        const frame = sidebar.getBoundingClientRect();
        const entry = sidebar.querySelector("li.current.active > a").getBoundingClientRect();
        const open = [...sidebar.querySelectorAll("details[open]")];
        return open.length === 1 && open[0].contains(sidebar.querySelector("li.current"))
          && entry.top >= frame.top && entry.bottom <= frame.bottom;
    """
    for page in (PAGES[1], PAGES[-1], PAGES[2]):
        resized.get(f"{address}{page}.html")
        browser.wait(resized, shown)
    # The longest part, and a sidebar that was not scrolled on the page before.
    resized.execute_script("sessionStorage.setItem('sidebar-scroll-top', '0')")
    resized.get(f"{address}chapters/references.html")
    browser.wait(resized, shown)


def test_the_sidebar_marks_pages_with_a_laboratory(
    driver: webdriver.Chrome, address: str, book: Path
):
    driver.get(f"{address}intro.html")
    links = "[...document.querySelectorAll('.bd-sidebar-primary li > a')]"
    marked = f"{links}.filter(a => a.querySelector('.has-laboratory')).map(a => a.pathname)"
    found = {Path(path).stem for path in driver.execute_script(f"return {marked}")}
    expected = {
        Path(page).stem
        for page in PAGES
        if 'class="lab" data-lab' in (book / f"{page}.html").read_text(encoding="utf-8")
    }
    assert found == expected
    assert len(expected) > 5


def test_the_gallery_leads_to_every_figure(book: Path):
    """Breaks if a picture is missing from the page of all figures, or a link leads nowhere."""
    gallery = (book / "chapters" / "gallery.html").read_text(encoding="utf-8")
    linked = re.findall(r'<a class="reference internal" href="([^"#]*)#([^"]+)"><img', gallery)
    shown = [
        (f"{page}.html", name)
        for page in PAGES
        for name in re.findall(
            r'<figure [^>]*id="([^"]+)"[^>]*>\s*(?:<a[^>]*>)?<img',
            (book / f"{page}.html").read_text(encoding="utf-8"),
        )
    ]
    assert [(os.path.normpath(f"chapters/{page}"), name) for page, name in linked] == shown
    assert not re.search(r"<a [^>]*><em>Fig", gallery)  # without a picture


def test_a_page_without_a_formula_loads_no_mathjax(book: Path):
    """Breaks if the first page loads 760 kB for nothing."""
    assert "mathjax/" not in (book / "intro.html").read_text(encoding="utf-8")


def test_what_is_folded_is_opened_on_paper(driver: webdriver.Chrome, address: str):
    """Breaks if a printed page hides answers, or shows the bars of folded code."""
    driver.get(f"{address}chapters/07_point_set_registration.html")
    opened = "[...document.querySelectorAll('article details:not(.hide)')].every(d => d.open)"
    assert driver.execute_script(f"return {opened}") is False
    driver.execute_script("window.dispatchEvent(new Event('beforeprint'))")
    assert driver.execute_script(f"return {opened}") is True
    driver.execute_script("window.dispatchEvent(new Event('afterprint'))")
    assert driver.execute_script(f"return {opened}") is False
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    folded = "[...document.querySelectorAll('details.hide')].some(d => d.checkVisibility())"
    try:
        assert driver.execute_script(f"return {folded}") is False
    finally:
        driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})


@EACH_PAGE
def test_a_page_says_what_it_is_about(page: str, book: Path):
    """Breaks if a search engine has to guess, or is shown TeX."""
    source = (book / f"{page}.html").read_text(encoding="utf-8")
    found = re.findall(r'<meta name="description" content="([^"]*)"', source)
    assert len(found) == 1
    assert len(found[0]) > 40
    assert "\\" not in found[0]


@pytest.mark.parametrize("missing", ["nowhere.html", "chapters/nowhere.html"])
def test_somebody_lost_finds_the_book(
    driver: webdriver.Chrome, book: Path, tmp_path: Path, missing: str
):
    """Breaks if the page for addresses that do not exist has dead links in a folder."""
    shutil.copytree(book / "_static", tmp_path / "_static")
    (tmp_path / missing).parent.mkdir(exist_ok=True)
    shutil.copy(book / "404.html", tmp_path / missing)
    with browser.serve(tmp_path) as served:
        driver.get(f"{served}{missing}")
        link = driver.find_element(By.CSS_SELECTOR, "article a[href$='intro.html']")
        assert link.get_attribute("href") == f"{served}intro.html"
        assert driver.execute_script("return document.styleSheets.length") > 5


@pytest.fixture
def resized(driver: webdriver.Chrome) -> Iterator[webdriver.Chrome]:
    """The browser, whose window and colours are put back afterwards."""
    yield driver
    browser.resize(driver, browser.WIDE)
    browser.prefer(driver, "")


@pytest.mark.parametrize("page", ["07_point_set_registration", "12_radar_ego_motion"])
def test_a_note_follows_what_it_is_about_on_a_phone(
    resized: webdriver.Chrome, address: str, page: str
):
    """Breaks if a note divides a sentence from its formula, or leaves its place in the margin."""
    order = (
        "return [...document.querySelectorAll('aside.margin.sidebar')]"
        ".map(note => [note.textContent, note.%s?.textContent.slice(0, 80)])"
    )
    before_formula = "return document.querySelectorAll('aside.margin.sidebar + div.math').length"
    browser.resize(resized, browser.WIDE)
    resized.get(f"{address}chapters/{page}.html")
    wide = resized.execute_script(order % "nextElementSibling")
    assert resized.execute_script(before_formula) > 2
    browser.resize(resized, browser.NARROW)
    browser.wait(resized, f"{before_formula} === 0")
    narrow = resized.execute_script(order % "previousElementSibling")
    assert [note for note, _ in narrow] == [note for note, _ in wide]
    browser.resize(resized, browser.WIDE)
    browser.wait(resized, f"{before_formula} > 2")
    assert resized.execute_script(order % "nextElementSibling") == wide


# The characters of names in tables after which a line ends.
LINE_ENDS = """
    const ends = [];
    for (const name of document.querySelectorAll("article td code .pre")) {
        const texts = document.createTreeWalker(name, NodeFilter.SHOW_TEXT);
        let last;
        while (texts.nextNode()) {
            const text = texts.currentNode;
            for (let i = 0; i < text.length; i++) {
                const range = document.createRange();
                range.setStart(text, i);
                range.setEnd(text, i + 1);
                const { top, bottom } = range.getBoundingClientRect();
                if (last && top >= last.bottom - 1) ends.push(last.character);
                last = { bottom, character: text.data[i] };
            }
        }
    }
    return ends;
"""


def test_a_name_in_a_table_breaks_between_its_words(resized: webdriver.Chrome, address: str):
    """Breaks if the name of a test, or of a claim, is cut within a word on a phone."""
    browser.resize(resized, browser.NARROW)
    resized.get(f"{address}chapters/errata.html")
    ends = resized.execute_script(LINE_ENDS)
    assert ends.count("_") > 10
    assert set(ends) <= {"_", "/", ":", "-"}  # a claim has hyphens


@pytest.mark.parametrize("theme", browser.THEMES)
def test_the_book_follows_the_system(resized: webdriver.Chrome, address: str, theme: str):
    """Breaks if the book opens light on a dark screen, or the other way round."""
    browser.prefer(resized, theme)
    resized.get(f"{address}{PAGES[0]}.html")
    browser.wait(resized, f"return document.documentElement.dataset.theme === '{theme}'")


def test_in_the_dark_figures_are_light_and_maps_stay(resized: webdriver.Chrome, address: str):
    """Breaks if a figure is a white plate on a dark page, or a map shows low values as high."""
    browser.prefer(resized, "dark")
    resized.get(f"{address}chapters/04_outliers_and_clusters_1d.html")
    browser.wait(resized, "return document.documentElement.dataset.theme === 'dark'")
    looks = """
        const style = (picture) => getComputedStyle(picture);
        const map = "#fig-corrupted-map";
        return [`figure:not(${map}) > img`, `${map} > img`].map((pictures) =>
            [...document.querySelectorAll(pictures)].map((each) =>
                [style(each).filter, style(each).backgroundImage, style(each).mixBlendMode]));
    """
    drawn, maps = resized.execute_script(looks)
    assert len(drawn) > 5
    assert all("invert" in filtered and behind == "none" for filtered, behind, _ in drawn)
    assert [filtered for filtered, *_ in maps] == ["none"]
    assert {blend for *_, blend in drawn + maps} == {"screen"}
    # The picture with the dark ground is there, and as large as the one on white.
    assert maps[0][1].endswith('.dark.png")')
    sizes = f"""(async () => {{
        const shown = [new Image(), document.querySelector("#fig-corrupted-map > img")];
        shown[0].src = {maps[0][1][4:-1]};
        await shown[0].decode();
        return shown.map((each) => [each.naturalWidth, each.naturalHeight]);
    }})()"""
    dark, light = browser.ask(resized, f"await {sizes}")
    assert dark == light


def test_the_first_screen_of_a_page_shows_a_picture(resized: webdriver.Chrome, address: str):
    """Breaks if a page that is read opens with text alone, on a desk or on a phone."""
    tops = """
        const pictures = document.querySelectorAll("article :is(figure > img, .lab, .ledger-map)");
        return [...pictures].map((each) => each.getBoundingClientRect()).filter((box) => box.height)
            .map((box) => Math.round(box.top + scrollY));
    """
    late = []
    for page in (
        page for page in PAGES if re.match(r"intro|chapters/(\d\d|[abcdfgh]_|w|your|claims)", page)
    ):
        resized.get(f"{address}{page}.html")
        for width in (browser.WIDE, browser.NARROW):
            browser.resize(resized, width)
            first = min(resized.execute_script(tops), default=None)
            if first is None or first > 800:  # of 850 on a phone
                late.append(f"{page}, {width} px: {first}")
    assert late == []


def test_what_a_page_needs_stands_beside_what_it_says(resized: webdriver.Chrome, address: str):
    """Breaks if the note pushes the first picture down, or lies on the text or a caption."""
    boxes = """
        const note = document.querySelector("article p.needs");
        return [note.previousElementSibling, note].map((each) => each.getBoundingClientRect());
    """
    browser.resize(resized, browser.WIDE)
    for page in ("01_motivation", "10_credibility_2d", "your_own_radar"):
        resized.get(f"{address}chapters/{page}.html")
        said, note = resized.execute_script(boxes)
        assert note["top"] == said["top"]
        assert note["bottom"] < said["bottom"]
        assert note["left"] > said["right"]


def test_a_page_opens_with_a_few_lines(resized: webdriver.Chrome, address: str):
    """Breaks if what a page asks and found takes more lines than a reader skims."""
    lines = """
        const first = document.querySelector("article h1 ~ p");
        return Math.round(first.offsetHeight / parseFloat(getComputedStyle(first).lineHeight));
    """
    browser.resize(resized, browser.WIDE)
    long = {}
    for page in (page for page in PAGES if not page.startswith("api/")):
        resized.get(f"{address}{page}.html")
        counted = resized.execute_script(lines)
        if counted > OPENING:
            long[page] = counted
    assert long == {}


def test_formulas_on_a_phone_are_as_large_as_the_text(resized: webdriver.Chrome, address: str):
    """Breaks if a formula on a line of its own is smaller than it need be, or is cut."""
    browser.resize(resized, browser.NARROW)
    resized.get(f"{address}chapters/02_gaussian_background.html")
    fitted = "document.querySelectorAll('div.math > mjx-container.fitted')"
    browser.wait(resized, f"return {fitted}.length > 10")
    measure = f"""
        const size = (each) => parseFloat(getComputedStyle(each).fontSize);
        const inline = size(document.querySelector("p mjx-container:not([display])"));
        return [...{fitted}].map((each) =>
            [size(each) / inline, each.scrollWidth / each.clientWidth,
             each.querySelector("mjx-math").getBoundingClientRect().width / each.clientWidth]);
    """
    sizes = resized.execute_script(measure)
    assert sum(size > 0.999 for size, *_ in sizes) > 10
    assert all(size > 0.75 and over <= 1.0 for size, over, _ in sizes)
    browser.resize(resized, browser.WIDE)
    browser.wait(resized, f"return {fitted}.length === 0")


def test_no_interval_of_the_ledger_is_cut(resized: webdriver.Chrome, address: str):
    """Breaks if the longest interval ends beyond the column, at the window's edge."""
    for width in (browser.WIDE, browser.NARROW):
        browser.resize(resized, width)
        resized.get(f"{address}chapters/claims.html")
        ends = """
            const ends = [...document.querySelectorAll(".ledger-row > summary .interval")];
            const page = document.documentElement.clientWidth;
            return ends.map((each) => page - each.getBoundingClientRect().right);
        """
        assert min(resized.execute_script(ends)) > 2.0
