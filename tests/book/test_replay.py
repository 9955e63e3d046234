"""The replayed drive counts its errors as d2d does, and plays when it is asked to."""

import numpy as np
import pytest
from selenium import webdriver
from selenium.webdriver.common.keys import Keys

from d2d.scores import within
from tests.book.test_labs import Hand, Laboratory
from tools.replay_data import drive


@pytest.fixture
def hand(driver: webdriver.Chrome, address: str) -> Hand:
    hand = Hand(driver, Laboratory("intro", "lab-replay", "", "", ""))
    hand.open(f"{address}intro.html")
    return hand


@pytest.mark.parametrize("covariance", ["hessian", "budget"])
def test_errors_are_counted_as_d2d_counts_them(hand: Hand, covariance: str):
    """With all digits: breaks if the data lose so many that an error changes sides."""
    columns = drive()
    errors = np.column_stack([columns["errorX"], columns["errorY"]])
    entries = [columns[covariance + entry] for entry in ("XX", "XY", "XY", "YY")]
    covariances = np.stack(entries, axis=-1).reshape(-1, 2, 2)
    inside = within(errors, covariances, 0.95)
    for shown in (1, 150, len(inside)):
        hand.view(f"covariance={covariance}&shown={shown}")
        count = int(inside[:shown].sum())
        assert hand.ask("lab.result") == {"shown": shown, "inside": count}
        assert hand.ask("lab.told.textContent").startswith(f"{count} of {shown} errors")


def now(hand: Hand, wait: int = 0) -> int:
    """How many estimates are shown after some ms; `Hand.ask` would wait until it has played."""
    script = "setTimeout(() => arguments[1](labs.all['lab-replay'].state.shown), arguments[0])"
    return int(hand.driver.execute_async_script(script, wait))


def test_it_stands_still_until_it_is_asked(hand: Hand):
    """Breaks if it plays by itself, cannot be paused, or goes on under somebody's hand."""
    last = hand.ask("replayData.time.length")
    assert now(hand) == now(hand, 300) == 0
    button = hand.find(".lab-go")
    button.click()
    assert 0 < now(hand, 300) < last
    assert button.text == "Pause"
    hand.find("input[value=budget]").click()  # looks at the other covariance while it plays
    begun = now(hand)
    assert begun < now(hand, 600) < last
    button.send_keys(Keys.ENTER)
    paused = now(hand, 100)
    assert now(hand, 300) == paused < last
    assert button.text == "Drive"
    button.send_keys(Keys.ENTER)  # goes on where it was
    assert paused < now(hand, 600)
    hand.find(f"#{hand.lab.id}-shown").send_keys(Keys.ARROW_LEFT)
    held = now(hand)
    assert now(hand, 300) == held < last
