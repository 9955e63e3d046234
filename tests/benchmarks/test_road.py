"""The comparison on real drives: its yardsticks, and that a registration gets what helps it."""

import numpy as np
import pytest

from benchmarks.road import (
    LENGTH,
    Drive,
    by_doppler,
    by_drive,
    by_points,
    displacements,
    drift,
    held,
    run,
)
from d2d import CorruptedGaussian, RegistrationCost, register, rigid
from d2d.radar import Mounting, Track, simulate_drive
from d2d.radar.tracks.rounds import rounds_of
from d2d.radar.tracks.track import integrate


def test_the_last_velocity_is_held():
    thetas = np.array([[np.nan] * 3, [1.0, 2.0, 3.0], [np.nan] * 3, [4.0, 5.0, 6.0]])
    expected = [[0.0] * 3, [1.0, 2.0, 3.0], [1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    np.testing.assert_array_equal(held(thetas), expected)


@pytest.mark.parametrize("bend", [0.0, 0.05])
def test_drift_of_a_wrong_yaw_rate_and_of_a_wrong_speed(bend):
    """On a straight road a yaw rate off by w turns by w s and moves the end by w s L / 2."""
    intervals, speed = np.full(2000, 0.1), 10.0
    true = np.tile([speed, 0.0, bend], (2000, 1))
    poses = integrate(true, intervals)[1:]
    assert abs(drift(true, intervals, poses)).max() < 1e-9
    seconds = LENGTH / speed
    turned = drift(true + np.array([0.0, 0.0, 1e-4]), intervals, poses)
    np.testing.assert_allclose(turned[:, 1], 1e-4 * seconds, rtol=2e-2)
    slow = drift(true * [0.99, 1.0, 1.0], intervals, poses)
    if bend == 0.0:
        np.testing.assert_allclose(turned[:, 0], 1e-4 * seconds * LENGTH / 2.0, rtol=2e-2)
        np.testing.assert_allclose(slow[:, 0], 0.01 * LENGTH, rtol=2e-2)


def test_displacements_of_a_track_are_judged_against_the_references_path():
    """With a yaw rate off by 1e-3 rad/s, each second turns 1e-3 rad too far, and no error is lost
    where spans begin inside an interval of the track.
    """
    drive = simulate_drive(np.random.default_rng(3), duration=12.0)
    own = Drive("", [], [], drive.truth)
    inner = slice(1, None)
    times, poses = drive.truth.times, drive.truth.poses
    steps = rigid.compose(rigid.inverse(poses[:-1]), poses[1:])
    theta = rigid.logarithm(steps) / np.diff(times)[:, None] + np.array([0.0, 0.0, 1e-3])
    count = len(theta)
    driven = Track(
        times=times[inner],
        intervals=np.diff(times),
        theta=theta,
        covariance=np.tile(1e-4 * np.eye(3), (count, 1, 1)),
        converged=np.ones(count, bool),
    )
    errors, covariances = displacements([(own, driven)], 1.0)
    assert len(errors) == len(covariances) == 22
    np.testing.assert_allclose(errors[:, 2], 1e-3, atol=2e-6)


def test_merged_static_points_of_two_radars_give_the_velocity():
    """Wrong mountings, or moving targets among the points, would show as metres a second."""
    mountings = Mounting(3.5, 0.6, 0.4), Mounting(3.5, -0.6, -0.4)
    drives = [
        simulate_drive(np.random.default_rng(3), duration=3.0, mounting=at) for at in mountings
    ]
    rounds = rounds_of([(drive.scans, drive.mounting) for drive in drives], 1, 0.3)
    truth = drives[0].truth.at([each.time for each in rounds]).theta
    cost = RegistrationCost(outlier=CorruptedGaussian(0.2, 100.0 * np.eye(2)))

    def robust(fixed, moving, start):
        return register(fixed, moving, cost, start).theta

    for method in (by_doppler(True), by_points(robust)):
        errors = run(method, rounds)[0] - truth
        rmse = np.sqrt(np.nanmean(errors**2, axis=0))
        assert (rmse < [0.2, 0.3, np.deg2rad(2.0)]).all()


def test_drives_are_judged_one_by_one():
    """Breaks if a drive that is too sure hides one that is too unsure."""
    axes, unit = np.sqrt(3.0) * np.tile(np.eye(3), (4, 1)), np.tile(np.eye(3), (12, 1, 1))
    sure, unsure = (2.0 * axes, unit), (0.5 * axes, unit)
    assert by_drive([sure, unsure]) == "4.00 / 0.25"
    assert by_drive([sure, unsure, unsure]) == "0.25 to 4.00"
    assert by_drive([(sure[0][:2], unit[:2])]) == "–"
