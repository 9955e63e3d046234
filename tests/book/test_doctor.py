"""The covariance doctor: its numbers are those of d2d, and a table is read as it was written."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy
from numpy.typing import NDArray
from selenium import webdriver

from d2d import coverage, credibility, whiten
from tests.book import browser
from tests.book.test_labs import Hand, Laboratory

Array = NDArray[np.float64]
Table = tuple[Array, Array]
PAGE = "chapters/why_is_my_covariance_too_small"


@pytest.fixture(scope="module")
def hand(driver: webdriver.Chrome, address: str) -> Hand:
    """A hand on the laboratory, whose page is opened once."""
    hand = Hand(driver, Laboratory(PAGE, "lab-doctor", "", "", ""))
    hand.open(f"{address}{PAGE}.html")
    return hand


def draw(count: int, n: int, seed: int = 0) -> Table:
    """Errors with the covariances that they are drawn from, which differ from row to row."""
    rng = np.random.default_rng([seed, n])
    unit = 10.0 ** -np.arange(n)
    factors = 0.4 * rng.standard_normal((count, n, n)) * unit[:, None]
    covariances = factors @ factors.swapaxes(-1, -2) + np.diag(unit**2)
    root = np.linalg.cholesky(covariances)
    return (root @ rng.standard_normal((count, n, 1)))[..., 0], covariances


def text_of(table: Table, full: bool = True, separator: str = ",") -> str:
    """The table as text, with all digits."""
    errors, covariances = table
    n = errors.shape[1]
    entries = covariances.reshape(-1, n * n) if full else covariances[:, *np.triu_indices(n)]
    rows = np.column_stack([errors, entries]).tolist()
    return "\n".join(separator.join(map(repr, row)) for row in rows)


def paste(hand: Hand, text: str) -> Any:
    """What the laboratory makes of a text."""
    script = """const box = document.querySelector('textarea');
    box.value = arguments[0]; box.dispatchEvent(new Event('input'));"""
    hand.driver.execute_script(script, text)
    return hand.ask("lab.result")


def said(hand: Hand) -> str:
    return str(hand.ask("lab.told.querySelector('p').textContent"))


@pytest.mark.parametrize("full", [True, False])
@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 6])
def test_numbers_are_those_of_d2d(hand: Hand, n: int, full: bool):
    table = errors, covariances = draw(150, n)
    errors[7] = 0.0  # which is perfectly credible
    judged = paste(hand, text_of(table, full))["judged"]
    assert_judged(judged, errors, covariances)
    values = whiten(errors, covariances).values
    assert judged["bias"] == pytest.approx((values.mean(axis=0) ** 2).mean(), rel=1e-9)
    assert len(judged["columns"]) == n
    for i, column in enumerate(judged["columns"]):
        own, stated = errors[:, [i]], covariances[:, [i]][:, :, [i]]
        assert_judged(column, own, stated)
        z = own[:, 0] / np.sqrt(stated[:, 0, 0])
        np.testing.assert_allclose(column["normalised"], z, rtol=1e-9)
        assert column["mean"] == pytest.approx(z.mean(), rel=1e-9)
        off = z - z.mean()
        lag_one = (off[1:] * off[:-1]).sum() / (off**2).sum()
        assert column["lagOne"] == pytest.approx(lag_one, rel=1e-9)


def assert_judged(got: dict[str, Any], errors: Array, covariances: Array) -> None:
    """What the page found of errors and covariances is what d2d finds."""
    expected = credibility(errors, covariances)
    for name, own in (
        ("nees", expected.nees),
        ("credibleNees", expected.credible_nees),
        ("anees", expected.anees),
        ("bounds", expected.bounds),
        ("nci", expected.nci),
        ("inclination", expected.inclination),
        ("coverage", coverage(errors, covariances)),
        ("typical", np.median(expected.nees) / scipy.stats.chi2.median(errors.shape[1])),
    ):
        np.testing.assert_allclose(got[name], own, rtol=1e-9, err_msg=name)
    assert got["consistent"] == expected.consistent


@pytest.mark.parametrize(
    ("example", "cause", "words"),
    [
        ("right", "none", "is credible"),
        ("scale", "scale", "2.0 in the standard deviation"),
        ("direction", "directions", "x and yaw are about right"),
        ("tails", "tails", "the median 1.0 times"),
        ("bias", "bias", "on average x is off by 2.0"),
        ("slow", "none", "Each error resembles the one before"),
    ],
)
def test_an_example_shows_its_trouble(hand: Hand, example: str, cause: str, words: str):
    hand.find(f"input[value={example}]").click()
    assert hand.ask("lab.result.found.cause") == cause
    assert hand.ask("lab.result.found.slow") == (example == "slow")
    assert words in said(hand)


@pytest.mark.parametrize(
    ("factors", "cause", "verdict"),
    [
        ([0.5, 0.5], "scale", "too large"),
        ([1.2, 1.2], "scale", "too small"),
        ([3.0, 0.3], "directions", "too small"),
        ([1.35, 0.42], "directions", "right on average only"),
    ],
)
def test_a_trouble_gets_its_name(hand: Hand, factors: list[float], cause: str, verdict: str):
    """Breaks if errors that are larger or smaller than stated are called something else."""
    errors, covariances = draw(500, 2)
    found = paste(hand, text_of((errors * factors, covariances * np.eye(2))))["found"]
    assert (found["cause"], found["verdict"], found["slow"]) == (cause, verdict, False)


GOOD = ["0.1, 0.2, 1, 0, 0, 1", "-0.3, 0.1, 1, 0, 0, 1", "0.2, -0.4, 1, 0, 0, 1"]


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ([], "Paste a table"),
        (["1,2,3"], "A row has 3 columns"),
        ([*GOOD, "1,2,3"], "Line 4 has 3 columns, the first line 6"),
        ([*GOOD, "1, 2, one, 0, 0, 1"], "Line 4: “one” is not a number"),
        ([*GOOD, "1, 2, 1, 0.5, 0, 1"], "Line 4: the covariance is not symmetric"),
        ([*GOOD, "# a remark", "1, 2, 1, 2, 2, 1"], "Line 5: the covariance is not positive def"),
        (GOOD[:2], "2 errors a row need more than 2 rows"),
        (["x,y,a,b,c,d"], "2 errors a row need more than 2 rows"),
        (["0, 1, 1, 0, 0, 1"] * 5, "The errors do not span all directions"),
    ],
)
def test_it_says_what_is_wrong_with_a_table(hand: Hand, lines: list[str], message: str):
    paste(hand, "\n".join(lines))
    assert message in said(hand)


@pytest.mark.parametrize(
    "text",
    [
        "\n".join(GOOD),
        "\n".join(GOOD).replace(", ", " "),
        "\n".join(GOOD).replace(", ", "\t"),
        "\n".join(GOOD).replace(", ", ";").replace(".", ","),  # as a German spreadsheet writes it
        "\ufeffx,y,xx,xy,yx,yy\r\n" + "\r\n".join(GOOD) + "\r\n\r\n",
        "# a remark\n" + "\n".join([*GOOD, "nan,nan,nan,nan,nan,nan", "1,,1,0,0,1"]),
    ],
)
def test_a_table_may_be_written_in_many_ways(hand: Hand, text: str):
    table = paste(hand, text)["table"]
    assert table["errors"] == [[0.1, 0.2], [-0.3, 0.1], [0.2, -0.4]]
    assert table["covariances"] == [[[1.0, 0.0], [0.0, 1.0]]] * 3
    assert table["names"] == (["x", "y"] if "x" in text else ["error 1", "error 2"])
    assert table["left"] == (2 if "nan" in text else 0)
    assert ("2 left out" in said(hand)) == ("nan" in text)


def test_a_file_is_opened_and_dropped(hand: Hand, tmp_path: Path):
    """Breaks if a file is not read, or a dropped one replaces the page."""
    file = tmp_path / "errors.csv"
    file.write_text("\n".join(GOOD), encoding="utf-8")
    hand.find("input[type=file]").send_keys(str(file))
    browser.wait(hand.driver, f"return {hand.it}.result.table.errors.length === 3")
    assert hand.ask("lab.state.example") == ""
    drop = """const data = new DataTransfer(), box = document.querySelector('textarea');
    data.items.add(new File([arguments[0]], "more.csv"));
    const event = new DragEvent('drop', {dataTransfer: data, bubbles: true, cancelable: true});
    return box.dispatchEvent(event);"""
    taken = not hand.driver.execute_script(drop, "\n".join([*GOOD, GOOD[0]]))
    browser.wait(hand.driver, f"return {hand.it}.result.table.errors.length === 4")
    assert taken


def test_a_table_stays_in_the_page(hand: Hand):
    """Breaks if a reader's numbers are sent, stored, or written to the address."""
    begun = hand.driver.execute_script("return performance.now()")
    paste(hand, "\n".join(["0.777, 0.2, 1, 0, 0, 1", *GOOD]))
    browser.wait(hand.driver, "return location.hash.includes('example')")
    assert "777" not in hand.driver.current_url
    asked = "performance.getEntriesByType('resource').filter(e => e.startTime > arguments[0])"
    assert hand.driver.execute_script(f"return {asked}", begun) == []
    stored = "return JSON.stringify(localStorage) + JSON.stringify(sessionStorage)"
    assert "777" not in hand.driver.execute_script(stored)
