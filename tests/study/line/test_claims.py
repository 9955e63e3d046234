"""A check of the surfaces on a line must be able to come out otherwise."""

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


SURFACE_CLAIMS = [claim for claim in CLAIMS.values() if claim.section in ("4.2", "4.3")]


def test_surfaces_of_another_scene_are_not_mistaken_for_those_of_this_one(monkeypatch):
    """Breaks if what is computed once is kept when the scene is another, or a sentence is."""
    monkeypatch.setattr(surfaces, "DRAWS", 50)
    evidence = [claim.check() for claim in SURFACE_CLAIMS]
    monkeypatch.setattr(surfaces, "line_scene", other_scene(sigma_moving=0.5, sigma_fixed=0.4))
    for claim, before in zip(SURFACE_CLAIMS, evidence, strict=True):
        after = claim.check()
        assert after.numbers != before.numbers
        assert after.because != before.because
