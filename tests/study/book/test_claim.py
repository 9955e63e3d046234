"""Claims, their evidence, and the record of it."""

import math
from dataclasses import replace
from types import ModuleType

import pytest

from d2d.study.book.claim import (
    DECIBELS,
    RATIO,
    SHARE,
    Claim,
    Evidence,
    claim,
    claims_of,
    in_every,
    in_some,
    judge,
    nearly_all,
    shown,
    tells,
)
from d2d.study.book.measured import Measured
from d2d.study.book.record import differences, read_record, write_record


def test_the_verdict_follows_from_the_parts():
    """Breaks if a part that fails is outvoted, or a claim is refuted while one part holds."""
    cases = {
        ("holds", "holds"): "confirmed",
        ("holds", "holds if"): "conditional",
        ("open",): "conditional",
        ("holds", "fails"): "wrong in part",
        ("holds if", "fails"): "wrong in part",
        ("fails", "fails"): "refuted",
    }
    for parts, verdict in cases.items():
        assert judge(parts) == judge(reversed(parts)) == verdict


def test_the_contrary_is_shown_and_not_concluded_from_what_is_not():
    """Breaks if a claim fails because too little was measured."""
    assert shown(holds=False, contrary=False) == "open"
    assert shown(holds=False, contrary=True) == "fails"
    assert shown(holds=False, contrary=True, within=True) == "holds if"
    assert shown(holds=True, contrary=False, within=True) == "holds"


def test_an_effect_is_found_absent_or_left_open():
    """Breaks if the contrary is judged by another bound of the margin, or by the number alone."""
    cases = {  # interval: larger, smaller, the same, no larger
        (1.06, 1.30): ("holds", "fails", "fails", "fails"),
        (1.01, 1.30): ("open", "fails", "open", "open"),
        (0.97, 1.03): ("fails", "fails", "holds", "holds"),
        (0.80, 0.94): ("fails", "holds", "fails", "holds"),
        (0.80, 1.30): ("open", "open", "open", "open"),
    }
    for (low, high), expected in cases.items():
        number = Measured(0.5 * (low + high), low, high)
        rules = (RATIO.larger, RATIO.smaller, RATIO.same, RATIO.no_larger)
        assert tuple(rule(number) for rule in rules) == expected, (low, high)


def test_what_is_said_of_every_draw_fails_if_it_is_false_in_most():
    """Breaks if a claim about all draws is saved by some, or a condition by most of its draws."""
    cases = {(0.96, 1.0): "holds", (0.6, 0.9): "holds if", (0.4, 0.6): "open", (0.1, 0.4): "fails"}
    for (low, high), finding in cases.items():
        share = Measured(0.5 * (low + high), low, high)
        assert nearly_all(share) == finding
        if finding != "holds":
            assert nearly_all(share, under=Measured(0.99, 0.96, 1.0)) == "holds if"
            assert nearly_all(share, under=Measured(0.9, 0.85, 0.94)) == finding
    assert in_some(Measured(0.1, 0.06, 0.2)) == "holds"
    assert in_some(Measured(0.01, 0.0, 0.04)) == "fails"


def test_several_scenes_are_judged_together():
    """Breaks if a claim about several scenes holds although it fails in one, or fails in them all
    although it holds in one.
    """
    assert in_every("holds", "holds") == "holds"
    assert in_every("holds", "fails") == in_every("holds if", "open") == "holds if"
    assert in_every("open", "fails") == in_every("fails", "fails") == "fails"
    assert in_every("open") == "open"
    inside, outside = Measured(1.0, 0.99, 1.01), Measured(1.2, 1.1, 1.3)
    assert RATIO.same(inside, inside) == "holds"
    assert RATIO.same(inside, outside) == "holds if"
    assert RATIO.same(outside, outside) == "fails"


def test_the_axis_of_what_counts_has_the_bound_at_zero():
    """Breaks if the ledger draws a number on the wrong side, or in another unit than the margin."""
    ratio = Measured(1.05**3, 1.05, 1.05**4)
    assert tells(ratio, RATIO.larger).place == pytest.approx((0.0, 2.0, 3.0))
    assert tells(ratio, RATIO.smaller).place == pytest.approx((-5.0, -4.0, -2.0))
    assert tells(ratio, RATIO.no_larger).place == pytest.approx((-3.0, -2.0, 0.0))
    assert tells(Measured(0.2, -0.6, 0.4), DECIBELS.same).place == pytest.approx((-0.2, 0.6, 0.6))
    assert tells(Measured(0.9, 0.85, 0.95), nearly_all).place == pytest.approx((-2.0, -1.0, 0.0))
    assert tells(Measured(0.1, 0.05, 0.2), SHARE.larger).place == pytest.approx((0.0, 1.0, 3.0))
    assert tells(ratio).place == ()


PARTS = {"it is so": "holds if"}


def module_with(*claims: Claim) -> ModuleType:
    """A module that defines these claims, among other things."""
    module = ModuleType("some_claims")
    module.THRESHOLD = 0.5
    for number, each in enumerate(claims):
        setattr(module, f"check_{number}", each)
    return module


def some_claim(id: str) -> Claim:
    """A claim whose check always finds the same."""

    @claim(id, section="9.9", lines="99", figure="some-figure")
    def check() -> Evidence:
        """Something
        holds.
        """
        return Evidence(PARTS, "it depends.", {"a length (m)": 1.23456, "a share": 1.0})

    return check


def test_the_docstring_of_a_check_is_the_claim():
    """Breaks if line breaks of the source end up in the ledger."""
    assert some_claim("some-id").text == "Something holds."


def test_the_claims_of_modules_are_found_in_their_order():
    """Breaks if a claim is lost, or the ledger sorts them."""
    first, second, third = map(some_claim, ("b", "c", "a"))
    found = claims_of([module_with(first, second), module_with(third, first)])
    assert list(found) == ["b", "c", "a"]
    assert found["c"] is second


def test_a_record_is_read_as_it_was_written(tmp_path):
    """Breaks if a field or a mark is lost on the way, or more is rounded than four digits."""
    told = Measured(1.23456, 1.2, 1.27777, True, (0.12345, 1.0, 2.0))
    numbers = {"a length (m)": told, "n": 12345.0}
    evidence = Evidence(PARTS, "es hängt ab.", numbers, "sometimes.", "3 draws")
    write_record(tmp_path / "claims.json", {"some-id": evidence})
    back = read_record(tmp_path / "claims.json")["some-id"]
    assert back == replace(evidence, numbers={"a length (m)": 1.235, "n": 12340.0})
    length = back.numbers["a length (m)"]
    assert (length.low, length.high, length.place) == (1.2, 1.278, (0.1235, 1.0, 2.0))
    assert back.telling == {"a length (m)": length}
    assert differences(evidence, back) == []


def test_a_difference_from_the_record_is_found():
    """Breaks if the page could go on saying what is no longer measured."""
    share = Measured(0.5, 0.4, 0.6)
    numbers = {"a share": share, "a height": -60.0}
    evidence = Evidence(PARTS, "it depends.", numbers)
    assert differences(evidence, evidence) == []
    for change in (
        {"parts": {"it is so": "fails"}},
        {"parts": {"it is not": "holds if"}},
        {"because": "of something else."},
        {"holds": "never."},
        {"over": "one draw"},
        {"numbers": numbers | {"a share": 0.5}},
        {"numbers": numbers | {"a share": tells(share)}},
        {"numbers": numbers | {"new": 1.0}},
        {"numbers": {"a share": share}},
        {"numbers": numbers | {"a share": Measured(0.504, 0.4, 0.6)}},
        {"numbers": numbers | {"a share": Measured(0.5, 0.41, 0.6)}},
        {"numbers": numbers | {"a height": 60.0}},
        {"numbers": numbers | {"a height": math.nan}},
    ):
        assert differences(replace(evidence, **change), evidence) != [], change


def test_last_bits_are_no_difference_from_the_record():
    """Breaks if another machine's rounding, one draw in a thousand, fails the tests."""
    numbers = {"a share": 1.0, "none": 0.0, "steps": 6264.0}
    evidence = Evidence(PARTS, "100 % of 6264 steps, by -1.5e-3 m.", numbers)
    numbers = {"a share": 0.999, "none": 0.001, "steps": 6260.0}
    other = replace(evidence, because="99.9 % of 6260 steps, by +2 m.", numbers=numbers)
    assert differences(other, evidence) == []
