"""Claims, their evidence, and the record of it."""

import math
from dataclasses import replace
from types import ModuleType

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
    claims_of,
    decide,
    in_every,
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


def test_contrary_must_be_shown():
    """Breaks if a claim fails because too little was measured."""
    assert decide(supported=False, opposed=False) == "open"
    assert decide(supported=False, opposed=True) == "fails"
    assert decide(supported=False, opposed=True, conditional=True) == "holds if"
    assert decide(supported=True, opposed=False, conditional=True) == "holds"


def test_margins_are_the_smallest_effects_that_count():
    """Breaks if one changes: 5 % of an RMSE, 12 % of a covariance, one draw in twenty."""
    assert (RATIO.low, RATIO.high) == pytest.approx((1 / 1.05, 1.05))
    assert np.hypot(1.0, MEAN.high) == pytest.approx(RATIO.high, abs=1e-3)
    assert DECIBELS == (-0.5, 0.5)
    assert 10.0 * np.log10(ANEES) == pytest.approx(DECIBELS)
    assert SHARE == (-0.05, 0.05)


@pytest.mark.parametrize(
    ("interval", "larger", "smaller", "same", "no_larger"),
    [
        ((1.06, 1.30), "holds", "fails", "fails", "fails"),
        ((1.01, 1.30), "open", "fails", "open", "open"),
        ((0.97, 1.03), "fails", "fails", "holds", "holds"),
        ((0.80, 0.94), "fails", "holds", "fails", "holds"),
        ((0.80, 1.30), "open", "open", "open", "open"),
    ],
)
def test_effect_is_found_absent_or_left_open(interval, larger, smaller, same, no_larger):
    """Breaks if the contrary is judged by another bound of the margin, or by the number alone."""
    number = about(*interval)
    assert RATIO.larger(number) == larger
    assert RATIO.smaller(number) == smaller
    assert RATIO.same(number) == same
    assert RATIO.no_larger(number) == no_larger


@pytest.mark.parametrize(
    ("interval", "finding"),
    [((0.96, 1.0), "holds"), ((0.6, 0.9), "holds if"), ((0.4, 0.6), "open"), ((0.1, 0.4), "fails")],
)
def test_claim_of_every_draw_fails_if_false_in_most(interval, finding):
    """Breaks if a claim about all draws is saved by some, or a condition by most of its draws."""
    share, met, hardly_met = about(*interval), about(0.96, 1.0), about(0.85, 0.94)
    assert nearly_all(share) == nearly_all(share, under=hardly_met) == finding
    assert nearly_all(share, under=met) == ("holds" if finding == "holds" else "holds if")
    assert in_some(about(0.06, 0.2)) == "holds"
    assert in_some(about(0.0, 0.04)) == "fails"


def test_several_scenes_are_judged_together():
    """Breaks if a claim about several scenes holds although it fails in one, or fails in them all
    although it holds in one.
    """
    assert in_every("holds", "holds") == "holds"
    assert in_every("holds", "fails") == in_every("holds if", "open") == "holds if"
    assert in_every("open", "fails") == in_every("fails", "fails") == "fails"
    assert in_every("open") == "open"


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


INSIDE, OUTSIDE = about(0.99, 1.01), about(1.1, 1.3)


@claim("some-id", section="9.9", lines="99", figure="some-figure")
def some_claim(ev: Evidence) -> None:
    """Something
    holds.
    """
    steady = ev.part("it is steady", RATIO.same)
    ev.part("it is not measured", RATIO.same)
    rare = ev.part("it is rare", RATIO.larger)
    rare.judge(INSIDE, under=OUTSIDE)
    ev("steps", 12345.0)
    steady.headline("a length (m)", INSIDE)
    steady("another length (m)", OUTSIDE)
    rare("share of draws", about(0.96, 1.0), nearly_all)
    ev.headline("a width (m)", OUTSIDE)
    ev.conclude("es hängt ab.", holds="sometimes.", over="3 draws")


def test_evidence_is_what_the_check_adds():
    """Breaks if a number does not judge its part, by its own rule, or loses its name or mark."""
    evidence = some_claim.check()
    assert list(evidence.parts.items()) == [
        ("it is steady", "holds if"),  # in one of two
        ("it is not measured", "open"),
        ("it is rare", "holds if"),
    ]
    assert evidence.verdict == "conditional"
    assert evidence.is_conditional
    assert evidence.numbers == {
        "steps": 12345.0,
        "a length (m)": INSIDE,
        "another length (m)": OUTSIDE,
        "share of draws": 0.98,
        "a width (m)": OUTSIDE,
    }
    assert [len(each.margin_units) for each in evidence.headlines.values()] == [3, 0]
    assert list(evidence.headlines) == ["a length (m)", "a width (m)"]
    assert some_claim.check() is not evidence


def test_claims_of_modules_keep_their_order():
    """Breaks if a claim is lost, the ledger sorts them, or line breaks of the source are kept."""
    first, second, third = (replace(some_claim, id=id) for id in "bca")
    modules = ModuleType("one"), ModuleType("other")
    modules[0].THRESHOLD, modules[0].check, modules[0].other = 0.5, first, second
    modules[1].check, modules[1].again = third, first
    assert list(claims_of(modules).values()) == [first, second, third]
    assert some_claim.text == "Something holds."


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
