"""What a table or a card prints is what a person would write."""

from __future__ import annotations

import re

import pytest

from d2d.study.book.typography import typeset, unbroken


def shown(text: str) -> str:
    """The HTML as a reader sees it, with a plain space for one that does not break."""
    marked = re.sub(r"<sup>(.*?)</sup>", r"^\1", re.sub(r"<sub>(.*?)</sub>", r"_\1", typeset(text)))
    return re.sub("<[^>]*>", "", marked).replace("\N{NO-BREAK SPACE}", " ")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1.6e+05", "1.6 × 10^5"),
        ("1e-04", "10^−4"),
        ("a relative 1e-5", "a relative 10^−5"),
        ("-8.22, -6.08, 12.44", "−8.22, −6.08, 12.44"),
        ("0.34 [-8.71, -7.31]", "0.34 [−8.71, −7.31]"),
        ("-0.00", "0.00"),
        ("+0.0 dB", "0.0 dB"),
        ("-0", "0"),
        ("160000", "160 000"),
        ("over 20000 draws", "over 20 000 draws"),
        ("omega and v_y", "ω and v_y"),
        ("sigmas 5 x too small", "sigmas 5 × too small"),
        ("range x 0.25", "range × 0.25"),
        ("I2 of -7.7 dB", "I² of −7.7 dB"),
        ("from 10^-12 to 10^5", "from 10^−12 to 10^5"),
        ("-log sum_k q_k and -sum_k log q_k", "−log Σ_k q_k and −Σ_k log q_k"),
        ("at 2 sqrt(2) sigma", "at 2 √2 σ"),
    ],
)
def test_numbers_and_symbols_are_printed(text: str, expected: str):
    """Breaks if a reader meets a number or a symbol as it is typed in code."""
    assert shown(text) == expected


@pytest.mark.parametrize(
    "text",
    ["+0.05", "-0.04".replace("-", "−"), "scene-0061", "0.12345", "1234", "x (m)", "x = 3.4 m",
     "max-2", "sigma_azimuth", "the median sigma of 3", "2, 1", "0.3 s"],
)  # fmt: skip
def test_everything_else_stays(text: str):
    """Breaks if a rule takes a name for a number, or drops a sign that tells something."""
    assert shown(text) == text


def test_code_stays_code():
    """Breaks if a name of the code is shown between backticks, or with an index."""
    assert typeset("the `v_x` of v_x") == "the <code>v_x</code> of <i>v</i><sub>x</sub>"
    assert typeset("a ` alone") == "a ` alone"


def test_signs_of_html_are_escaped():
    """Breaks if text can open an element."""
    assert typeset("a < b & c") == "a &lt; b &amp; c"


@pytest.mark.parametrize(
    ("text", "together"),
    [
        ("in 95 % of", "95~%"),
        ("within 0.4 dB of", "0.4~dB"),
        ("turns at 30 °/s.", "30~°/s"),
        ("20 000 draws", "20~000"),
        ("2.57 ± 0.53", "2.57~±~0.53"),
        ("Fig. 40", "Fig.~40"),
        ("5 · Estimation", "5~· Estimation"),
    ],
)
def test_a_number_keeps_its_unit(text: str, together: str):
    """Breaks if a line can end between a number and its unit."""
    assert together.replace("~", "\N{NO-BREAK SPACE}") in unbroken(text)


@pytest.mark.parametrize("text", ["4 methods", "in 2020 m", "6 sets of 3 scans", "10 maps"])
def test_words_after_a_number_may_break(text: str):
    """Breaks if the first letters of a word are taken for a unit."""
    expected = text.replace("2020 m", "2020\N{NO-BREAK SPACE}m")
    assert unbroken(text) == expected


@pytest.mark.parametrize(
    "interval", ["1.28 to 1.42", "[0.29, 0.39]", "[−8.71, +0.5]", "93% to 97%"]
)
def test_an_interval_is_marked_as_a_whole(interval: str):
    """Breaks if a wide screen sets the bounds of an interval on two lines."""
    assert typeset(f"a {interval} b") == f'a <span class="whole">{interval}</span> b'
