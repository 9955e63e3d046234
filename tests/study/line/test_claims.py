"""A check of the surfaces on a line must be able to come out otherwise."""

import numpy as np
import pytest

from d2d.study.claims import CLAIMS
from d2d.study.line.claims import surfaces
from d2d.study.line.scene import line_scene

P2D, D2D, LIKELIHOOD = surfaces.P2D, surfaces.D2D, surfaces.LIKELIHOOD


def other_scene(**options):
    """line_scene with some of its parameters overridden."""
    return lambda rng, **given: line_scene(rng, **{**given, **options})


@pytest.mark.parametrize(
    ("claim", "world", "verdict"),
    [
        # the two metrics are the same
        ("equal-sigma-same", {"P2D": D2D}, "confirmed"),
        # so noisy that most draws have several peaks, and some have one
        ("summing-local-peaks", {"line_scene": other_scene(sigma_moving=0.8)}, "conditional"),
        # no noise to speak of, so that P2D does not fail
        ("noisy-p2d-fails", {"NOISE_RATIO": 0.25}, "wrong in part"),
        ("summing-local-peaks", {"TRUTH": 4.0}, "wrong in part"),
    ],
)
def test_a_surface_claim_is_judged_otherwise_in_another_world(monkeypatch, claim, world, verdict):
    """Breaks if a verdict is a constant, or numbers are not looked at."""
    monkeypatch.setattr(surfaces, "DRAWS", 200)
    for name, value in world.items():
        monkeypatch.setattr(surfaces, name, value)
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
    monkeypatch.setattr(surfaces, "DRAWS", 50)
    for name, value in world.items():
        monkeypatch.setattr(surfaces, name, value)
    assert CLAIMS[claim].check().verdict != "confirmed"


SURFACE_CLAIMS = [claim for claim in CLAIMS.values() if claim.section in ("4.2", "4.3")]


def test_a_surface_check_repeats_exactly_when_its_surfaces_are_computed_anew(monkeypatch):
    """Breaks if a check draws from a fresh or global state, or changes the surfaces it shares."""
    monkeypatch.setattr(surfaces, "DRAWS", 50)
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    for claim in SURFACE_CLAIMS:
        surfaces.surfaces_of_scene.cache_clear()
        first, shared = claim.check(), claim.check()
        surfaces.surfaces_of_scene.cache_clear()
        assert claim.check() == first == shared
    assert (np.random.get_state()[1] == before).all()  # noqa: NPY002


def test_surfaces_of_another_scene_are_not_mistaken_for_those_of_this_one(monkeypatch):
    """Breaks if what is computed once is kept when the scene is another, or a sentence is."""
    monkeypatch.setattr(surfaces, "DRAWS", 50)
    evidence = [claim.check() for claim in SURFACE_CLAIMS]
    monkeypatch.setattr(surfaces, "line_scene", other_scene(sigma_moving=0.5, sigma_fixed=0.4))
    for claim, before in zip(SURFACE_CLAIMS, evidence, strict=True):
        after = claim.check()
        assert after.numbers != before.numbers
        assert after.because != before.because
