"""A check of the simulated drives must be able to come out otherwise."""

from types import SimpleNamespace

import numpy as np
import pytest

from d2d.study.claims import CLAIMS
from d2d.study.drives import claims as drives
from d2d.study.drives import variations
from d2d.study.drives.variations import followed


@pytest.fixture
def short_drives(monkeypatch):
    """Three drives of two seconds, without the memory of other checks."""
    monkeypatch.setattr(drives, "DRIVES", 3)
    monkeypatch.setattr(drives, "DURATION", 2.0)
    forget()
    yield monkeypatch
    forget()


def forget():
    """Forget the drives of other checks."""
    drives.tracked_drive.cache_clear()


def weights(without: float, with_doppler: float):
    """In the place of `TargetWeights`: about so much of every kind is rejected."""
    rng = np.random.default_rng(0)

    def of(drive, driven, *, doppler):
        share = (with_doppler if doppler else without) + rng.uniform(-0.005, 0.005)
        return SimpleNamespace(
            kind=np.repeat(["moving", "wall"], 400), rejected=lambda chosen: share
        )

    return SimpleNamespace(of=of)


def walkers(across: float):
    """In the place of `walkers_by_pair`: along the line of sight all are rejected."""
    rejected = np.array([np.ones(20), np.arange(20) < round(20 * across)]) > 0.0
    return lambda *_: [rejected] * 100


@pytest.mark.parametrize(
    ("without", "with_doppler", "across", "verdict"),
    [
        (0.3, 0.99, 1.0, "confirmed"),
        (0.3, 0.99, 0.1, "conditional"),
        (0.99, 0.99, 1.0, "wrong in part"),
    ],
)
def test_moving_targets_are_judged_by_what_is_rejected(
    short_drives, without, with_doppler, across, verdict
):
    """Breaks if the verdict looks at one of the three shares only."""
    short_drives.setattr(drives, "TargetWeights", weights(without, with_doppler))
    short_drives.setattr(drives, "walkers_by_pair", walkers(across))
    assert CLAIMS["doppler-rejects-moving"].check().verdict == verdict


def test_a_drive_that_meets_nobody_is_left_out(short_drives):
    """Breaks if its missing share makes the mean of all drives nan."""
    found = weights(0.3, 0.99)
    calls = []

    def of(drive, driven, *, doppler):
        calls.append(doppler)
        if len(calls) <= 2:
            return SimpleNamespace(kind=np.array(["wall"]), rejected=lambda chosen: np.nan)
        return found.of(drive, driven, doppler=doppler)

    short_drives.setattr(drives, "TargetWeights", SimpleNamespace(of=of))
    short_drives.setattr(drives, "walkers_by_pair", walkers(0.1))
    evidence = CLAIMS["doppler-rejects-moving"].check()
    assert evidence.verdict == "conditional"
    assert np.isfinite(list(evidence.numbers.values())).all()


@pytest.mark.parametrize(
    ("spoiled", "verdict"),
    [((), "confirmed"), ((True,), "wrong in part"), ((True, False), "refuted")],
)
def test_annealing_is_judged_by_the_difference_it_makes(short_drives, spoiled, verdict):
    """Breaks if runs are not compared with the truth, or those with Doppler decide alone."""

    def near(drive, *given, doppler: bool):
        true = drive.truth.theta[1:]
        off = 10.0 * (len(given) > 0 and doppler in spoiled)
        return true + off + 0.01 * np.random.default_rng(1).standard_normal(true.shape)

    short_drives.setattr(drives, "DURATION", 10.0)
    for name in ("followed", "annealed_from"):
        short_drives.setattr(drives, name, near)
    assert CLAIMS["annealing-no-gain"].check().verdict == verdict


def test_followed_pairs_have_no_second_start(short_drives):
    """Breaks if a pair starts elsewhere than at the last velocity: then a lost one comes back."""
    drive, tracks = drives.tracked_drive(0, False)
    np.testing.assert_allclose(followed(drive, doppler=True), tracks[True].theta, atol=1e-6)
    starts = []

    def estimate(previous, current, mounting, *, initial, **options):
        starts.append(initial)
        return SimpleNamespace(theta=initial + 1.0, converged=len(starts) != 3)

    short_drives.setattr(variations, "estimate_ego_motion", estimate)
    found = followed(drive)
    np.testing.assert_allclose(found[:5, 0] - drive.truth.theta[0, 0], [1, 2, 2, 3, 4])
    np.testing.assert_allclose(starts[1:], found[:-1])
