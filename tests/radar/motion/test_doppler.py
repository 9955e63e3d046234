"""The sensor's velocity from the Doppler profile of one scan."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from d2d.radar import Mounting, RadarScan, doppler_ego_motion, doppler_velocity, sensor_velocity
from d2d.radar.motion.doppler import doppler_acceleration, doppler_starts
from tests.radar.scenes import AROUND, mountings, velocities
from tests.strategies import seeds


def scan_of(azimuth, doppler, sigma_doppler=0.06) -> RadarScan:
    """A scan of these Doppler velocities, 20 m away."""
    azimuth = np.atleast_1d(azimuth)
    return RadarScan(0.0, np.full(len(azimuth), 20.0), azimuth, doppler, 0.15, 0.01, sigma_doppler)


def velocity_of_sensor(theta, mounting: Mounting) -> np.ndarray:
    """Of a point of the rigid vehicle, v + omega x r."""
    v_x, v_y, omega = theta
    return np.array([v_x - omega * mounting.y, v_y + omega * mounting.x])


@given(seeds, velocities, mountings, st.sampled_from([2, 3, 4, 48, 300]))
def test_noise_free_targets_give_the_velocity_of_the_sensor(seed, theta, mounting, size):
    """Breaks if the sensor's frame is mistaken for the vehicle's, or few targets are not enough."""
    azimuth = np.random.default_rng(seed).uniform(-0.8, 0.7, size)
    assume(np.ptp(azimuth) > 0.2)
    scan = scan_of(azimuth, doppler_velocity(theta, azimuth, mounting))
    expected = velocity_of_sensor(theta, mounting)
    assert_allclose(sensor_velocity(scan, mounting), expected, atol=1e-6)


def test_start_takes_the_velocity_of_the_sensor_for_that_of_the_vehicle():
    """Breaks if the start of a registration is not [u_x, u_y, 0]."""
    azimuth, mounting = np.linspace(-0.8, 0.7, 9), Mounting(3.86, 0.7, 0.436)
    scan = scan_of(azimuth, doppler_velocity([17.0, 0.0, 0.35], azimuth, mounting))
    straight = [17.0 - 0.245, 0.35 * 3.86, 0.0]
    turning = [17.0, 0.0, 0.35]  # the truth, since this vehicle does not slip
    assert_allclose(doppler_starts([(scan, mounting)]), [straight, turning], atol=1e-9)


def test_moving_targets_do_not_pull_the_velocity():
    """Breaks if plain least squares is used (off by metres per second here), or too few pairs."""
    theta, size = np.array([25.0, 0.2, -0.1]), 48
    for mounting, share, scattered in product(AROUND, (0.2, 0.4), (True, False)):
        rng = np.random.default_rng(11)
        count = round(share * size)
        for _ in range(40):
            azimuth = rng.uniform(-0.9, 0.9, size)
            doppler = doppler_velocity(theta, azimuth, mounting) + 0.06 * rng.standard_normal(size)
            moving = rng.permutation(size)[:count]
            if scattered:
                doppler[moving] += rng.uniform(-20.0, 20.0, count)
            else:  # a car that overtakes, spread over 15 degrees
                azimuth[moving] = rng.uniform(0.1, 0.36, count)
                relative = theta - [32.0, 0.0, 0.0]
                doppler[moving] = doppler_velocity(relative, azimuth[moving], mounting)
            error = sensor_velocity(scan_of(azimuth, doppler), mounting)
            error -= velocity_of_sensor(theta, mounting)
            assert np.abs(error).max() < 0.3


def test_one_direction_gives_the_weighted_mean_along_it():
    """Breaks if rounding gives a velocity across equal azimuths, or weights are not 1 / sigma^2."""
    rng = np.random.default_rng(5)
    for size in (2, 3, 10):
        sigma = rng.uniform(0.05, 0.2, size)
        doppler = -7.0 + 0.01 * rng.standard_normal(size)
        azimuth = np.full(size, 0.4) + 1e-15 * np.arange(size)
        estimate = sensor_velocity(scan_of(azimuth, doppler, sigma), Mounting())
        expected = -np.average(doppler, weights=sigma**-2.0) * np.array([np.cos(0.4), np.sin(0.4)])
        assert_allclose(estimate, expected, rtol=0, atol=1e-9)


def test_few_targets_are_solved_as_they_are():
    """Breaks if two targets that disagree about a direction are judged for outliers, or an empty
    set of inliers is fitted, which says that the sensor stands still."""
    for azimuth, doppler, expected in (
        ([np.pi / 2], [-7.0], [0.0, 7.0]),
        ([0.0, np.pi / 2], [-3.0, 5.0], [3.0, -5.0]),
        ([0.0, 0.0], [-3.0, -5.0], [4.0, 0.0]),
        ([0.0, 0.0, 0.0], [-7.0, -9.0, -11.0], [9.0, 0.0]),
    ):
        estimate = sensor_velocity(scan_of(azimuth, doppler), Mounting())
        assert_allclose(estimate, expected, rtol=0, atol=1e-12)


def test_a_bundle_narrower_than_the_azimuths_error_does_not_invent_a_velocity_across():
    """Breaks if noise is divided by differences of azimuth that are noise themselves."""
    rng = np.random.default_rng(8)
    for width in np.repeat([1e-2, 1e-3, 1e-4], 20):
        doppler = -20.0 + 0.06 * rng.standard_normal(4)
        across = sensor_velocity(scan_of(rng.uniform(0.0, width, 4), doppler), Mounting())[1]
        assert abs(across) < 10.0


def views_of(rng, theta, size=40, noise=0.06, mountings=AROUND):
    """A scan of static targets by each sensor; the Doppler follows the true azimuth."""
    views = []
    for mounting in mountings:
        azimuth = rng.uniform(-0.8, 0.8, size)
        doppler = doppler_velocity(theta, azimuth, mounting) + noise * rng.standard_normal(size)
        seen = azimuth + 0.01 * (noise > 0.0) * rng.standard_normal(size)
        views.append((scan_of(seen, doppler), mounting))
    return views


def test_it_is_the_weighted_least_squares_of_what_it_takes_for_static():
    """Breaks if it is not at a fixed point of its own weights and choice."""
    views = views_of(np.random.default_rng(22), [15.0, -0.2, 0.2])
    motion = doppler_ego_motion(views)
    rows, values, sigmas = [], [], []
    for (scan, at), inliers in zip(views, motion.inliers, strict=True):
        for k in range(scan.size):
            angle = scan.azimuth[k] + at.yaw
            c, s = np.cos(angle), np.sin(angle)
            row, turned = [-c, -s, at.y * c - at.x * s], [s, -c, -at.y * s - at.x * c]
            sigma = np.hypot(0.06, 0.01 * np.dot(turned, motion.theta))
            agrees = abs(scan.doppler[k] - np.dot(row, motion.theta)) < 3.0 * sigma
            assert agrees == inliers[k]
            if inliers[k]:
                rows.append(row)
                values.append(scan.doppler[k])
                sigmas.append(sigma)
    weight = 1.0 / np.array(sigmas)
    system = np.array(rows) * weight[:, None]
    solved = np.linalg.lstsq(system, values * weight, rcond=None)[0]
    assert_allclose(motion.theta, solved, rtol=0, atol=1e-6)
    assert_allclose(motion.covariance, np.linalg.inv(system.T @ system), rtol=1e-3)


def test_moving_targets_do_not_pull_several_sensors():
    """Breaks if a car that fills a third of one scan counts."""
    rng, theta = np.random.default_rng(23), np.array([20.0, 0.1, -0.1])
    for _ in range(20):
        views = views_of(rng, theta)
        scan, at = views[0]
        doppler = scan.doppler.copy()
        doppler[:14] = doppler_velocity(theta - [30.0, 0.0, 0.0], scan.azimuth[:14], at)
        views[0] = scan_of(scan.azimuth, doppler), at
        motion = doppler_ego_motion(views)
        error = motion.theta - theta
        assert error @ np.linalg.solve(motion.covariance, error) < 25.0
        assert motion.inliers[0][:14].sum() <= 3
        assert motion.inliers[0][14:].sum() >= 22


def test_sensors_at_different_places_give_one_start():
    """Breaks if the yaw rate that several sensors show is not used, or one sensor invents one."""
    views = views_of(np.random.default_rng(26), [17.0, -0.6, 0.35])
    assert_array_equal(doppler_starts(views), [doppler_ego_motion(views).theta])
    scan, at = views[0]
    fewer = scan[::2], Mounting(at.x, at.y, at.yaw - 0.1)  # at the same place
    alone = [doppler_starts([view]) for view in (fewer, views[0])]
    assert_array_equal(doppler_starts([fewer, views[0]]), np.concatenate(alone))


def test_sparse_sensors_give_starts_of_their_own():
    """Breaks if a few targets that agree by accident leave no other start."""
    views = [(scan[:5], at) for scan, at in views_of(np.random.default_rng(26), [17.0, -0.6, 0.35])]
    starts = doppler_starts(views)
    assert_array_equal(starts[0], doppler_ego_motion(views).theta)
    assert_array_equal(starts[1:], np.concatenate([doppler_starts([view]) for view in views]))


def test_the_order_of_the_targets_does_not_decide():
    """Breaks if the first of two equally good hypotheses wins, whichever is measured first."""
    rng = np.random.default_rng(5)
    for _ in range(50):
        scan, at = views_of(rng, rng.uniform([-5.0, -1.0, -0.5], [20.0, 1.0, 0.5]), noise=3.0)[0]
        few = scan[:5]
        shuffled = few[rng.permutation(5)]
        assert_allclose(sensor_velocity(shuffled, at), sensor_velocity(few, at), atol=1e-9)


BEFORE, INTERVAL = np.diag(np.square([3.0, 0.3, 0.2])), 0.2


def changes_of(first, second, targets=None):
    """The scans of each sensor at both times, with their first targets."""
    return [
        (replace(scan[:targets], time=0.0), replace(later[:targets], time=INTERVAL), at)
        for (scan, at), (later, _) in zip(first, second, strict=True)
    ]


def test_an_acceleration_is_seen_by_two_scans_of_each_sensor():
    """Breaks if a sensor's place is forgotten, or an error that both scans share counts."""
    rng, acceleration = np.random.default_rng(4), np.array([2.0, 0.2, 0.1])
    theta = np.array([12.0, 0.1, 0.05])
    for noise, limit in ((0.0, 0.3), (0.06, 4.0)):
        first = views_of(rng, theta, noise=noise)
        changes = changes_of(first, views_of(rng, theta + INTERVAL * acceleration, noise=noise))
        found = doppler_acceleration(changes, BEFORE)
        error = (found.value - acceleration) / np.sqrt(np.diag(found.covariance))
        assert np.abs(error).max() < limit
        assert found.covariance[0, 0] < 0.2 * BEFORE[0, 0]
    other = [(a, replace(b, doppler=b.doppler - 20.0), at) for a, b, at in changes]
    assert_array_equal(doppler_acceleration(other, BEFORE).value, np.zeros(3))


@pytest.mark.parametrize(
    ("targets", "sigmas", "believed"),
    [(6, 1.0, True), (4, 1.0, False), (9, 3.5, True), (9, 5.0, False)],
)
def test_a_change_of_velocity_is_believed_within_limits(targets, sigmas, believed):
    """Breaks if fewer than five targets show it, or it is off by four standard deviations."""
    first, second = (
        views_of(np.random.default_rng(4), np.array([speed, 0.0, 0.0]), noise=0.0)
        for speed in (12.0, 12.0 + 3.0 * sigmas * INTERVAL)
    )
    found = doppler_acceleration(changes_of(first, second, targets), BEFORE)
    assert found.value.any() == believed


def test_one_sensor_does_not_show_rotation_unless_the_vehicle_does_not_slip():
    """Breaks if what is not observable gets a covariance, or zero slip is not used."""
    theta = [17.0, 0.0, 0.35]
    views = views_of(np.random.default_rng(24), theta, noise=0.0, mountings=AROUND[:1])
    whole = doppler_ego_motion(views)
    assert np.isnan(whole.covariance).all()
    shown, true = (velocity_of_sensor(each, AROUND[0]) for each in (whole.theta, theta))
    assert_allclose(shown, true, rtol=0, atol=1e-8)
    fixed = doppler_ego_motion(views, side_slip=False)
    assert_allclose(fixed.theta, theta, rtol=0, atol=1e-8)
    assert_array_equal(fixed.covariance[1], np.zeros(3))
    assert (np.diag(fixed.covariance)[[0, 2]] > 0.0).all()


def test_empty_scans_show_nothing():
    """Breaks if a sensor without targets ends in an error, or hides the others."""
    views = views_of(np.random.default_rng(25), [17.0, 0.1, 0.35], noise=0.0)
    with_empty = [*views, (scan_of([], []), Mounting())]
    assert_array_equal(doppler_ego_motion(with_empty).theta, doppler_ego_motion(views).theta)
    nothing = doppler_ego_motion([(scan_of([], []), Mounting())])
    assert_array_equal(nothing.theta, np.zeros(3))
    assert np.isnan(nothing.covariance).all()
    assert_array_equal(sensor_velocity(scan_of([], []), Mounting()), [0.0, 0.0])


def test_views_come_from_any_iterable_or_are_refused_by_name():
    """Breaks if a generator is used up before all of it was read, or the error is Python's own."""
    views = views_of(np.random.default_rng(27), [17.0, 0.1, 0.35])
    found = doppler_ego_motion(iter(views))
    assert_array_equal(found.theta, doppler_ego_motion(views).theta)
    for given_views, said in (
        (None, "views must be a sequence, but is a NoneType"),
        ([], "views must hold at least one"),
        ([views[0][::-1]], r"views\[0\]\[0\] must be a RadarScan, but is a Mounting"),
    ):
        with pytest.raises(ValueError, match=f"^{said}"):
            doppler_ego_motion(given_views)
