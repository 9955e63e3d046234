"""The ledger of claims: the record says what the checks find."""

import math
import re
from pathlib import Path

import pytest

from d2d.study import CLAIMS
from d2d.study.book.measured import Measured
from d2d.study.book.record import differences, read_record

CHAPTERS = Path(__file__).resolve().parents[2] / "chapters"
RECORD = read_record()
EXACT = re.compile(r"^area of|bound of the 95 % region$")  # values of formulas; counts are whole


@pytest.mark.parametrize("claim", CLAIMS.values(), ids=CLAIMS.keys())
def test_the_check_finds_what_is_on_record(claim):
    """Breaks if a number changes so much that the claim must be told, or judged, anew."""
    evidence = claim.check()
    assert differences(evidence, RECORD[claim.id]) == []
    assert evidence.numbers
    for name, value in evidence.numbers.items():
        assert math.isfinite(value), name
        assert isinstance(value, (int, float)), name
    assert evidence.because.strip()


def test_the_record_has_every_claim_and_no_other():
    """Breaks if a claim is lost or renamed, or is added and its evidence not recorded."""
    assert list(RECORD) == list(CLAIMS)


def test_a_claim_is_filled_in():
    """Breaks if a row has a hole, or a headline that speaks against a confirmed claim."""
    chapters = [path.read_text(encoding="utf-8") for path in CHAPTERS.glob("*.ipynb")]
    figures = set(re.findall(r"\bfig-([a-z0-9-]+)", "".join(chapters)))
    for id, claim in CLAIMS.items():
        evidence = RECORD[id]
        assert re.fullmatch(r"[^\n]*\.", claim.text), id
        assert re.fullmatch(r"\d+([,–] ?\d+)*", claim.lines), id
        assert claim.figure in figures, id
        assert 1 <= len(evidence.headlines) <= 2, id
        places = [place for each in evidence.headlines.values() for place in each.margin_units]
        assert evidence.verdict != "confirmed" or min(places, default=1.0) > 0.0, id
        for name, number in evidence.numbers.items():
            if isinstance(number, Measured):
                assert number.low <= number <= number.high, (id, name)
            else:
                assert number == round(number) or EXACT.search(name), f"no interval: {id}, {name}"
        assert re.search(r"draws|drives|rooms|sets", evidence.over), f"over what? {id}"
        assert evidence.holds or not evidence.is_conditional, f"when does it hold? {id}"
