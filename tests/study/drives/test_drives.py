"""How a drive is judged: errors, what is left out, units."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d import credibility
from d2d.radar import (
    Drive,
    Reference,
    Track,
    estimate_ego_motion,
    inlier_probabilities,
    simulate_drive,
    track,
)
from d2d.radar.motion.covariance import propagate_ego_motion
from d2d.study.drives.errors import Drift, DriveErrors, errors_table
from d2d.study.drives.moving_targets import TargetWeights, rejected_walkers, walkers_by_pair
from d2d.study.drives.variations import propagated_covariances, sparse, track_from

N = 50


def example(seed: int = 0) -> tuple[Track, Reference]:
    """A track with Gaussian errors of its covariances, and the truth at the times of all scans."""
    rng = np.random.default_rng(seed)
    times = np.arange(N + 1) / 10.0
    truth = rng.uniform([5.0, -0.5, -0.3], [15.0, 0.5, 0.3], (N + 1, 3))
    root = rng.standard_normal((N, 3, 4)) * np.array([0.1, 0.2, 0.02])[:, None]
    covariance = root @ np.swapaxes(root, -1, -2)
    errors = np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), rng.standard_normal((N, 3)))
    converged = np.ones(N, dtype=bool)
    return (
        Track(times[1:], np.diff(times), truth[1:] + errors, covariance, converged),
        Reference(times, truth, np.zeros((N + 1, 3))),
    )


def test_errors_are_estimate_minus_reference_at_the_later_scan():
    """Breaks if the sign or the pairing of n pairs with n + 1 scans is off."""
    driven, reference = example()
    judged = DriveErrors.of(driven, reference)
    for i in (0, 17, N - 1):
        assert_array_equal(judged.errors[i], driven.theta[i] - reference.theta[i + 1])
    assert_array_equal(judged.times, driven.times)
    assert_array_equal(judged.covariances, driven.covariance)
    assert judged.share == 1.0


def without(driven: Track, rows, **changed) -> Track:
    """The track with some of its estimates as not converged, and what is then in their place."""
    arrays = {name: getattr(driven, name).copy() for name in ("converged", *changed)}
    for name, value in ({"converged": False} | changed).items():
        arrays[name][rows] = value
    return replace(driven, **arrays)


def test_rmse_and_sigmas_are_in_metres_and_degrees():
    """Breaks if omega stays in radians, or a variance is reported for a standard deviation."""
    driven, reference = example()
    judged = DriveErrors.of(driven, reference)
    e = driven.theta - reference.theta[1:]
    for i, unit in enumerate((1.0, 1.0, 180.0 / np.pi)):
        assert judged.rmse[i] == pytest.approx(unit * np.sqrt((e[:, i] ** 2).sum() / N))
        assert_allclose(judged.sigmas[:, i], unit * np.sqrt(driven.covariance[:, i, i]))


def test_pairs_that_did_not_converge_or_have_no_reference_are_left_out():
    """Breaks if a prediction is judged as an estimate, or nan spreads over the drive."""
    driven, reference = example()
    driven = without(driven, 4, theta=1e6, covariance=np.nan)
    reference.theta[11, 1] = np.nan  # of pair 10
    reference.theta[0] = np.nan  # of no pair
    judged = DriveErrors.of(driven, reference)
    left = np.delete(np.arange(N), [4, 10])
    assert_array_equal(judged.times, driven.times[left])
    assert_array_equal(judged.errors, (driven.theta - reference.theta[1:])[left])
    assert judged.share == pytest.approx(48 / 50)
    assert np.isfinite(judged.rmse).all()
    assert judged.rmse[0] < 10.0


def test_a_reference_at_other_times_is_interpolated():
    """Breaks if rows are paired by number, or the shapes are left to NumPy to complain about."""
    driven, reference = example()
    often = np.linspace(-1.0, 6.0, 71)  # twice as often, and beyond both ends
    finer = reference.at(np.clip(often, 0.0, 5.0))
    judged = DriveErrors.of(driven, Reference(often, finer.theta, finer.poses))
    assert_allclose(judged.errors, driven.theta - reference.theta[1:], atol=1e-12)
    shifted = Reference(reference.times - 0.05, reference.theta, reference.poses)
    judged = DriveErrors.of(driven, shifted)
    between = 0.5 * (reference.theta[1:-1] + reference.theta[2:])
    assert_allclose(judged.errors, driven.theta[:-1] - between, atol=1e-12)
    assert judged.share == pytest.approx((N - 1) / N)  # the last is after the reference's end


@pytest.mark.parametrize("late", [-100.0, 100.0])
def test_a_reference_of_another_time_is_refused(late):
    """Breaks if the error of nothing is reported as nan, with a warning of NumPy's."""
    driven, reference = example()
    with pytest.raises(ValueError, match=r"^reference must overlap the track in time, but"):
        DriveErrors.of(driven, Reference(reference.times + late, reference.theta, reference.poses))


def test_what_is_no_track_or_reference_is_named():
    """Breaks if the user gets Python's words about attributes."""
    driven, reference = example()
    with pytest.raises(ValueError, match=r"^track must be a Track"):
        DriveErrors.of(reference, driven)
    with pytest.raises(ValueError, match=r"^reference must be a Reference"):
        DriveErrors.of(driven, driven.theta)


def test_errors_given_directly_are_judged_alike():
    """Breaks if a results file is judged by another rule than a fresh track."""
    driven, reference = example()
    of = DriveErrors.of(driven, reference)
    given = DriveErrors.from_errors(driven, driven.theta - reference.theta[1:])
    assert_array_equal(of.errors, given.errors)
    assert of.share == given.share


def test_credibility_is_that_of_the_errors_in_si_units():
    """Breaks if degrees are judged with a covariance in radians."""
    driven, reference = example(seed=1)
    judged = DriveErrors.of(driven, reference)
    direct = credibility(driven.theta - reference.theta[1:], driven.covariance)
    assert judged.credibility.anees == direct.anees
    assert judged.credibility.consistent


def test_the_table_says_what_was_measured():
    """Breaks if a number is printed in another place or unit than it says."""
    driven, reference = example()
    driven = without(driven, slice(5))
    judged = DriveErrors.of(driven, reference)
    shown = errors_table({"one": judged}, "Errors.")
    low, high = judged.intervals().anees
    assert dict(zip([name for name, _ in shown.header], shown.rows[0], strict=True)) == {
        "": "one",
        "v_x": f"{judged.rmse[0]:.3f}",
        "v_y": f"{judged.rmse[1]:.3f}",
        "omega": f"{judged.rmse[2]:.3f}",
        "usable": "90.0%",
        "ANEES": f"{judged.credibility.anees:.2f}",
        "95 % interval": f"{low:.2f} to {high:.2f}",
        "NCI": f"{judged.credibility.nci:.1f}",
        "I²": f"{judged.credibility.inclination:+.1f}",
    }
    assert dict(shown.header)["omega"] == "deg/s"


@cache
def driven() -> tuple[Drive, Track]:
    """A short simulated drive and its track."""
    drive = simulate_drive(np.random.default_rng(2), 6.0)
    return drive, track(drive)


def test_weights_are_the_probabilities_of_all_targets_of_all_good_pairs():
    """Breaks if targets and labels of different scans are put together."""
    drive, result = driven()
    bad = without(result, 3)
    weights = TargetWeights.of(drive, bad)
    kept = [i for i in range(60) if i != 3]
    assert_array_equal(weights.kind, np.concatenate([drive.targets[i + 1].kind for i in kept]))
    direct = [
        inlier_probabilities(
            result.theta[i], drive.scans[i], drive.scans[i + 1], drive.mounting, doppler=True
        )
        for i in kept
    ]
    assert_array_equal(weights.probability, np.concatenate(direct))
    still = ~np.isin(weights.kind, ("moving", "clutter"))
    assert_allclose(weights.own_speed[still], 0.0, rtol=0, atol=1e-12)
    assert np.isnan(weights.own_speed[weights.kind == "clutter"]).all()
    moving = weights.kind == "moving"
    assert np.abs(weights.own_speed[moving]).max() > 1.0
    assert weights.rejected(moving) > weights.rejected(still) + 0.5
    assert np.isnan(weights.rejected(weights.kind == "nothing"))
    blind = TargetWeights.of(drive, bad, doppler=False)
    assert blind.rejected(moving) < weights.rejected(moving)


def test_walkers_are_told_by_their_doppler_velocity_alone():
    """Breaks if along and across change places, or the displacement is applied to other targets."""
    drive, result = driven()
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


def test_a_sparse_world_has_fewer_points_and_nobody_about():
    """Breaks if positions, strengths and kinds are thinned apart."""
    world = driven()[0].world
    few = sparse(world, np.random.default_rng(0), 0.2)
    count = len(world.reflectors.kind)
    assert len(few.reflectors.kind) == pytest.approx(0.2 * count, abs=4.0 * np.sqrt(0.16 * count))
    where = {tuple(at): k for k, at in enumerate(world.reflectors.positions)}
    rows = [where[tuple(at)] for at in few.reflectors.positions]
    assert_allclose(few.reflectors.strength, 4.0 * world.reflectors.strength[rows])
    assert_array_equal(few.reflectors.kind, world.reflectors.kind[rows])
    lonely = simulate_drive(np.random.default_rng(0), 0.5, world=few)
    assert "moving" not in set(np.concatenate([true.kind for true in lonely.targets]))


def test_track_from_starts_every_pair_at_the_same_place():
    """Breaks if a pair is started at the last one's velocity, as track does."""
    drive, result = driven()
    start = np.array([1.0, 0.5, 0.0])
    alone = track_from(drive, start, doppler=False, scales=(2.0, 1.0))
    assert_array_equal(alone.times, result.times)
    assert_array_equal(alone.intervals, result.intervals)
    for i in (0, 30, 59):
        direct = estimate_ego_motion(
            drive.scans[i],
            drive.scans[i + 1],
            drive.mounting,
            doppler=False,
            initial=start,
            scales=(2.0, 1.0),
        )
        assert_array_equal(alone.theta[i], direct.theta)
        assert_array_equal(alone.covariance[i], direct.covariance)
        assert alone.converged[i] == direct.converged


def test_propagated_covariances_are_those_of_the_chosen_pairs():
    """Breaks if pairs are shifted, or both options give the same."""
    drive, result = driven()
    pairs = [5, 40]
    shared, apart = (
        propagated_covariances(drive, result, pairs, shared_azimuth=shared)
        for shared in (True, False)
    )
    for k, i in enumerate(pairs):
        pair = drive.scans[i], drive.scans[i + 1], drive.mounting
        estimate = estimate_ego_motion(*pair, initial=result.theta[i])
        assert_allclose(estimate.theta, result.theta[i], rtol=0, atol=1e-6)
        assert_allclose(shared[k], propagate_ego_motion(estimate, *pair), rtol=1e-9)
    assert not np.allclose(shared, apart, rtol=1e-4)


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


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan])
def test_a_bad_stretch_is_refused(bad):
    """Breaks if it ends in a division by zero."""
    with pytest.raises(ValueError, match=r"^stretch must be"):
        Drift.of(straight(), straight(), stretch=bad)
