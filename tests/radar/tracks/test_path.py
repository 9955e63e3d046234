"""The path of a track: where the vehicle is, by a truth that is integrated finely, and how surely.

The truth knows nothing of the rule by which a track is integrated: it is a product of a matrix
exponential for each half millisecond.
"""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d import rigid
from d2d.radar import Track, track
from d2d.radar.tracks.filter import smooth_mixtures
from d2d.radar.tracks.path import chain
from d2d.scores import normalised_squares
from tests.radar.scenes import CORNER, arc, observe
from tests.radar.tracks.test_filter import VEHICLES, drawn, filtered

FINE, END = 5e-4, 12.0  # s
NOISE = np.diag([0.05, 0.08, 0.01]) ** 2


def velocity(times):
    """A car (n, 3) that brakes and turns to both sides, with up to 4 m/s^2 and 0.5 rad/s^2."""
    t = np.asarray(times)[:, None]
    waves = np.hstack([5.0 * np.sin(0.8 * t), 0.1 * np.cos(1.3 * t), 0.5 * np.sin(0.9 * t + 0.5)])
    return np.array([12.0, 0.05, 0.0]) + waves


@cache
def _truth():
    poses = [np.eye(3)]
    for theta in velocity(np.arange(0.0, END, FINE) + 0.5 * FINE):
        poses.append(poses[-1] @ arc(theta, FINE))
    return poses


def true_poses(times):
    """The poses (n, 3) at times (n,) that are multiples of the fine step."""
    poses = [_truth()[round(time / FINE)] for time in times]
    yaw = np.unwrap([np.arctan2(pose[1, 0], pose[0, 0]) for pose in poses])
    return np.column_stack([[pose[:2, 2] for pose in poses], yaw])


def driven(times, theta=None, good=None, **more) -> Track:
    """A track of the true velocities, or of others, from the first of the times on."""
    theta = velocity(times[1:]) if theta is None else theta
    good = np.ones(len(theta), dtype=bool) if good is None else good
    covariance = np.where(good[:, None, None], NOISE, np.nan)
    return Track(times[1:], np.diff(times), theta, covariance, good, **more)


def stamps(kind):
    """Times (n,) of a radar of 4, 10 or 20 Hz, or of rounds of several that are not in step."""
    if isinstance(kind, float):
        return np.arange(0.0, END - 1.0, 1.0 / kind)
    rng = np.random.default_rng(3)
    steps = {"irregular": rng.uniform(0.03, 0.18, 100), "rounds": np.tile([0.005, 0.07, 0.025], 80)}
    times = np.cumsum(steps[kind])
    return FINE * np.round(times[times < END] / FINE)


@pytest.mark.parametrize(
    ("kind", "metres", "degrees"),
    [
        (4.0, 0.15, 0.2),
        (10.0, 0.06, 0.05),
        (20.0, 0.02, 0.015),
        ("irregular", 0.12, 0.1),
        ("rounds", 0.015, 0.02),
    ],
)
def test_exact_velocities_make_the_true_path(kind, metres, degrees):
    """Breaks if the velocity at the end of an interval counts for all of it: then the car is 2.4 m
    and 5 degrees off at 4 Hz; if it stands or drives evenly at first; or if other ends matter."""
    times = stamps(kind)
    begin, true = true_poses(times[:1])[0], true_poses(times)
    own = driven(times)
    errors = own.poses(begin) - true
    assert np.hypot(*errors[:, :2].T).max() < metres
    assert np.abs(errors[:, 2]).max() < np.deg2rad(degrees)
    starts, ends = times[[0, 0, 3, 9]], times[[1, -1, 20, 35]]
    found, sure = own.displacement(starts, ends)
    crowd = own.displacement(np.full(99, starts[2]), np.linspace(starts[2] + 0.01, ends[2], 99))
    assert_array_equal(crowd.motion[-1], found[2])
    assert_allclose(crowd.covariance[-1], sure[2], rtol=1e-12)
    expected = rigid.compose(rigid.inverse(true_poses(starts)), true_poses(ends))
    assert np.hypot(*(found - expected)[:, :2].T).max() < metres
    assert_allclose(found[1], rigid.compose(rigid.inverse(begin), own.poses(begin)[-1]), atol=1e-9)


def test_the_error_of_a_path_falls_with_the_square_of_the_interval():
    """Breaks if the bracket is missing or has the wrong sign, or one interval is of first order."""
    errors = []
    for rate in (8.0, 16.0, 32.0):
        times = FINE * np.round(np.arange(0.0, 10.001, 1.0 / rate) / FINE)
        errors.append(np.hypot(*(driven(times).poses() - true_poses(times))[:, :2].T).max())
    assert errors[0] / errors[1] > 3.0
    assert errors[1] / errors[2] > 3.5


def test_between_estimates_and_over_those_that_failed_it_is_interpolated():
    """Breaks if a failed estimate stops the vehicle, or holds the velocity before it."""
    times = stamps(10.0)
    good = np.ones(len(times) - 1, dtype=bool)
    good[[0, 1, 30, 31, 32, 60]] = False
    theta = velocity(times[1:])
    theta[~good] = theta[good][0]
    own = driven(times, theta, good)
    errors = own.poses() - true_poses(times)
    assert np.hypot(*errors[:, :2].T).max() < 0.5
    starts, ends = np.array([2.05, 3.05, 1.0]), np.array([3.15, 3.35, 9.0])
    found = own.displacement(starts, ends).motion
    expected = rigid.compose(rigid.inverse(true_poses(starts)), true_poses(ends))
    assert np.hypot(*(found - expected)[:, :2].T).max() < 0.3


def test_after_the_last_estimate_the_velocity_stays_and_without_any_it_is_the_first():
    """Breaks if a path runs away on a guess."""
    times, good = 0.1 * np.arange(11), np.arange(10) < 5
    theta = np.where(good[:, None], velocity(times[1:]), 7.0)
    own = driven(times, theta, good)
    poses = own.poses()
    assert_allclose(
        rigid.compose(rigid.inverse(poses[5]), poses[-1]),
        rigid.exponential(0.5 * theta[4]),
        atol=1e-12,
    )
    lost = driven(times, np.tile([3.0, 0.0, 0.1], (10, 1)), np.zeros(10, dtype=bool))
    assert_allclose(lost.poses()[-1], rigid.exponential([3.0, 0.0, 0.1]), atol=1e-12)
    alone = driven(times[:2])
    assert_allclose(alone.poses()[1], rigid.exponential(0.1 * alone.theta[0]), atol=1e-12)


def test_a_steady_turn_is_exact_from_any_start():
    """Breaks if motions are applied in the world's axes, or the start is only added."""
    times = stamps("irregular")
    own = driven(times, np.tile([8.0, 0.3, 0.2], (len(times) - 1, 1)))
    for start in ((0.0, 0.0, 0.0), (100.0, -30.0, 2.0), (5.0, 5.0, -40.0)):
        moves = rigid.exponential((times - times[0])[:, None] * own.theta[0])
        found = own.poses(start)
        assert_allclose(found, rigid.compose(np.array(start), moves), atol=1e-9)


@pytest.mark.parametrize(("rate", "smooth"), [(13.0, False), (4.0, True)])
def test_displacements_are_as_sure_as_they_say(rate, smooth):
    """Breaks if noise adds up like slow errors, or slow ones average out like noise."""
    times = FINE * np.round(np.arange(0.0, 36.0, 1.0 / rate) / FINE)
    fine = np.arange(0.0, 36.0, 4.0 * FINE)
    found = {span: [] for span in (0.4, 1.0, 5.0, 10.0, 30.0)}
    for seed in range(6):
        theta, accelerations = VEHICLES["car"](times, seed)
        inputs = drawn(np.random.default_rng(seed), times, theta, accelerations)
        beliefs = filtered(times, inputs)
        beliefs = smooth_mixtures(beliefs) if smooth else beliefs
        errors = np.array([each.errors for each in beliefs])
        means = np.array([each.whole.mean[:3] for each in beliefs])
        good = np.ones(len(times), dtype=bool)
        steps = np.diff(times, prepend=-1.0 / rate)
        own = Track(times, steps, means, errors[:, 1, :3, :3], good, errors=errors)
        middle, _ = VEHICLES["car"](fine + 2.0 * FINE, seed)
        poses = chain(rigid.exponential(4.0 * FINE * middle), np.zeros(3))
        for span, squares in found.items():
            starts = FINE * np.round(np.arange(1.0, 35.0 - span, max(span, 2.0)) / FINE)
            ahead = own.displacement(starts, starts + span)
            begin, end = (
                np.column_stack([np.interp(each, np.append(fine, 36.0), p) for p in poses.T])
                for each in (starts, starts + span)
            )
            off = ahead.motion - rigid.compose(rigid.inverse(begin), end)
            off[:, 2] = (off[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
            squares += (normalised_squares(off, ahead.covariance) / 3.0).tolist()
    for squares in found.values():
        assert 0.6 < np.mean(squares) < 1.8


def test_errors_that_are_not_known_are_independent_of_each_other():
    times = 0.1 * np.arange(100)
    own = driven(times, np.tile([6.0, 0.0, 0.0], (99, 1)))
    ahead = own.displacement([1.0, 1.0, 1.0], [2.0, 5.0, 1.04]).covariance[:, 0, 0]
    assert_allclose(ahead[:2], NOISE[0, 0] * 0.1 * np.array([1.0, 4.0]), rtol=0.1)
    assert_allclose(ahead[2], NOISE[0, 0] * 0.04**2 * (0.8**2 + 0.2**2), rtol=1e-6)


def test_nothing_is_known_outside_the_track_and_in_a_silence():
    times, good = 0.1 * np.arange(401), np.ones(400, dtype=bool)
    good[100:104] = False  # short: the motion goes on
    own = driven(times, np.tile([6.0, 0.0, 0.0], (400, 1)), good)
    found = own.displacement([-1.0, 9.0, 39.0], [1.0, 12.0, 41.0])
    assert_array_equal(np.isfinite(found.motion[:, 0]), [False, True, False])
    assert_array_equal(np.isfinite(found.covariance[:, 0, 0]), [False, True, False])
    assert own.displacement([], []).motion.shape == (0, 3)
    assert np.isnan(own[:0].displacement([1.0], [2.0]).covariance).all()
    heard = np.concatenate([times[:100], times[140:]])
    silent = driven(heard, np.tile([6.0, 0.0, 0.0], (len(heard) - 1, 1)))
    assert_array_equal(
        np.isfinite(silent.displacement([5.0, 9.0, 15.0], [9.0, 15.0, 16.0]).motion[:, 0]),
        [True, False, True],
    )
    good = ~np.isin(range(10), [5, 6])
    slow = driven(1.1 * np.arange(11), np.tile([5.0, 0.0, 0.0], (10, 1)), good)
    found = slow.displacement([0.0, 1.1], [3.3, 5.5]).motion[:, 0]
    assert_allclose(found, [16.5, 22.0])


def test_where_nothing_is_estimated_the_path_is_guessed():
    """Breaks if a vehicle that has braked to a stand goes on, one that turned goes on turning, or
    the position is as sure afterwards as before."""
    rng = np.random.default_rng(0)
    points = rng.uniform([-20.0, -60.0], [120.0, 60.0], (500, 2))
    for braking, speed in ((3.0, 6.0), (0.0, 10.0)):
        pose, scans, theta = np.eye(3), [], np.zeros(3)
        for i in range(60):
            time = 0.1 * i
            forward = max(speed - braking * time, 0.0)
            theta = np.array([forward, 0.0, 0.03 * forward])
            noise = rng.standard_normal((3, len(points)))
            scan = observe(points, pose, time, theta, CORNER, noise, (0.1, 0.005, 0.05))
            seen = (np.abs(scan.azimuth) < 0.8) & (scan.range < 50.0)
            scans.append(scan[seen & (time < 2.0)])
            pose = pose @ arc(theta - [0.05 * braking * (forward > 0.0), 0.0, 0.0], 0.1)
        own = track((scans, CORNER))
        yaw = np.rad2deg(own.poses()[:, 2])
        assert np.flatnonzero(own.guessed).tolist() == list(range(19, 59))
        last = own.poses()[-1] - own.poses()[19]
        ahead = own.displacement([0.5, 0.5], [1.9, 5.8])
        assert np.isfinite(ahead.motion).all()
        deviations = np.sqrt(ahead.covariance[:, 0, 0])
        assert deviations[1] > 20.0 * deviations[0]
        if braking:
            assert np.hypot(*last[:2]) < 0.3
            assert abs(yaw[-1] - yaw[19]) < 1.0
        else:
            assert last[0] > 20.0
            assert 20.0 < abs(yaw[-1] - yaw[19]) < 38.0
