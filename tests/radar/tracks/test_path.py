"""The path of a track: where the vehicle is, by a truth that is integrated finely, and how surely.

The truth knows nothing of the rule by which a track is integrated: it is a product of a matrix
exponential for each half millisecond.
"""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d import rigid
from d2d.radar import Track
from d2d.radar.scans.budget import CovarianceParts
from d2d.scores import normalised_squares
from tests.radar.scenes import arc

FINE, END = 5e-4, 12.0  # s
NOISE = np.diag([0.05, 0.08, 0.01]) ** 2
SLOW = np.array([[9e-4, 0.0, 0.0], [0.0, 4e-4, 3e-5], [0.0, 3e-5, 9e-6]])
STAYS = 15.0  # s, as long as the errors of v_x do on RadarScenes


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


def driven(times, theta=None, good=None, parts=True) -> Track:
    """A track of the true velocities, or of others, from the first of the times on."""
    theta = velocity(times[1:]) if theta is None else theta
    good = np.ones(len(theta), dtype=bool) if good is None else good
    noise, none, slow = (
        np.where(good[:, None, None], each, np.nan) for each in (NOISE, 0.0 * NOISE, SLOW)
    )
    return Track(
        times[1:],
        np.diff(times),
        theta,
        noise + slow,
        good,
        parts=CovarianceParts(noise, none, slow) if parts else None,
    )


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
    and 5 degrees off at 4 Hz; or if the vehicle stands still or drives evenly before the first."""
    times = stamps(kind)
    begin, true = true_poses(times[:1])[0], true_poses(times)
    own = driven(times)
    errors = own.poses(begin) - true
    assert np.hypot(*errors[:, :2].T).max() < metres
    assert np.abs(errors[:, 2]).max() < np.deg2rad(degrees)
    starts, ends = times[[0, 0, 3, 9]], times[[1, -1, 20, 35]]
    found = own.displacement(starts, ends).motion
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


@pytest.mark.parametrize("seconds", [0.04, 1.0, 5.0])
@pytest.mark.parametrize("first", [0.0, 2.03])
def test_the_errors_are_as_large_as_stated(seconds, first):
    """Breaks if noise adds up like slow errors, or slow ones average out like noise, or the error
    of the first velocity, which is extrapolated, is not that of the two that it is made of."""
    rng, times, nees = np.random.default_rng(1), stamps(10.0)[:100], []
    kept = np.exp(-0.1 / STAYS)
    values, vectors = np.linalg.eigh(SLOW)
    root, count = vectors * np.sqrt(values) @ vectors.T, len(times) - 1
    true = driven(times).displacement([first], [first + seconds]).motion
    for _ in range(400):
        errors, slow = np.empty((count, 3)), rng.standard_normal(3)
        for i in range(count):
            errors[i] = root @ slow
            slow = kept * slow + np.sqrt(1.0 - kept**2) * rng.standard_normal(3)
        errors += rng.standard_normal((count, 3)) * np.sqrt(np.diag(NOISE))
        found = driven(times, velocity(times[1:]) + errors).displacement([first], [first + seconds])
        nees += normalised_squares(found.motion - true, found.covariance).tolist()
    assert 2.6 < np.mean(nees) < 3.4  # 3, known to 0.12


def test_slow_errors_grow_like_an_integrated_process_of_15_s():
    """Breaks if they are taken to last for much longer or shorter than errors on the road."""
    times = 0.1 * np.arange(400)
    own = driven(times, np.tile([6.0, 0.0, 0.0], (399, 1)))
    spans = np.array([1.0, 5.0, 15.0, 35.0])
    sigma = np.sqrt(own.displacement(np.full(4, 1.0), 1.0 + spans).covariance[:, 0, 0])
    ratio = spans / STAYS
    slow = SLOW[0, 0] * 2.0 * STAYS**2 * (ratio - 1.0 + np.exp(-ratio))
    assert_allclose(sigma, np.sqrt(slow + NOISE[0, 0] * 0.1 * spans), rtol=0.03)
    alone = driven(times, own.theta, parts=False).displacement([1.0, 1.0], [2.0, 5.0])
    assert alone.covariance[1, 0, 0] / alone.covariance[0, 0, 0] == pytest.approx(4.0, rel=0.1)


def test_nothing_is_known_outside_the_track_and_in_a_gap():
    times, good = 0.1 * np.arange(401), np.ones(400, dtype=bool)
    good[100:104] = False  # short: the motion goes on
    good[200:215] = False
    own = driven(times, np.tile([6.0, 0.0, 0.0], (400, 1)), good)
    found = own.displacement([-1.0, 9.0, 15.0, 39.0], [1.0, 12.0, 25.0, 41.0])
    assert_array_equal(np.isfinite(found.motion[:, 0]), [False, True, False, False])
    assert_array_equal(np.isfinite(found.covariance[:, 0, 0]), [False, True, False, False])
    assert own.displacement([], []).motion.shape == (0, 3)
    assert np.isnan(own[:0].displacement([1.0], [2.0]).covariance).all()
    assert np.isnan(own[205:210].displacement([20.7], [20.8]).motion).all()
    good = ~np.isin(range(10), [5, 6, 7])
    slow = driven(1.1 * np.arange(11), np.tile([5.0, 0.0, 0.0], (10, 1)), good)
    found = slow.displacement([0.0, 1.1, 5.0], [3.3, 5.5, 10.0]).motion[:, 0]
    assert_allclose(found, [16.5, 22.0, np.nan])


@pytest.mark.parametrize(
    ("start", "end", "said"),
    [
        ([1.0], [1.0], "end must be after start"),
        ([1.0, 2.0], [3.0], "end must have the shape"),
        (1.0, 2.0, "start must have the shape"),
    ],
)
def test_wrong_times_are_refused(start, end, said):
    with pytest.raises(ValueError, match=said):
        driven(stamps(4.0)).displacement(start, end)
