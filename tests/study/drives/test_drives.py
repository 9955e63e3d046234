"""Drives and their variations: which targets are rejected, and how a drive is judged."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d.radar import (
    estimate_ego_motion,
    inlier_probabilities,
    propagate_ego_motion,
    simulate_drive,
    track,
)
from d2d.study.drives.errors import Drift
from d2d.study.drives.moving_targets import TargetWeights, rejected_walkers, walkers_by_pair
from d2d.study.drives.shared_azimuth import COVARIANCES, on_a_drive
from d2d.study.drives.variations import track_from


@pytest.fixture(scope="package")
def driven():
    """A short simulated drive and its track."""
    drive = simulate_drive(np.random.default_rng(2), 6.0)
    return drive, track(drive)


def test_track_from_starts_every_pair_at_the_same_place(driven):
    drive, result = driven
    start = np.array([1.0, 0.5, 0.0])
    alone = track_from(drive, start, doppler=False, scales=(2.0, 1.0))
    assert_array_equal(alone.times, result.times)
    assert_array_equal(alone.intervals, result.intervals)
    for i in (0, 30, 59):
        pair = drive.scans[i], drive.scans[i + 1], drive.mounting
        direct = estimate_ego_motion(*pair, doppler=False, initial=start, scales=(2.0, 1.0))
        assert_array_equal(alone.theta[i], direct.theta)
        assert_array_equal(alone.covariance[i], direct.covariance)
        assert alone.converged[i] == direct.converged


def test_weights_are_the_probabilities_of_all_targets_of_all_good_pairs(driven):
    """Breaks if targets and labels of different scans are put together."""
    drive, result = driven
    good = np.arange(60) != 3
    bad = replace(result, converged=good, reasons=np.where(good, "", "lost"))
    weights = TargetWeights.of(drive, bad)
    kept = [i for i in range(60) if i != 3]
    assert_array_equal(weights.kind, np.concatenate([drive.targets[i + 1].kind for i in kept]))
    direct = [
        inlier_probabilities(result.theta[i], *drive.scans[i : i + 2], drive.mounting) for i in kept
    ]
    assert_array_equal(weights.probability, np.concatenate(direct))
    still = ~np.isin(weights.kind, ("moving", "clutter"))
    moving = weights.kind == "moving"
    assert weights.rejected(moving) > weights.rejected(still) + 0.5
    assert np.isnan(weights.rejected(weights.kind == "nothing"))
    blind = TargetWeights.of(drive, bad, doppler=False)
    assert blind.rejected(moving) < weights.rejected(moving)


def test_walkers_are_told_by_their_doppler_velocity_alone(driven):
    """Breaks if along and across change places, or the displacement is applied to other targets."""
    drive, result = driven
    angles = np.array([0.0, np.pi, 0.5 * np.pi])
    away, towards, across = rejected_walkers(drive, result, 1.5, angles)
    assert min(away, towards) > 0.95
    assert across < 0.3
    pairs = walkers_by_pair(drive, result, 1.5, angles)
    assert len(pairs) == 6  # every tenth of 60
    assert sum(pair[2].sum() for pair in pairs) == round(across * sum(map(np.size, pairs)) / 3)
    blind = rejected_walkers(drive, result, 1.5, angles, doppler=False)
    assert blind.max() < 0.5
    assert rejected_walkers(drive, result, 0.0, angles[:1])[0] < 0.2
    racing = rejected_walkers(drive, result, 40.0, angles[2:], doppler=False)
    assert racing[0] > across + 0.3, "moved by four metres"


@pytest.fixture(scope="module")
def drive():
    return simulate_drive(np.random.default_rng(2), 2.0)


def test_the_covariances_are_those_of_each_pair(drive):
    """Breaks if a covariance is lost on the way, or belongs to another pair or another kind."""
    driven, pairs = track(drive), [0, 2, 5, 16]
    found = on_a_drive(drive, driven, pairs)
    for number, i in enumerate(pairs):
        pair = drive.scans[i], drive.scans[i + 1], drive.mounting
        estimate = estimate_ego_motion(*pair, initial=driven.theta[i])
        error = estimate.theta - drive.truth.theta[i + 1]
        covariances = (
            estimate.covariance,
            propagate_ego_motion(estimate, *pair, shared_azimuth=False),
            propagate_ego_motion(estimate, *pair),
        )
        for name, covariance in zip(COVARIANCES, covariances, strict=True):
            nees = error @ np.linalg.solve(covariance, error)
            assert_allclose(found.credibility(name).nees[number], nees, err_msg=name)
    _, apart, shared = found.covariances.values()
    assert not np.allclose(shared, apart, rtol=1e-3)


def straight(length: float = 100.0, scale: float = 1.0, turn: float = 0.0) -> np.ndarray:
    """Poses every metre along x, the way scaled and the heading turned by so many rad/m."""
    along = np.arange(length + 1.0)
    return np.column_stack([scale * along, np.zeros_like(along), turn * along])


def test_drift_of_known_errors():
    """Breaks if a measure is not per metre, in degrees, or the root mean square."""
    longer = Drift.of(straight(scale=1.02), straight())
    # evo takes stretches of about the length
    assert longer.rpe_translation == pytest.approx(0.02, rel=0.1)
    assert longer.rpe_rotation == pytest.approx(0.0, abs=1e-6)
    assert longer.ape_translation == pytest.approx(np.sqrt(np.mean((0.02 * np.arange(101.0)) ** 2)))
    assert longer.ape_rotation == pytest.approx(0.0, abs=1e-6)
    turning = Drift.of(straight(turn=np.deg2rad(0.3)), straight())
    assert turning.rpe_rotation == pytest.approx(0.3, rel=0.1)
    assert turning.ape_rotation == pytest.approx(np.sqrt(np.mean((0.3 * np.arange(101.0)) ** 2)))
    assert turning.ape_translation == pytest.approx(0.0, abs=1e-9)


def test_drift_does_not_align_the_paths():
    """Breaks if a constant offset is taken out, and does not count it as drift per metre."""
    off = Drift.of(straight() + np.array([3.0, 4.0, 0.0]), straight())
    assert off.ape_translation == pytest.approx(5.0)
    assert off.rpe_translation == pytest.approx(0.0, abs=1e-9)
