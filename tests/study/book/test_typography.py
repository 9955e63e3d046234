"""What a table or a card prints is what a person would write."""

import re

from d2d.study.book.typography import typeset, unbroken


def shown(text: str) -> str:
    """The HTML as a reader sees it, with a plain space for one that does not break."""
    marked = re.sub(r"<sup>(.*?)</sup>", r"^\1", re.sub(r"<sub>(.*?)</sub>", r"_\1", typeset(text)))
    return re.sub("<[^>]*>", "", marked).replace("\N{NO-BREAK SPACE}", " ")


PRINTED = {
    "1.6e+05": "1.6 × 10^5",
    "1e-04": "10^−4",
    "a relative 1e-5": "a relative 10^−5",
    "-8.22, -6.08, 12.44": "−8.22, −6.08, 12.44",
    "0.34 [-8.71, -7.31]": "0.34 [−8.71, −7.31]",
    "-0.00": "0.00",
    "+0.0 dB": "0.0 dB",
    "-0": "0",
    "160000": "160 000",
    "over 20000 draws": "over 20 000 draws",
    "omega and v_y": "ω and v_y",
    "sigmas 5 x too small": "sigmas 5 × too small",
    "range x 0.25": "range × 0.25",
    "I2 of -7.7 dB": "I² of −7.7 dB",
    "from 10^-12 to 10^5": "from 10^−12 to 10^5",
    "-log sum_k q_k and -sum_k log q_k": "−log Σ_k q_k and −Σ_k log q_k",
    "at 2 sqrt(2) sigma": "at 2 √2 σ",
    "10 m and 45 deg": "10 m and 45°",
    "75 deg/s": "75 °/s",
    "deg/m": "°/m",
}
UNCHANGED = ("+0.05", "−0.04", "scene-0061", "0.12345", "1234", "x (m)", "x = 3.4 m", "max-2")
UNCHANGED += ("sigma_azimuth", "the median sigma of 3", "2, 1", "0.3 s")


def test_numbers_and_symbols_are_printed():
    """Breaks if a reader meets a number or a symbol as it is typed in code."""
    for text, expected in PRINTED.items():
        assert shown(text) == expected


def test_everything_else_stays():
    """Breaks if a rule takes a name for a number, or drops a sign that matters."""
    for text in UNCHANGED:
        assert shown(text) == text


def test_code_stays_code():
    """Breaks if a name of the code is shown between backticks, or with an index."""
    assert typeset("the `v_x` of v_x") == "the <code>v_x</code> of <i>v</i><sub>x</sub>"
    assert typeset("a ` alone") == "a ` alone"


def test_signs_of_html_are_escaped():
    """Breaks if text can open an element."""
    assert typeset("a < b & c") == "a &lt; b &amp; c"


def test_a_number_keeps_its_unit_and_a_word_may_break():
    """Breaks if a line can end within a number and its unit, or a word is taken for a unit."""
    for text in (
        "in 95~% of",
        "within 0.4~dB of",
        "turns at 30~°/s.",
        "20~000 draws",
        "2.57~±~0.53",
        "Fig.~40",
        "5~· Estimation",
        "4 methods",
        "in 2020~m",
        "6 sets of 3 scans",
        "10 maps",
    ):
        assert unbroken(text.replace("~", " ")) == text.replace("~", "\N{NO-BREAK SPACE}")


def test_an_interval_is_marked_as_a_whole():
    """Breaks if a wide screen sets the bounds of an interval on two lines."""
    for interval in ("1.28 to 1.42", "[0.29, 0.39]", "[−8.71, +0.5]"):
        assert typeset(f"a {interval} b") == f'a <span class="whole">{interval}</span> b'
    assert (
        typeset("93% to 97%")
        == '<span class="whole">93\N{NO-BREAK SPACE}% to 97\N{NO-BREAK SPACE}%</span>'
    )
