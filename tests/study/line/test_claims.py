"""What is computed once of a scene on a line is not kept for another."""

from d2d.study.claims import CLAIMS
from d2d.study.line.claims import surfaces
from d2d.study.line.scene import line_scene


def other_scene(**options):
    """line_scene with some of its parameters overridden."""
    return lambda rng, **given: line_scene(rng, **{**given, **options})


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
