"""The laboratory that replays a real drive, on a page of its own that is opened from a folder.

Breaks if the errors that it counts are not those that d2d counts, if it moves before it is asked
to, or if it does not fit the first screen of a desk.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from selenium import webdriver
from selenium.webdriver.common.keys import Keys

from d2d.scores import within
from tests.book import browser, lone
from tests.book.test_labs import Hand
from tools.replay_data import drive

SHOWN, BUTTON = "lab.state.shown", ".lab-button"


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> str:
    return lone.page_of(tmp_path_factory.mktemp("replay"), "replay")


@pytest.fixture
def hand(driver: webdriver.Chrome, address: str) -> Iterator[Hand]:
    hand = lone.hand_on(driver, "replay")
    hand.open(address)
    yield hand
    browser.prefer(driver, "")
    browser.resize(driver, browser.WIDE)


@pytest.mark.parametrize("covariance", ["hessian", "budget"])
def test_errors_are_counted_as_d2d_counts_them(hand: Hand, address: str, covariance: str):
    """With all digits: breaks if the data lose so many that an error changes sides."""
    columns = drive()
    errors = np.column_stack([columns["errorX"], columns["errorY"]])
    entries = [columns[covariance + entry] for entry in ("XX", "XY", "XY", "YY")]
    covariances = np.stack(entries, axis=-1).reshape(-1, 2, 2)
    inside = within(errors, covariances, 0.95)
    for shown in (1, 150, len(inside)):
        hand.open(f"{address}#{hand.lab.id}?covariance={covariance}&shown={shown}")
        count = int(inside[:shown].sum())
        assert hand.ask("lab.result") == {"shown": shown, "inside": count}
        assert hand.ask("lab.told.textContent").startswith(f"{count} of {shown} errors")
        filled = "lab.plots[1].content.querySelectorAll('.lab-inside').length"
        assert hand.ask(filled) == inside[: shown - 1].sum()  # the last has a mark of its own


def now(hand: Hand, wait: int = 0) -> int:
    """How many estimates are shown after some ms; `Hand.ask` would wait until it has played."""
    script = "setTimeout(() => arguments[1](labs.all['lab-replay'].state.shown), arguments[0])"
    return int(hand.driver.execute_async_script(script, wait))


def test_it_stands_still_until_it_is_asked(hand: Hand):
    """Breaks if it plays by itself, cannot be paused, or goes on under somebody's hand."""
    last = now(hand)
    assert now(hand, 300) == last == hand.ask("replayData.time.length")
    button = hand.find(BUTTON)
    button.click()
    assert now(hand, 300) < last
    assert button.text == "Pause"
    hand.find("input[value=budget]").click()  # looks at the other covariance while it plays
    begun = now(hand)
    assert begun < now(hand, 600) < last
    button.send_keys(Keys.ENTER)
    paused = now(hand, 100)
    assert now(hand, 300) == paused < last
    assert button.text == "Play the drive"
    button.send_keys(Keys.ENTER)  # goes on where it was
    assert paused < now(hand, 600)
    hand.find(f"#{hand.lab.id}-shown").send_keys(Keys.ARROW_LEFT)
    held = now(hand)
    assert now(hand, 300) == held < last


def test_it_plays_to_the_end(hand: Hand):
    hand.ask("(lab.state.shown = lab.state.shown - 20, lab.update(), 0)")
    hand.tap("mouse", hand.find(BUTTON))
    browser.wait(hand.driver, f"return {hand.it}.state.shown === replayData.time.length")
    browser.wait(hand.driver, f"return {hand.it}.element.textContent.includes('Play the drive')")


def test_less_motion_goes_to_the_end_at_once(driver: webdriver.Chrome, address: str):
    feature = {"name": "prefers-reduced-motion", "value": "reduce"}
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})
    hand = lone.hand_on(driver, "replay")
    driver.get("about:blank")
    driver.get(f"{address}#{hand.lab.id}?shown=40")
    browser.wait(driver, f"return Boolean(window.labs && {hand.it}?.result)")
    driver.execute_script(f"document.querySelector('#{hand.lab.id} {BUTTON}').click()")
    assert hand.ask(f"{SHOWN} === replayData.time.length")
    browser.prefer(driver, "")


def test_the_path_is_drawn_as_far_as_it_is_shown(hand: Hand, address: str):
    points = "lab.plots[0].content.querySelector('.lab-robust').getAttribute('d').split('L').length"
    hand.open(f"{address}#{hand.lab.id}?shown=120")
    assert hand.ask(points) == 121  # with the start


def test_it_fits_the_first_screen_below_a_title(hand: Hand):
    bottom = hand.ask("lab.element.getBoundingClientRect().bottom + scrollY")
    assert bottom < 900.0


@pytest.mark.parametrize("width", [browser.WIDE, browser.NARROW, 320])
@pytest.mark.parametrize("theme", browser.THEMES)
def test_everybody_can_use_it(hand: Hand, address: str, width: int, theme: str):
    lone.assert_usable(hand, address, width, theme)


@pytest.mark.parametrize("query", ["shown=0", "shown=1.5", "shown=9e9", "covariance=constructor"])
def test_any_address_is_survived(hand: Hand, address: str, query: str):
    hand.open(f"{address}#{hand.lab.id}?{query}")
    assert hand.ask("[lab.state.shown, lab.state.covariance]") == [
        hand.ask("replayData.time.length"),
        "hessian",
    ]


def test_the_data_are_small():
    """Breaks if the first page has to load more than 100 kB for its picture."""
    assert (Path(lone.LABS) / "replay_data.js").stat().st_size < 100_000
