"""The ledger of claims: every verdict on record is what its check finds, and could be another."""

from __future__ import annotations

import importlib
import math
import pkgutil
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import d2d.study.claims as ledger
from d2d import RegistrationCost
from d2d.radar import track
from d2d.study.claims import (
    CLAIMS,
    Claim,
    Evidence,
    cost_surfaces,
    credibility,
    estimation,
    radar,
    record,
    show,
)
from d2d.study.claims.record import differences
from d2d.study.line_scene import line_scene
from d2d.study.optima import Minima

CHAPTERS = Path(__file__).resolve().parents[1] / "chapters"
RECORD = record.read(CHAPTERS / "results" / "claims.json")
FIGURES = {
    name
    for chapter in CHAPTERS.glob("*.ipynb")
    for name in re.findall(r"\bfig-([a-z0-9-]+)", chapter.read_text(encoding="utf-8"))
}

# Every claim of the thesis, by its section.
EXPECTED = {
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
def test_the_check_finds_the_verdict_on_record(claim):
    """Breaks if the numbers change so much that the claim must be judged, or told, anew."""
    evidence = claim.check()
    assert evidence.verdict == claim.verdict, str(evidence)
    assert differences(evidence, RECORD[claim.id]) == []
    assert evidence.numbers
    for name, value in evidence.numbers.items():
        assert math.isfinite(value), name
        assert isinstance(value, (int, float)), name
    assert evidence.because.strip()


@pytest.mark.parametrize("section", EXPECTED)
def test_the_claims_of_a_section_are_registered(section):
    """Breaks if a claim is dropped, renamed, added unlisted, or filed under another section."""
    found = {claim.id for claim in CLAIMS.values() if claim.section == section}
    assert found == EXPECTED[section]


def test_no_other_section_has_claims():
    """Breaks if a claim is filed under a section that the list does not know."""
    assert {claim.section for claim in CLAIMS.values()} == set(EXPECTED)


def test_every_module_of_claims_is_registered_without_loss():
    """Breaks if two claims share an id, of which the registry would keep the last."""
    listed = []
    for module in pkgutil.iter_modules(ledger.__path__, f"{ledger.__name__}."):
        own = getattr(importlib.import_module(module.name), "CLAIMS", ())
        listed += own if isinstance(own, tuple) else ()  # the record imports the whole registry
    ids = [claim.id for claim in listed]
    assert len(ids) == len(set(ids))
    assert set(ids) == set(CLAIMS)
    assert all(CLAIMS[claim.id] is claim for claim in listed)


@pytest.mark.parametrize("claim", CLAIMS.values(), ids=CLAIMS.keys())
def test_a_claim_is_filled_in(claim):
    """Breaks if a row of the ledger has a hole."""
    assert claim.claim.endswith(".")
    assert claim.section[0].isdigit()
    assert claim.verdict in ("confirmed", "qualified", "refuted")
    assert claim.id == claim.id.lower().strip()
    assert claim.telling
    assert claim.figure in FIGURES
    assert bool(claim.holds) == (claim.verdict != "confirmed"), "when does it hold?"


def test_a_check_repeats_exactly_and_leaves_random_states_alone(monkeypatch):
    """Breaks if a check draws from a global or fresh state."""
    monkeypatch.setattr(cost_surfaces, "DRAWS", 50)
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    first, again = (CLAIMS["likelihood-one-peak"].check() for _ in range(2))
    assert first == again
    assert (np.random.get_state()[1] == before).all()  # noqa: NPY002


def test_the_record_has_every_claim_and_no_other():
    """Breaks if a claim is added, renamed or dropped and the evidence not recorded anew."""
    assert set(RECORD) == set(CLAIMS)


@pytest.mark.parametrize("claim", CLAIMS.values(), ids=CLAIMS.keys())
def test_the_telling_numbers_are_on_record(claim):
    """Breaks if a check's number is renamed and the ledger would look for the old name."""
    assert set(claim.telling) <= RECORD[claim.id].numbers.keys()


def test_a_record_is_read_as_it_was_written(tmp_path):
    """Breaks if a field is lost on the way, or more is rounded than four digits."""
    evidence = Evidence("qualified", "es hängt ab.", {"a length (m)": 1.23456, "n": 12345.0})
    record.write(tmp_path / "claims.json", {"some-id": evidence})
    back = record.read(tmp_path / "claims.json")["some-id"]
    assert back == replace(evidence, numbers={"a length (m)": 1.235, "n": 12340.0})
    assert differences(evidence, back) == []


@pytest.mark.parametrize(
    "change",
    [
        {"verdict": "refuted"},
        {"because": "of something else."},
        {"numbers": {"a share": 0.5, "a height": -60.0, "new": 1.0}},
        {"numbers": {"a share": 0.5}},
        {"numbers": {"a share": 0.53, "a height": -60.0}},
        {"numbers": {"a share": 0.5, "a height": 60.0}},
        {"numbers": {"a share": math.nan, "a height": -60.0}},
    ],
)
def test_a_difference_from_the_record_is_found(change):
    """Breaks if the page could go on telling what is no longer measured."""
    evidence = Evidence("qualified", "it depends.", {"a share": 0.5, "a height": -60.0})
    assert differences(replace(evidence, **change), evidence) != []


def test_last_bits_are_no_difference_from_the_record():
    """Breaks if another machine's rounding, one draw in a thousand, fails the tests."""
    evidence = Evidence("confirmed", "it is so.", {"a share": 1.0, "none": 0.0, "steps": 6264.0})
    other = replace(evidence, numbers={"a share": 0.999, "none": 0.001, "steps": 6260.0})
    assert differences(other, evidence) == []


def test_show_prints_claim_verdict_and_numbers(capsys):
    """Breaks if a chapter's last cell does not print what was measured."""
    evidence = Evidence("qualified", "it depends.", {"a length (m)": 1.23456, "a share": 1.0})
    show(Claim("some-id", "9.9", "Something holds.", lambda: evidence, "qualified"))
    assert capsys.readouterr().out == (
        "[some-id] Something holds. (thesis 9.9)\n"
        "qualified: it depends.\n  a length (m): 1.23\n  a share: 1\n\n"
    )


# ---- a check must be able to come out otherwise

P2D, D2D, LIKELIHOOD = cost_surfaces.P2D, cost_surfaces.D2D, cost_surfaces.LIKELIHOOD


def other_scene(**options):
    """line_scene with some of its parameters overridden."""
    return lambda rng, **given: line_scene(rng, **{**given, **options})


@pytest.mark.parametrize(
    ("claim", "world", "verdict"),
    [
        # other targets, other peaks
        ("b-three-peaks", {"line_scene": other_scene(positions=[0, 8, 9.0])}, "refuted"),
        ("b-three-peaks", {"line_scene": other_scene(positions=[0, 8, 8.1])}, "refuted"),
        # the two metrics change places, or are the same
        ("d2d-lower", {"P2D": D2D, "D2D": P2D}, "refuted"),
        ("equal-sigma-same", {"P2D": D2D}, "confirmed"),
        ("equal-sigma-same", {"line_scene": other_scene(sigma_moving=3.0)}, "refuted"),
        ("equal-sigma-same", {"TRUTH": 4.0}, "refuted"),
        # no noise to speak of, so that nothing fails
        ("noisy-p2d-fails", {"NOISE_RATIO": 0.25}, "refuted"),
        ("likelihood-one-peak", {"LIKELIHOOD": D2D}, "refuted"),
        ("summing-local-peaks", {"line_scene": other_scene(sigma_moving=0.8)}, "qualified"),
    ],
)
def test_a_surface_claim_is_judged_otherwise_in_another_world(monkeypatch, claim, world, verdict):
    """Breaks if a verdict is a constant, or numbers are not looked at."""
    monkeypatch.setattr(cost_surfaces, "DRAWS", 200)
    for name, value in world.items():
        monkeypatch.setattr(cost_surfaces, name, value)
    evidence = CLAIMS[claim].check()
    assert evidence.verdict == verdict, str(evidence)


@pytest.mark.parametrize(
    ("claim", "world"),
    [
        # targets so blurred that some draws have a single peak
        ("summing-local-peaks", {"line_scene": other_scene(sigma_moving=3.0)}),
        ("summing-local-peaks", {"D2D": LIKELIHOOD}),
        # no draw has three peaks
        ("b-three-peaks", {"line_scene": other_scene(positions=[0.0, 8.0])}),
    ],
)
def test_a_surface_claim_that_fails_altogether_is_judged_and_not_a_crash(monkeypatch, claim, world):
    """Breaks if the check takes for granted what it is to find out (a second, a third peak)."""
    monkeypatch.setattr(cost_surfaces, "DRAWS", 50)
    for name, value in world.items():
        monkeypatch.setattr(cost_surfaces, name, value)
    assert CLAIMS[claim].check().verdict != "confirmed"


def test_the_cluster_claim_is_confirmed_where_the_lowest_minimum_is_elsewhere(monkeypatch):
    """Breaks if the verdict rests on descents from the truth, which cannot see another minimum."""
    elsewhere = Minima(np.array([[8.0, 0.0, 0.0], np.zeros(3)]), np.array([0.0, -1.0]))
    monkeypatch.setattr(credibility, "local_minima", lambda *given, draws=5: (elsewhere,) * draws)
    evidence = CLAIMS["cluster-summing-wrong"].check()
    assert evidence.verdict == "confirmed", str(evidence)
    rival = "greatest density of another optimum over that at the truth, this scene"
    assert evidence.numbers[rival] == pytest.approx(np.e)


def test_sums_of_many_equal_targets_approach_the_limits_of_chapter_5():
    """Breaks if the simulated sum is not at its optimum, or a covariance is another one."""
    sums = estimation.equal_targets(128, runs=3000)
    assert sums.actual == pytest.approx(16 / 9, rel=0.06)  # a variance of 6000 values: 2 %
    assert sums.fisher == pytest.approx(2 * 128, rel=0.02)
    assert sums.propagated == pytest.approx(112 / 27, rel=0.03)


@pytest.fixture
def short_drives(monkeypatch):
    """Radar claims on three short drives, without the memory of earlier checks."""
    monkeypatch.setattr(radar, "DRIVES", 3)
    monkeypatch.setattr(radar, "DURATION", 4.0)
    radar._drives.cache_clear()
    yield monkeypatch
    radar._drives.cache_clear()


def without_doppler(scans, mounting, *, doppler):
    """A track that never looks at the Doppler velocities."""
    return track(scans, mounting, doppler=False)


def useless_doppler(scans, mounting, *, doppler):
    """A track that is better without."""
    return track(scans, mounting, doppler=not doppler)


@pytest.mark.parametrize("claim", ["doppler-reduces-error", "doppler-more-certain"])
@pytest.mark.parametrize("tracker", [without_doppler, useless_doppler])
def test_a_doppler_claim_is_refuted_where_doppler_does_not_help(short_drives, claim, tracker):
    """Breaks if the drives with and without are not compared."""
    short_drives.setattr(radar, "track", tracker)
    assert CLAIMS[claim].check().verdict == "refuted"


def test_drift_is_refuted_where_the_path_is_known(short_drives):
    """Breaks if the verdict does not come from the position errors."""
    truths = []
    simulate = radar.simulate_drive

    def remember(*arguments):
        truths.append(simulate(*arguments))
        return truths[-1]

    def knowing(scans, mounting, *, doppler):
        driven = track(scans[:3], mounting)
        fields = {
            name: getattr(driven, name) for name in ("times", "theta", "covariance", "converged")
        }
        fields["theta"] = truths[-1].truth.theta[1:3]
        return SimpleNamespace(**fields, poses=lambda start: truths[-1].truth.poses)

    short_drives.setattr(radar, "simulate_drive", remember)
    short_drives.setattr(radar, "track", knowing)
    short_drives.setattr(radar, "DriveErrors", SimpleNamespace(of=lambda driven, truth: None))
    assert CLAIMS["trajectory-drifts"].check().verdict == "refuted"


def test_costs_of_the_claims_are_those_they_are_named_after():
    """Breaks if the other-world tests above swap something else."""
    assert RegistrationCost("p2d", "summing") == P2D
    assert RegistrationCost("d2d", "summing") == D2D
    assert RegistrationCost("d2d", "likelihood") == LIKELIHOOD
