"""Claims, their evidence, and the record of it."""

import math
from dataclasses import replace
from types import ModuleType

import pytest

from d2d.study.book.claim import (
    DECIBELS,
    RATIO,
    Claim,
    Evidence,
    claim,
    claims_of,
    hardly_any,
    judge,
    larger,
    most,
    nearly_all,
    same,
    smaller,
    some,
)
from d2d.study.book.measured import Measured, telling
from d2d.study.book.record import differences, read_record, write_record


def test_the_first_condition_that_is_met_is_the_verdict():
    """Breaks if a claim that is confirmed is told as qualified, or the other way round."""
    assert judge(confirmed=True, qualified=False) == "confirmed"
    assert judge(confirmed=False, qualified=True) == "qualified"
    assert judge(confirmed=False) == judge(confirmed=False, qualified=False) == "refuted"


def test_an_interval_is_beyond_a_margin_within_it_or_says_nothing():
    """Breaks if a small but certain effect counts, or a wide interval shows equality."""
    cases = {
        (1.06, 1.30): {larger},
        (1.01, 1.30): set(),  # surely larger than one, but perhaps not by enough
        (0.97, 1.03): {same},
        (0.97, 1.06): set(),
        (0.80, 0.94): {smaller},
    }
    for (low, high), expected in cases.items():
        number = Measured(0.5 * (low + high), low, high)
        assert {rule for rule in (larger, same, smaller) if rule(number, RATIO)} == expected


def test_margins_of_decibels_are_the_same_to_either_side():
    """Breaks if a bound changes its sign."""
    assert same(Measured(0.0, -0.4, 0.4), DECIBELS)
    assert larger(Measured(1.0, 0.6, 1.4), DECIBELS)
    assert smaller(Measured(-1.0, -1.4, -0.6), DECIBELS)


def test_shares_have_words():
    """Breaks if a verdict looks at the share itself and not at its interval."""
    cases = {
        (0.96, 1.00): {nearly_all, most, some},
        (0.90, 1.00): {most, some},
        (0.40, 0.60): {some},
        (0.02, 0.08): set(),
        (0.00, 0.04): {hardly_any},
    }
    for (low, high), expected in cases.items():
        share = Measured(0.5 * (low + high), low, high)
        assert {rule for rule in (nearly_all, most, some, hardly_any) if rule(share)} == expected


def module_with(*claims: Claim) -> ModuleType:
    """A module that defines these claims, among other things."""
    module = ModuleType("some_claims")
    module.THRESHOLD = 0.5
    for number, each in enumerate(claims):
        setattr(module, f"check_{number}", each)
    return module


def some_claim(id: str) -> Claim:
    """A claim whose check always finds the same."""

    @claim(id, section="9.9", figure="some-figure")
    def check() -> Evidence:
        """Something
        holds.
        """
        return Evidence("qualified", "it depends.", {"a length (m)": 1.23456, "a share": 1.0})

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


def test_two_claims_of_one_id_are_refused():
    """Breaks if the registry keeps the last of them."""
    with pytest.raises(ValueError, match=r"^two claims have the id 'a'"):
        claims_of([module_with(some_claim("a")), module_with(some_claim("a"))])


def test_a_record_is_read_as_it_was_written(tmp_path):
    """Breaks if a field or a mark is lost on the way, or more is rounded than four digits."""
    numbers = {"a length (m)": telling(Measured(1.23456, 1.2, 1.27777)), "n": 12345.0}
    evidence = Evidence("qualified", "es hängt ab.", numbers, "sometimes.", "3 draws")
    write_record(tmp_path / "claims.json", {"some-id": evidence})
    back = read_record(tmp_path / "claims.json")["some-id"]
    assert back == replace(evidence, numbers={"a length (m)": 1.235, "n": 12340.0})
    length = back.numbers["a length (m)"]
    assert (length.low, length.high) == (1.2, 1.278)
    assert back.telling == {"a length (m)": length}
    assert differences(evidence, back) == []


def test_a_difference_from_the_record_is_found():
    """Breaks if the page could go on saying what is no longer measured."""
    share = Measured(0.5, 0.4, 0.6)
    numbers = {"a share": share, "a height": -60.0}
    evidence = Evidence("qualified", "it depends.", numbers)
    assert differences(evidence, evidence) == []
    for change in (
        {"verdict": "refuted"},
        {"because": "of something else."},
        {"holds": "never."},
        {"over": "one draw"},
        {"numbers": numbers | {"a share": 0.5}},
        {"numbers": numbers | {"a share": telling(share)}},
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
    evidence = Evidence("confirmed", "100 % of 6264 steps, by -1.5e-3 m.", numbers)
    numbers = {"a share": 0.999, "none": 0.001, "steps": 6260.0}
    other = replace(evidence, because="99.9 % of 6260 steps, by +2 m.", numbers=numbers)
    assert differences(other, evidence) == []
