"""The laboratory of one's own log, in a page of its own: by hand, from a folder and from a server.

Breaks if what it saves is not what the command line writes by the command that it shows, if a
mistake in a file is not named with its row and column, if it cannot be stopped, or if it needs more
than its own files.  `make test-engine` runs it without a built book.
"""

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement

from d2d.radar import cli, simulate_drive
from d2d.radar.cli import main
from tests.book import browser, faults
from tests.book.logs import Case, assert_same_files, several

LABS = Path(__file__).resolve().parents[2] / "_static" / "labs"
SCRIPTS = ("engine", "kit", "tracker", "findings", "log")
HEAD = """<!doctype html><html lang="en" data-theme="light"><meta charset="utf-8">
<title>A log</title><link rel="icon" href="data:,"><link rel="stylesheet" href="labs.css">
<style>html[data-theme="dark"] { --pst-color-background: #14181e; --pst-color-text-base: #ced6dd; }
* { box-sizing: border-box; }
body { background: var(--pst-color-background, #fff); color: var(--pst-color-text-base, #222); }
</style>"""
BODY = '<div class="lab" data-lab="log" data-symptoms="when.html">It needs JavaScript.</div>'
SAVED = ("track.tum", "track_velocities.txt")
DROP = """const [text, name] = arguments, carried = new DataTransfer();
carried.items.add(new File([text], name));
document.querySelector(".lab-drop").dispatchEvent(
  new DragEvent("drop", {dataTransfer: carried, bubbles: true, cancelable: true}));"""
WIDTHS = (1400, 700, 400, 320)


class Hand:
    """Works the laboratory as a reader does."""

    def __init__(self, driver: webdriver.Chrome, folder: Path) -> None:
        self.driver, self.folder = driver, folder

    def open(self, address: str) -> None:
        """Load the page afresh."""
        self.driver.get("about:blank")
        browser.drain(self.driver)
        self.driver.get(f"{address}page.html")
        browser.wait(self.driver, "return Boolean(window.labs?.all['lab-log'])")

    def find(self, selector: str) -> WebElement:
        return self.driver.find_element(By.CSS_SELECTOR, f"#lab-log {selector}")

    def field(self, label: str, number: int = 0) -> WebElement:
        """The input whose label begins like that; of several sensors, the one of that number."""
        script = """return [...document.querySelectorAll("#lab-log label")]
          .filter((each) => each.textContent.trim().startsWith(arguments[0]))
          .map((each) => each.control)[arguments[1]];"""
        return self.driver.execute_script(script, label, number)

    def press(self, label: str) -> None:
        """Press a button with the keyboard."""
        script = """return [...document.querySelectorAll("#lab-log button")]
          .find((each) => each.textContent === arguments[0]);"""
        self.driver.execute_script(script, label).send_keys(Keys.ENTER)

    def choose(self, text: str, name: str = "log.csv") -> None:
        (self.folder / name).write_text(text)
        self.find("input[type=file]").send_keys(str(self.folder / name))

    def text(self, selector: str) -> str:
        return " ".join(self.find(selector).text.split())

    def wait(self, condition: str) -> None:
        browser.wait(self.driver, f"const lab = labs.all['lab-log']; return {condition}", 120)

    def until_read(self) -> None:
        self.wait("!lab.element.querySelector('form').hidden")

    def until_done(self) -> None:
        self.wait("Boolean(lab.result)")

    def fill(self, case: Case) -> None:
        """Type the mountings, sensor by sensor in the order of the log."""
        for number, place in enumerate(case.places.values()):
            for label, value in zip(("x, f", "y, l", "yaw"), place, strict=True):
                self.field(label, number).send_keys(repr(value))

    def complaint(self) -> str:
        self.wait("!lab.element.querySelector('.lab-wrong').hidden")
        return self.text(".lab-wrong")

    def save(self) -> list[Path]:
        """Press both buttons and wait for the files."""
        files = [self.folder / "saved" / name for name in SAVED]
        for file in files:
            file.unlink(missing_ok=True)
            self.press(f"Save {file.name}")
            for _ in range(100):
                if file.exists():
                    break
                self.driver.execute_async_script("setTimeout(arguments[0], 100)")
        return files


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the page and its scripts."""
    folder = tmp_path_factory.mktemp("site")
    for file in LABS.iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    loaded = "".join(f'<script defer src="{name}.js"></script>' for name in SCRIPTS)
    (folder / "page.html").write_text(f"{HEAD}{loaded}<body>{BODY}</body></html>", encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def server(site: Path) -> Iterator[str]:
    with browser.serve(site) as address:
        yield address


@pytest.fixture
def hand(driver: webdriver.Chrome, tmp_path: Path, server: str) -> Iterator[Hand]:
    """A hand on the served page; what it saves is in a folder of its own."""
    allowed = {"behavior": "allow", "downloadPath": str(tmp_path / "saved")}
    driver.execute_cdp_cmd("Browser.setDownloadBehavior", allowed)
    browser.resize(driver, browser.WIDE)
    opened = Hand(driver, tmp_path)
    opened.open(server)
    yield opened
    browser.resize(driver, browser.WIDE)


def robot(duration: float = 3.0) -> Case:
    drive = simulate_drive(np.random.default_rng(1), duration)
    return Case({"radar": (drive.scans, drive.mounting)})


def assert_saved_as_the_command_says(hand: Hand, folder: Path) -> None:
    """The command that the page shows writes the same files."""
    command = hand.text(".lab-command").removeprefix("python -m d2d.radar ")
    words = shlex.split(command)
    place = words.index("--csv") + 1
    words[place] = str(folder / words[place])
    quiet = ["--no-picture", "--no-progress", "--force", "--output", str(folder / "drive")]
    assert main([*words, *quiet]) == 0
    tum, _ = hand.save()
    assert_same_files(folder / "drive", tum.with_suffix(""))


@pytest.mark.parametrize("place", ["folder", "server"])
def test_the_example_is_that_of_the_command_line(
    hand: Hand, site: Path, tmp_path: Path, place: str
):
    """Breaks if a page that is opened from a folder cannot make a worker, or the example is old."""
    if place == "folder":
        hand.open(f"{site.as_uri()}/")
    hand.press("Load the example")
    hand.until_read()
    hand.press("Estimate the track")
    hand.until_done()
    assert main(["example", str(tmp_path / "example.csv")]) == 0
    assert_saved_as_the_command_says(hand, tmp_path)
    assert "600 estimates from 0.100 s to 60.000 s, 99.3% accepted" in hand.text(".lab-told")
    complaints, *_ = browser.traffic(hand.driver, hand.driver.current_url)
    assert complaints == []


def test_several_sensors_with_all_settings(hand: Hand, tmp_path: Path):
    """Every field reaches the numbers, as the option of the command line of the same meaning."""
    case = Case(several(6.0))
    hand.choose(case.text)
    hand.until_read()
    hand.fill(case)
    hand.find("summary").send_keys(Keys.ENTER)
    for label, value in (
        ("range", "0.2"),
        ("azimuth (", "0.7"),
        ("Doppler velocity", "0.08"),
        ("with the scan", "0.25"),
        ("longest usual", "30"),
        ("σ of its sideways", "0.1"),
        ("largest acc", "9"),
        ("σ of reflections", "0.02"),
        ("azimuth and mounting", "0.2"),
        ("Doppler velocities of", "0.03"),
        ("their scale", "0.001"),
        ("time stamps", "0.02"),
        ("correlation length", "0.5"),
    ):
        field = hand.field(label)
        field.clear()
        field.send_keys(value)
    field.send_keys(Keys.ENTER)  # as in any form
    hand.until_done()
    assert_saved_as_the_command_says(hand, tmp_path)
    assert "--budget-neighbours 0.5" in hand.text(".lab-command")
    rows = hand.driver.find_elements(By.CSS_SELECTOR, "#lab-log tbody tr")
    assert [row.text.split()[0] for row in rows] == ["ahead", "aside"]


def test_a_log_is_dropped_and_nothing_leaves(hand: Hand):
    """Breaks if anything is asked for after the page has loaded."""
    begun = hand.driver.execute_script("return performance.now()")
    case = robot()
    hand.driver.execute_script(DROP, case.text, "dropped.csv")
    hand.until_read()
    assert hand.text(".lab-status").startswith("dropped.csv: ")
    hand.fill(case)
    hand.press("Estimate the track")
    hand.until_done()
    asked = """return performance.getEntriesByType('resource')
      .filter((each) => each.startTime > arguments[0] && !each.name.startsWith('blob:'))
      .map((each) => each.name);"""
    assert hand.driver.execute_script(asked, begun) == []
    assert "sends nothing" in hand.text(".lab-drop")


def test_degrees_and_missing_columns(hand: Hand, tmp_path: Path):
    """A log without standard deviations, in degrees, with semicolons and a comment."""
    case = robot()
    lines = case.text.splitlines()
    rows = [line.split(",")[1:5] for line in lines[1:]]
    degrees = [[t, r, repr(float(np.rad2deg(float(a)))), d] for t, r, a, d in rows]
    text = "\n".join(["# a log", "time;range;azimuth;doppler", *map(";".join, degrees), ""])
    hand.choose(text, "my log.csv")
    hand.until_read()
    hand.fill(case)
    hand.press("Estimate the track")
    assert not hand.driver.execute_script("return Boolean(labs.all['lab-log'].result)")
    assert hand.driver.switch_to.active_element == hand.field("range")  # the browser asks for it
    for label, value in (("range", "0.15"), ("azimuth (", "0.6"), ("Doppler velocity", "0.07")):
        hand.field(label).send_keys(value)
    hand.find("input[type=checkbox]").send_keys(Keys.SPACE)
    hand.press("Estimate the track")
    hand.until_done()
    assert_saved_as_the_command_says(hand, tmp_path)


def test_it_can_be_stopped_and_begun_again(hand: Hand):
    hand.press("Load the example")
    hand.until_read()
    hand.press("Estimate the track")
    hand.wait("lab.element.querySelector('progress').value > 0")
    hand.press("Stop")
    hand.wait("lab.element.querySelector('.lab-busy').hidden")
    assert hand.text(".lab-status").startswith("Stopped")
    assert not hand.driver.execute_script("return Boolean(labs.all['lab-log'].result)")
    hand.press("Estimate the track")
    hand.wait("lab.element.querySelector('progress').value > 0")
    case = robot(1.0)
    hand.choose(case.text)  # another log ends the computing too
    hand.until_read()
    hand.fill(case)
    hand.press("Estimate the track")
    hand.until_done()
    assert hand.driver.execute_script("return labs.all['lab-log'].result.rows.length") == 10


def wrong_at(line: int, column: int, word: str) -> str:
    rows = [line.split(",") for line in robot(1.0).text.splitlines()]
    rows[line - 1][column] = word
    return "\n".join(map(",".join, rows))


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "log.csv is empty: its first line must name the columns"),
        ("a,b\n1,2", "log.csv, line 1: the first line must name the columns time, range, azimuth,"),
        ("time,range,azimuth,doppler\n", "log.csv has no line with a target"),
        ("time,range,azimuth,doppler\n1,2,3", "line 2: there must be 4 values as in the first"),
        (wrong_at(7, 0, " "), "log.csv, line 7: sensor must be a name or a number, but is empty"),
        (wrong_at(5, 3, "left"), "log.csv, line 5: azimuth must be a number, but is 'left'"),
        (wrong_at(6, 2, "-3"), "log.csv, line 6: range must be positive, but is -3"),
        (wrong_at(9, 4, "nan"), "log.csv, line 9: doppler must be finite, but holds nan or inf"),
        (wrong_at(4, 5, "0"), "log.csv, line 4: sigma_range must be positive, but is 0"),
    ],
)
def test_what_is_wrong_with_a_log_is_named(hand: Hand, text: str, complaint: str):
    """Breaks if a reader is not told which row and which column to mend."""
    hand.choose(text)
    hand.wait(
        "!lab.element.querySelector('form').hidden"
        " || !lab.element.querySelector('.lab-wrong').hidden"
    )
    if hand.find("form").is_displayed():
        hand.fill(robot(0.2))
        hand.press("Estimate the track")
    assert complaint in hand.complaint()


def test_symptoms_lead_to_their_page(hand: Hand):
    """A wrong sign is told by name, and that the command line would write nothing."""
    case = robot()
    rows = [line.split(",") for line in case.text.splitlines()]
    flipped = [[*row[:4], repr(-float(row[4])), *row[5:]] for row in rows[1:]]
    hand.choose("\n".join(map(",".join, [rows[0], *flipped])))
    hand.until_read()
    hand.fill(case)
    hand.press("Estimate the track")
    hand.until_done()
    assert "the path runs backwards" in hand.text(".lab-report ul")
    assert "The command line would write no file" in hand.text(".lab-report")
    assert hand.find(".lab-symptoms a").get_attribute("href").endswith("when.html")


@pytest.mark.parametrize("name", faults.CASES)
def test_the_page_says_what_the_command_line_says(
    name: str, hand: Hand, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
):
    """Breaks if a mistake is called by another name, is blamed on another sensor, or is not told.

    One log with one mistake in it; what both programs say of it is compared word by word.
    """
    case, expected, tell = faults.CASES[name](), [], cli._tell
    monkeypatch.setattr(
        cli, "_tell", lambda found, force: (expected.extend(found), tell(found, force))
    )
    hand.choose(case.text)
    command = ["track", "--csv", str(tmp_path / "log.csv"), "--output", str(tmp_path / "drive")]
    for sensor, at in case.places.items():
        command += ["--mounting", sensor, *map(repr, at)]
    main([*command, *case.words, "--no-picture", "--no-progress", "--force"])
    said = capsys.readouterr().out
    assert bool(expected) == (name not in faults.CORRECT)
    assert name not in faults.known.FAULTS or name in {each.symptom for each in expected}
    hand.until_read()
    hand.fill(case)
    if "horizon" in case.settings:
        hand.find("summary").send_keys(Keys.ENTER)
        hand.field("with the scan").send_keys(repr(case.settings["horizon"]))
    hand.press("Estimate the track")
    hand.until_done()
    found = hand.driver.execute_script("return labs.all['lab-log'].result.found")
    for key in ("symptom", "unit", "sure"):
        assert [each[key] for each in found] == [getattr(each, key) for each in expected]
    numbers = [each["number"] for each in found]
    np.testing.assert_allclose(numbers, [each.number for each in expected], rtol=1e-5, atol=1e-9)
    script = (
        "return [...document.querySelectorAll('#lab-log .lab-report li')].map(e => e.innerText)"
    )
    assert hand.driver.execute_script(script) == [cli._plain(each) for each in expected]
    refused = "The command line would write no file" in hand.text(".lab-report")
    assert refused == any(each.sure for each in expected)
    if "ANEES" in said:
        assert said.split("ANEES")[1].splitlines()[0] in hand.text(".lab-told")


REFUSED = {  # the column, and what its values are multiplied by
    "degrees as radians": (3, 180.0 / np.pi),
    "times in milliseconds": (1, 1e3),
    "ranges in millimetres": (2, 1e3),
}


@pytest.mark.parametrize("name", REFUSED)
def test_the_page_refuses_what_the_command_line_refuses(
    name: str, hand: Hand, tmp_path: Path, capsys: Any
):
    """Breaks if a log in other units is taken by one of the programs, or for another reason."""
    column, factor = REFUSED[name]
    case = robot(1.0)
    head, *rows = [line.split(",") for line in case.text.splitlines()]
    for row in rows:
        row[column] = repr(factor * float(row[column]))
    hand.choose("\n".join(map(",".join, [head, *rows])))
    hand.until_read()
    hand.fill(case)
    hand.press("Estimate the track")
    words, log = hand.complaint().split("?")[0], str(tmp_path / "log.csv")  # the remedy is another
    assert main(["track", "--csv", log, "--mounting", "radar", "0.4", "0", "0"]) == 1
    said = capsys.readouterr().err.replace(log, "log.csv").replace("max_interval = ", "")
    assert words in said
    assert "are these" in words


@pytest.mark.parametrize("theme", browser.THEMES)
def test_it_fits_every_width_in_both_themes(hand: Hand, theme: str):
    """Breaks if the page scrolls sideways, a control has no name, or a word can hardly be read."""
    case = Case(several(2.0))
    hand.choose(case.text)
    hand.until_read()
    hand.fill(case)
    hand.press("Estimate the track")
    hand.until_done()
    hand.find("summary").send_keys(Keys.ENTER)
    hand.driver.execute_script("document.documentElement.dataset.theme = arguments[0]", theme)
    for width in WIDTHS:
        browser.resize(hand.driver, width)
        wide = hand.driver.execute_script("return document.documentElement.scrollWidth")
        assert wide <= width
    nameless = """return [...document.querySelectorAll("#lab-log :is(input, button, progress)")]
      .filter((each) => !each.labels?.length && !each.textContent.trim())
      .filter((each) => !each.getAttribute("aria-label")).length;"""
    assert hand.driver.execute_script(nameless) == 0
    assert pale_words(hand) == []


def pale_words(hand: Hand) -> list[Any]:
    """What is not clearly darker or lighter than the page behind it."""
    script = """const light = (text) => {
      const [r, g, b] = text.match(/[0-9.]+/g).map((each) => {
        const share = each / 255;
        return share <= 0.04045 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4;
      });
      return 0.2126 * r + 0.7152 * g + 0.0722 * b;
    };
    const behind = light(getComputedStyle(document.body).backgroundColor);
    return [...document.querySelectorAll("#lab-log :is(p, label, legend, summary, li, td, text)")]
      .filter((each) => {
        const style = getComputedStyle(each);
        const own = light(each.tagName === "text" ? style.fill : style.color);
        const [high, low] = [Math.max(own, behind), Math.min(own, behind)];
        return (high + 0.05) / (low + 0.05) < arguments[0];
      }).map((each) => each.textContent);"""
    return list(hand.driver.execute_script(script, browser.CONTRAST))
