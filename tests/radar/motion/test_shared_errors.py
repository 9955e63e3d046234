"""What errors that targets share do to an estimate, each term against estimating anew."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import sqrtm

from d2d import rigid
from d2d.radar import (
    EgoMotionModel,
    ErrorBudget,
    Mounting,
    RadarScan,
    doppler_velocity,
    estimate_ego_motion,
    propagate_joint_ego_motion,
    simulate_drive,
    track,
)
from d2d.radar.motion.pairs import scan_pair, scan_pairs
from d2d.radar.motion.shared_errors import accelerations, apply_budget

MOUNTINGS = Mounting(3.6, 0.8, 0.6), Mounting(3.4, -0.8, -0.7)
THETA = np.array([8.0, 0.1, 0.2])
SIGMAS = 0.1, 0.005, 0.05
INTERVAL = 0.1


def scan_at(time: float, mounting: Mounting, points: np.ndarray, rng) -> RadarScan:
    """Points in the world (n, 2) as the sensor of a vehicle that began at the origin sees them."""
    pose = rigid.exponential(THETA * time)
    seen = rigid.transform_means(rigid.inverse(pose), points) - [mounting.x, mounting.y]
    azimuth = np.arctan2(seen[:, 1], seen[:, 0]) - mounting.yaw
    doppler = doppler_velocity(THETA, azimuth, mounting)
    noise = rng.standard_normal((3, len(points))) * np.array(SIGMAS)[:, None]
    return RadarScan(
        time, np.hypot(*seen.T) + noise[0], azimuth + noise[1], doppler + noise[2], *SIGMAS
    )


def pairs_of_two_sensors():
    """The scans of two sensors on a turning vehicle, in pairs."""
    rng = np.random.default_rng(0)
    pairs = []
    for mounting in MOUNTINGS:
        angle = rng.uniform(-0.8, 0.8, 25) + mounting.yaw
        distance = rng.uniform(8.0, 40.0, 25)
        points = np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=-1)
        pairs.append((*(scan_at(t, mounting, points, rng) for t in (0.0, INTERVAL)), mounting))
    return pairs


def estimated(pairs):
    """The velocity that fits all pairs."""
    return estimate_ego_motion(*zip(*pairs, strict=True), initial=THETA)


def applied(budget: ErrorBudget):
    """Pairs, estimate, parts and delay of two sensors."""
    pairs = scan_pairs(*zip(*pairs_of_two_sensors(), strict=True))
    model = EgoMotionModel()
    problem = model.problem([scan_pair(*pair, model) for pair in pairs])
    estimate = estimated(pairs)
    assert estimate.converged
    return pairs, estimate, *apply_budget(problem, estimate, pairs, budget, INTERVAL)


def moved_by(change, pairs) -> np.ndarray:
    """Derivative (3,) of the joint estimate when ``change(pair, step)`` changes pairs of scans."""
    step = 1e-5
    found = [estimated([change(pair, by) for pair in pairs]).theta for by in (step, -step)]
    return (found[0] - found[1]) / (2.0 * step)


def test_the_noise_is_the_propagated_covariance():
    """Breaks if the compiled sum differs from that over the influences in NumPy."""
    pairs, estimate, parts, _ = applied(ErrorBudget())
    assert_allclose(parts.noise, propagate_joint_ego_motion(estimate, pairs), rtol=1e-10)
    assert_array_equal(parts.dependence, 0.0)
    assert_array_equal(parts.systematic, 0.0)
    assert_allclose(parts.noise, parts.noise.T, rtol=1e-12)


def test_an_azimuth_bias_moves_the_estimate_as_the_budget_says():
    """Breaks if a sensor's bias is not that of both its scans, or sensors are not independent."""
    pairs, _, parts, _ = applied(ErrorBudget(azimuth=0.01))
    expected = np.zeros((3, 3))
    for mounting in MOUNTINGS:

        def change(pair, by, mounting=mounting):
            if pair[2] != mounting:
                return pair
            return (*(replace(scan, azimuth=scan.azimuth + by) for scan in pair[:2]), mounting)

        moved = moved_by(change, pairs)
        expected += 0.01**2 * np.outer(moved, moved)
    # covariances and gains depend a little on the azimuths, which propagation holds
    assert_allclose(np.diag(parts.systematic), np.diag(expected), rtol=0.05)


def test_a_doppler_error_moves_the_estimate_as_the_budget_says():
    """Breaks if it is not shared by the targets of one scan, or is shared by both sensors."""
    pairs, _, parts, _ = applied(ErrorBudget(doppler=0.03))
    expected = np.zeros((3, 3))
    for mounting in MOUNTINGS:

        def change(pair, by, mounting=mounting):
            if pair[2] != mounting:
                return pair
            return pair[0], replace(pair[1], doppler=pair[1].doppler + by), mounting

        moved = moved_by(change, pairs)
        expected += 0.03**2 * np.outer(moved, moved)
    assert_allclose(parts.systematic, expected, rtol=1e-4, atol=1e-9)


def test_a_scale_error_is_shared_by_all_sensors():
    """Breaks if each sensor has a scale of its own, or a target's own speed is not its weight."""
    pairs, _, parts, _ = applied(ErrorBudget(scale=0.002))

    def change(pair, by):
        return pair[0], replace(pair[1], doppler=(1.0 + by) * pair[1].doppler), pair[2]

    moved = moved_by(change, pairs)
    assert_allclose(parts.systematic, 0.002**2 * np.outer(moved, moved), rtol=1e-4, atol=1e-9)


def test_neighbours_share_what_their_distance_says():
    """Breaks if the dependence is not the double sum over pairs of targets of one scan."""
    length = 2.0
    pairs, estimate, parts, _ = applied(ErrorBudget(neighbours=length))
    model = EgoMotionModel()
    problem = model.problem([scan_pair(*pair, model) for pair in pairs])
    cross = problem.cross_derivatives(problem.bind(estimate.theta), 0, 1)
    expected, fixed, moving = np.zeros((3, 3)), 0, 0
    for pair in problem.pairs:
        for points, block in (
            (pair.fixed, cross.fixed[0, fixed : fixed + pair.fixed.size]),
            (pair.moving, cross.moving[0, moving : moving + pair.moving.size]),
        ):
            rooted = block @ np.array([sqrtm(covariance) for covariance in points.covariances])
            apart = np.linalg.norm(points.means[:, None] - points.means, axis=-1)
            alike = np.where(apart < 5.0 * length, np.exp(-apart / length), 0.0)
            np.fill_diagonal(alike, 0.0)
            expected += np.einsum("kl,kid,ljd->ij", alike, rooted, rooted)
        fixed, moving = fixed + pair.fixed.size, moving + pair.moving.size
    gain = estimate.covariance
    assert_allclose(parts.dependence, gain @ expected @ gain, rtol=1e-9)


def test_no_part_depends_on_the_axes_of_the_vehicle_frame():
    """Breaks if the errors of neighbours correlate along x and y more than along other axes."""
    angle = 0.7
    turn = np.eye(3)
    turn[:2, :2] = rigid.rotation(-angle)
    budget = ErrorBudget(azimuth=0.002, doppler=0.03, scale=0.002, neighbours=2.0)
    drive = simulate_drive(np.random.default_rng(8), duration=1.0)
    place = Mounting(3.6, 0.7, 0.4)
    x, y = turn[:2, :2] @ [place.x, place.y]
    found, turned = (
        track((drive.scans, mounting), budget=budget, limits=None)
        for mounting in (place, Mounting(x, y, place.yaw - angle))
    )
    assert found.converged.all()
    assert_allclose(turned.theta, found.theta @ turn.T, atol=1e-6)
    for own, other in zip(found.parts, turned.parts, strict=True):
        size = np.abs(own).max()
        assert_allclose(other, turn @ own @ turn.T, rtol=0, atol=1e-5 * size)


def test_the_delay_is_how_far_an_accelerating_vehicle_is_ahead():
    """Breaks if an estimate is not carried from the middle of the interval to its time."""
    pairs, _, _, delay = applied(ErrorBudget())
    acceleration = np.array([2.0, 0.0, 0.5])

    def change(pair, by):
        """Doppler velocities of a vehicle that moves faster at the later scan than on average."""
        previous, current, mounting = pair
        angle = current.azimuth + mounting.yaw
        extra = 0.5 * INTERVAL * acceleration * by
        along = extra[0] - extra[2] * mounting.y, extra[1] + extra[2] * mounting.x
        change = -along[0] * np.cos(angle) - along[1] * np.sin(angle)
        return previous, replace(current, doppler=current.doppler + change), mounting

    # the mean velocity of the interval stays, so that its end is half an interval's gain ahead
    moved = moved_by(change, pairs)
    true = 0.5 * INTERVAL * acceleration
    assert_allclose(moved - delay @ acceleration, true, rtol=1e-3, atol=1e-6)


def test_accelerations_are_slopes_of_half_a_second_to_either_side():
    """Breaks if the window or the least squares differ from a fit at each time."""
    rng = np.random.default_rng(0)
    times = 1.6e9 + np.sort(rng.uniform(0.0, 6.0, 60))
    theta = rng.standard_normal((60, 3))
    found = accelerations(times, theta)
    for i, t in enumerate(times):
        near = np.abs(times - t) <= 0.5
        expected = np.polyfit(times[near] - t, theta[near], 1)[0] if near.sum() > 1 else 0.0
        assert_allclose(found[i], expected, rtol=1e-4, atol=1e-4)
    assert_array_equal(accelerations(np.array([1.0, 9.0]), np.ones((2, 3))), 0.0)
    assert accelerations(np.empty(0), np.empty((0, 3))).shape == (0, 3)


@pytest.mark.parametrize("origin", [0.0, 0.3, 1.6e9 + 0.7])
def test_the_origin_of_the_clock_does_not_decide_on_accelerations(origin):
    """Breaks if rounding decides whether estimates exactly half a second away count."""
    times = np.arange(40) * 0.1
    theta = np.random.default_rng(1).standard_normal((40, 3))
    expected = accelerations(times, theta)
    assert_allclose(accelerations(origin + times, theta), expected, rtol=1e-4, atol=1e-5)


def test_a_long_drive_at_constant_velocity_shows_no_acceleration():
    """Breaks if sums along the drive lose the digits that the slope of a few estimates needs."""
    rng = np.random.default_rng(1)
    times = np.cumsum(rng.uniform(0.2, 0.8, 40000))  # five and a half hours, many alone
    velocity = np.tile([30.0, 0.1, 0.02], (len(times), 1))
    assert_array_equal(accelerations(times, velocity), 0.0)
