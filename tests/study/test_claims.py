"""The ledger of claims: the record says what the checks find."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from d2d.study import CLAIMS
from d2d.study.book.measured import Measured
from d2d.study.book.record import differences, read_record
from d2d.study.line.claims import surfaces

CHAPTERS = Path(__file__).resolve().parents[2] / "chapters"
RECORD = read_record()
EXACT = re.compile(r"^area of|bound of the 95 % region$")  # values of formulas; counts are whole

# Every claim of the thesis, by its section.
THESIS = {
    "2.3": {"gmm-better", "em-monotone"},
    "3.1": {"icp-feeble"},
    "3.2": {"ndt-registers"},
    "4.2": {"b-three-peaks", "d2d-lower", "equal-sigma-same", "noisy-p2d-fails"},
    "4.3": {"summing-local-peaks", "likelihood-one-peak", "summing-smoother"},
    "4.4": {
        "outlier-fixed-summing",
        "outlier-fixed-likelihood",
        "outlier-moving-summing",
        "outlier-moving-likelihood",
        "uniform-restores",
        "uniform-not-a-density",
        "corrupted-restores",
        "outlier-parameters-crucial",
    },
    "4.5": {"tight-cluster-certain", "loose-cluster-summing", "loose-cluster-likelihood"},
    "5.1": {"second-order-faster"},
    "5.2": {"fisher-suffices", "summing-not-gaussian"},
    "6.3": {
        "overlap-local-minima",
        "overlap-error",
        "overlap-initial-guess",
        "overlap-summing-pessimistic",
        "overlap-likelihood-credible",
        "overlap-outlier-component",
        "outlier-likelihood-vanishes",
        "outlier-robust-minimum",
        "outlier-error",
        "outlier-credibility",
        "cluster-summing-wrong",
        "cluster-likelihood-same",
        "cluster-error",
        "all-likelihood-stable",
        "all-summing-unstable",
    },
    "6.4": {"nci-not-enough"},
    "7.1": {"doppler-rejects-moving"},
    "7.3": {
        "doppler-reduces-error",
        "doppler-more-certain",
        "trajectory-drifts",
        "annealing-no-gain",
    },
}


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


def test_no_claim_of_the_thesis_is_lost():
    """Breaks if a claim is dropped, renamed, or filed under another section."""
    for section, ids in THESIS.items():
        assert ids <= {claim.id for claim in CLAIMS.values() if claim.section == section}


def test_the_record_has_every_claim_and_no_other():
    """Breaks if a claim is added, renamed or dropped and the evidence not recorded anew."""
    assert list(RECORD) == list(CLAIMS)


def test_a_claim_is_filled_in():
    """Breaks if a row of the ledger has a hole."""
    chapters = [path.read_text(encoding="utf-8") for path in CHAPTERS.glob("*.ipynb")]
    figures = set(re.findall(r"\bfig-([a-z0-9-]+)", "".join(chapters)))
    for id, claim in CLAIMS.items():
        evidence = RECORD[id]
        assert claim.text.endswith("."), id
        assert claim.figure in figures, id
        assert 1 <= len(evidence.telling) <= 2, id
        for name, number in evidence.numbers.items():
            if isinstance(number, Measured):
                assert number.low <= number <= number.high, (id, name)
            else:
                assert number == round(number) or EXACT.search(name), f"no interval: {id}, {name}"
        assert re.search(r"draws|drives|rooms|sets", evidence.over), f"over what? {id}"
        assert evidence.holds or evidence.verdict == "confirmed", f"when does it hold? {id}"


def test_a_check_repeats_exactly_and_leaves_random_states_alone(monkeypatch):
    """Breaks if a check draws from a global or fresh state."""
    monkeypatch.setattr(surfaces, "DRAWS", 50)
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    first = CLAIMS["likelihood-one-peak"].check()
    surfaces.surfaces_of_scene.cache_clear()
    again = CLAIMS["likelihood-one-peak"].check()
    assert first == again
    assert (np.random.get_state()[1] == before).all()  # noqa: NPY002
