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
