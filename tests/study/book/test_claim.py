"""Claims, their evidence, and the record of it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from d2d.study.book.claim import (
    ANEES,
    DECIBELS,
    MEAN,
    RATIO,
    SHARE,
    Evidence,
    claim,
    in_some,
    judge,
    nearly_all,
)
from d2d.study.book.measured import Measured
from d2d.study.book.record import differences, read_record, write_record


def about(low, high):
    """A number in the middle of its interval."""
    return Measured(0.5 * (low + high), low, high)


@pytest.mark.parametrize(
    ("parts", "verdict"),
    [
        (("holds", "holds"), "confirmed"),
        (("holds", "holds if"), "conditional"),
        (("open",), "conditional"),
        (("holds", "fails"), "wrong in part"),
        (("holds if", "fails"), "wrong in part"),
        (("fails", "fails"), "refuted"),
    ],
)
def test_verdict_follows_from_parts(parts, verdict):
    """Breaks if a part that fails is outvoted, or a claim is refuted while one part holds."""
    assert judge(parts) == judge(reversed(parts)) == verdict


def test_margins_are_the_smallest_effects_that_count():
    """Breaks if one changes: 5 % of an RMSE, 12 % of a covariance, one draw in twenty."""
    assert (RATIO.low, RATIO.high) == pytest.approx((1 / 1.05, 1.05))
    assert np.hypot(1.0, MEAN.high) == pytest.approx(RATIO.high, abs=1e-3)
    assert DECIBELS == (-0.5, 0.5)
    assert 10.0 * np.log10(ANEES) == pytest.approx(DECIBELS)
    assert SHARE == (-0.05, 0.05)


@pytest.mark.parametrize(
    ("interval", "findings"),
    [
        ((1.06, 1.30), ["holds", "fails", "fails", "fails"]),
        ((1.01, 1.30), ["open", "fails", "open", "open"]),
        ((0.97, 1.03), ["fails", "fails", "holds", "holds"]),
        ((0.80, 0.94), ["fails", "holds", "fails", "holds"]),
        ((0.80, 1.30), ["open", "open", "open", "open"]),
    ],
)
def test_effect_is_found_absent_or_left_open(interval, findings):
    """Breaks if the contrary is judged by another bound of the margin, or by the number alone."""
    rules = (RATIO.larger, RATIO.smaller, RATIO.same, RATIO.no_larger)
    assert [rule(about(*interval)) for rule in rules] == findings


@pytest.mark.parametrize(
    ("interval", "finding"),
    [
        ((0.96, 1.0), "holds"),
        ((0.92, 0.99), "holds if"),
        ((0.48, 0.55), "open"),
        ((0.1, 0.49), "fails"),
    ],
)
def test_claim_of_every_draw_fails_if_false_in_most(interval, finding):
    """Breaks if a claim about all draws is saved by some, or a condition by most of its draws."""
    share, met, hardly_met = about(*interval), about(0.96, 1.0), about(0.85, 0.94)
    assert nearly_all(share) == nearly_all(share, under=hardly_met) == finding
    assert nearly_all(share, under=met) == ("holds" if finding == "holds" else "holds if")
    assert in_some(about(0.06, 0.2)) == "holds"
    assert in_some(about(0.0, 0.04)) == "fails"


def test_axis_has_the_bound_of_the_margin_at_zero():
    """Breaks if the ledger draws a number on the wrong side, or in another unit than the margin."""

    def on_axis(number, rule):
        return pytest.approx(number.as_headline(rule.margin_units).margin_units)

    ratio = Measured(1.05**3, 1.05, 1.05**4)
    assert on_axis(ratio, RATIO.larger) == (0.0, 2.0, 3.0)
    assert on_axis(ratio, RATIO.smaller) == (-5.0, -4.0, -2.0)
    assert on_axis(ratio, RATIO.no_larger) == (-3.0, -2.0, 0.0)
    assert on_axis(Measured(0.2, -0.6, 0.4), DECIBELS.same) == (-0.2, 0.6, 0.6)
    assert on_axis(Measured(0.9, 0.85, 0.95), nearly_all) == (-2.0, -1.0, 0.0)
    assert on_axis(Measured(0.1, 0.05, 0.2), SHARE.larger) == (0.0, 1.0, 3.0)


INSIDE, OUTSIDE, NEARLY_ALL = about(0.99, 1.01), about(1.1, 1.3), about(0.96, 1.0)


@claim("some-id", section="9.9", lines="99", figure="some-figure")
def some_claim(ev: Evidence) -> None:
    """Something
    holds.
    """
    steady = ev.part("it is steady", RATIO.same)
    ev.part("it is not measured", RATIO.same)
    rare = ev.part("it is rare", RATIO.larger)
    large = ev.part("it is large", RATIO.larger)
    ev("steps", 12345.0)
    steady.headline("a length (m)", INSIDE)
    steady("another length (m)", OUTSIDE)
    rare("share of draws", NEARLY_ALL, nearly_all)
    rare.judge(INSIDE, under=OUTSIDE)
    large("a height (m)", INSIDE)
    large("another height (m)", about(1.0, 1.2))
    ev.headline("a width (m)", OUTSIDE)
    ev.conclude("es hängt ab.", holds="sometimes.", over="3 draws")


def test_evidence_is_what_the_check_adds():
    """Breaks if a number does not judge its part, by its own rule, or loses its name or mark.

    A part that speaks of several scenes does not hold if it fails in one, nor fail if it holds in
    one.
    """
    evidence = some_claim.check()
    assert list(evidence.parts.items()) == [
        ("it is steady", "holds if"),
        ("it is not measured", "open"),
        ("it is rare", "holds if"),
        ("it is large", "fails"),
    ]
    assert (evidence.verdict, evidence.is_conditional) == ("wrong in part", True)
    assert list(evidence.numbers)[:3] == ["steps", "a length (m)", "another length (m)"]
    assert evidence.numbers["share of draws"] == NEARLY_ALL
    assert [len(each.margin_units) for each in evidence.headlines.values()] == [3, 0]
    assert list(evidence.headlines) == ["a length (m)", "a width (m)"]
    assert some_claim.check() is not evidence


def test_record_is_read_as_written(tmp_path):
    """Breaks if a field or a mark is lost on the way, or more is rounded than four digits."""
    told = Measured(1.23456, 1.2, 1.27777, True, (0.12345, 1.0, 2.0))
    evidence = replace(some_claim.check(), numbers={"a length (m)": told, "n": 12345.0})
    write_record(tmp_path / "claims.json", {"some-id": evidence})
    back = read_record(tmp_path / "claims.json")["some-id"]
    assert back == replace(evidence, numbers={"a length (m)": 1.235, "n": 12340.0})
    length = back.numbers["a length (m)"]
    assert (length.low, length.high, length.margin_units) == (1.2, 1.278, (0.1235, 1.0, 2.0))
    assert back.headlines == {"a length (m)": length}
    assert differences(evidence, back) == []


SHARE_OF_DRAWS = Measured(0.5, 0.4, 0.6)
NUMBERS = {"a share": SHARE_OF_DRAWS, "a height": -60.0, "none": 0.0, "steps": 6264.0}
RECORDED = Evidence({"it is so": "holds if"}, "100 % of 6264 steps, by -1.5e-3 m.", NUMBERS)


@pytest.mark.parametrize(
    "change",
    [
        {"parts": {"it is so": "fails"}},
        {"parts": {"it is not": "holds if"}},
        {"because": "of something else."},
        {"holds": "never."},
        {"over": "one draw"},
        {"numbers": NUMBERS | {"a share": 0.5}},
        {"numbers": NUMBERS | {"a share": SHARE_OF_DRAWS.as_headline()}},
        {"numbers": NUMBERS | {"new": 1.0}},
        {"numbers": {"a share": SHARE_OF_DRAWS}},
        {"numbers": NUMBERS | {"a share": Measured(0.504, 0.4, 0.6)}},
        {"numbers": NUMBERS | {"a share": Measured(0.5, 0.41, 0.6)}},
        {"numbers": NUMBERS | {"a height": 60.0}},
        {"numbers": NUMBERS | {"a height": math.nan}},
    ],
)
def test_difference_from_the_record_is_found(change):
    """Breaks if the page could go on saying what is no longer measured."""
    assert differences(replace(RECORDED, **change), RECORDED) != []


def test_last_bits_are_no_difference_from_the_record():
    """Breaks if another machine's rounding, one draw in a thousand, fails the tests."""
    numbers = NUMBERS | {"none": 0.001, "steps": 6260.0}
    other = replace(RECORDED, because="99.9 % of 6260 steps, by +2 m.", numbers=numbers)
    assert differences(RECORDED, RECORDED) == differences(other, RECORDED) == []
