"""Ego-motion from pairs of scans and along drives.

The joint cost of thesis eq. 7.14 is written once more, target by target with scipy.stats, as a
function of the velocity; nothing of the package takes part in it but the scans' numbers.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import expm
from scipy.stats import multivariate_normal, norm

from d2d import CorruptedGaussian, UniformOutlier, credibility
from d2d.radar import (
    Drive,
    Mounting,
    RadarScan,
    Reference,
    Sensor,
    Track,
    doppler_velocity,
    estimate_ego_motion,
    estimate_joint_ego_motion,
    inlier_probabilities,
    simulate_drive,
    track,
    track_joint,
)
from d2d.radar.motion.model import DEFAULT_OUTLIER
from d2d.radar.tracks.joint import rounds
from d2d.radar.tracks.one_sensor import MIN_EXPLAINED, integrate

CORNER = Mounting(3.86, 0.7, 0.436)
SIGMAS = (0.15, np.deg2rad(0.5), 0.06)


def arc(theta, time: float) -> np.ndarray:
    """Pose matrix (3, 3) after ``time`` at the constant body velocity."""
    v_x, v_y, omega = theta
    return expm(time * np.array([[0.0, -omega, v_x], [omega, 0.0, v_y], [0.0, 0.0, 0.0]]))


def frame(mounting: Mounting) -> np.ndarray:
    """Pose matrix (3, 3) of the sensor in the vehicle."""
    turn = arc([0.0, 0.0, mounting.yaw], 1.0)
    turn[:2, 2] = mounting.x, mounting.y
    return turn


def observe(points, pose, time, theta, mounting, noise, sigmas) -> RadarScan:
    """Measurements of world points (n, 2) by the vehicle at ``pose``."""
    local = np.linalg.solve(
        pose @ frame(mounting), np.column_stack([points, np.ones(len(points))]).T
    )
    distance, azimuth = np.hypot(local[0], local[1]), np.arctan2(local[1], local[0])
    doppler = doppler_velocity(theta, azimuth, mounting)
    return RadarScan(
        time,
        distance + sigmas[0] * noise[0],
        azimuth + sigmas[1] * noise[1],
        doppler + sigmas[2] * noise[2],
        *sigmas,
    )


def scan_pair(
    rng, theta, mounting=CORNER, size=20, interval=0.1, sigmas=SIGMAS, noisy=True
) -> tuple[RadarScan, RadarScan]:
    """Two scans of the same static targets, 45 degrees to either side and 5 to 50 m away."""
    distance, azimuth = 50.0 * np.sqrt(rng.uniform(0.01, 1.0, size)), rng.uniform(-0.8, 0.8, size)
    ahead = np.stack([distance * np.cos(azimuth), distance * np.sin(azimuth), np.ones(size)])
    points = (arc(theta, interval) @ frame(mounting) @ ahead)[:2].T
    noise = rng.standard_normal((2, 3, size)) * noisy
    return (
        observe(points, np.eye(3), 5.0, theta, mounting, noise[0], sigmas),
        observe(points, arc(theta, interval), 5.0 + interval, theta, mounting, noise[1], sigmas),
    )


def naive_targets(scan: RadarScan, mounting: Mounting) -> list[tuple[np.ndarray, np.ndarray]]:
    """Mean and covariance of each target in the vehicle frame."""
    found = []
    for r, phi, sr, sp in zip(
        scan.range, scan.azimuth, scan.sigma_range, scan.sigma_azimuth, strict=True
    ):
        c, s = np.cos(phi + mounting.yaw), np.sin(phi + mounting.yaw)
        radial, across = np.array([c, s]), np.array([-s, c])
        mean = np.array([mounting.x, mounting.y]) + r * radial
        spread = sr**2 * np.outer(radial, radial) + (r * sp) ** 2 * np.outer(across, across)
        found.append((mean, spread))
    return found


def normal_density(x, mean, covariance) -> float:
    """The normal density at x (D,); that of SciPy takes several times as long."""
    away = np.subtract(x, mean)
    exponent = -0.5 * away @ np.linalg.solve(covariance, away)
    return np.exp(exponent) / np.sqrt(np.linalg.det(2.0 * np.pi * np.asarray(covariance)))


def test_the_naive_density_is_that_of_scipy():
    """Breaks if the reference that estimates are compared with is itself wrong."""
    x, mean, covariance = [1.0, -2.0], [0.4, 0.3], np.array([[2.0, 0.6], [0.6, 0.5]])
    expected = multivariate_normal.pdf(x, mean, covariance)
    assert normal_density(x, mean, covariance) == pytest.approx(expected, rel=1e-12)
    expected = norm.pdf(1.3, 0.2, 0.7)
    assert normal_density([1.3], [0.2], [[0.49]]) == pytest.approx(expected, rel=1e-12)


def naive_cost(theta, previous, current, mounting, outlier, doppler, first_order) -> float:
    """-sum_k log((1 - alpha) inlier_k Doppler_k + alpha outlier_k / width), in the velocity theta.

    The width is that of an outlier's uniform Doppler density, 1 without Doppler velocities.
    """
    width = 4.0 if doppler else 1.0
    tau = current.time - previous.time
    v_x, v_y, omega = theta
    motion = arc([0.0, 0.0, omega], tau) if first_order else arc(theta, tau)
    turn, shift = motion[:2, :2], motion[:2, 2]
    if first_order:
        shift = tau * np.array([v_x, v_y])
    fixed, total = naive_targets(previous, mounting), 0.0
    for k, (mean, spread) in enumerate(naive_targets(current, mounting)):
        moved, turned = turn @ mean + shift, turn @ spread @ turn.T
        inlier = far = 0.0
        for center, own in fixed:
            inlier += normal_density(moved, center, turned + own) / len(fixed)
            if isinstance(outlier, CorruptedGaussian):
                far += normal_density(moved, center, outlier.covariance) / len(fixed)
        if doppler:
            angle = current.azimuth[k] + mounting.yaw
            u_x, u_y = v_x - omega * mounting.y, v_y + omega * mounting.x
            expected = -u_x * np.cos(angle) - u_y * np.sin(angle)
            slope = u_x * np.sin(angle) - u_y * np.cos(angle)
            sigma = np.hypot(current.sigma_doppler[k], slope * current.sigma_azimuth[k])
            inlier *= normal_density([current.doppler[k]], [expected], [[sigma**2]])
        if isinstance(outlier, CorruptedGaussian):
            total -= np.log((1.0 - outlier.fraction) * inlier + outlier.fraction * far / width)
        else:
            total -= np.log(inlier + (outlier.density / width if outlier else 0.0))
    return total


def derivative_along(function, direction, step=0.03) -> tuple[float, float]:
    """First and second derivative at 0, fourth-order differences."""
    far, near, here, ahead, beyond = (function(i * step * direction) for i in (-2, -1, 0, 1, 2))
    first = (far - 8.0 * near + 8.0 * ahead - beyond) / (12.0 * step)
    second = (-far + 16.0 * near - 30.0 * here + 16.0 * ahead - beyond) / (12.0 * step**2)
    return first, second


def assert_optimum_of(estimate, cost) -> None:
    """The estimate is at a minimum of ``cost``, with its value, Hessian and inverse Hessian.

    Derivatives are taken in units of the estimated standard deviations.
    """
    root = np.linalg.cholesky(estimate.covariance)

    def shifted(offset):
        return cost(estimate.theta + root @ offset)

    assert estimate.value == pytest.approx(shifted(np.zeros(3)), rel=1e-10)
    axes = np.eye(3)
    slopes, curvatures = np.transpose([derivative_along(shifted, axis) for axis in axes])
    assert_allclose(slopes, 0.0, atol=1e-5)
    naive = np.diag(curvatures)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        mixed = derivative_along(shifted, axes[i] + axes[j])[1]
        naive[i, j] = naive[j, i] = 0.5 * (mixed - curvatures[i] - curvatures[j])
    assert_allclose(root.T @ estimate.hessian @ root, naive, rtol=0, atol=1e-5)
    assert_allclose(estimate.covariance @ estimate.hessian, np.eye(3), atol=1e-8)


@pytest.mark.parametrize("doppler", [True, False], ids=["doppler", "positions"])
@pytest.mark.parametrize("first_order", [True, False], ids=["first-order", "exact"])
@pytest.mark.parametrize(
    "outlier", [DEFAULT_OUTLIER, UniformOutlier(1e-3)], ids=["corrupted", "uniform"]
)
def test_inlier_probabilities_are_bayes_rule(doppler, first_order, outlier):
    """Breaks if a share is not the inlier part of that target's naive density."""
    theta = np.array([12.0, -0.5, 0.6])
    previous, current = scan_pair(np.random.default_rng(3), theta, size=7)
    changed = current.doppler + np.array([0, 0, 0.1, 0, 1.0, 0, 0])
    current = RadarScan(current.time, current.range, current.azimuth, changed, *SIGMAS)
    shares = inlier_probabilities(
        theta, previous, current, CORNER, doppler=doppler, outlier=outlier, first_order=first_order
    )
    prior = 1.0 - getattr(outlier, "fraction", 0.0)
    for k, share in enumerate(shares):
        rest = (theta, previous, current[k : k + 1], CORNER)
        inlier, both = (
            np.exp(-naive_cost(*rest, model, doppler, first_order)) for model in (None, outlier)
        )
        assert share == pytest.approx(prior * inlier / both, rel=1e-9, abs=3e-16)
    assert (shares[4] < 1e-3) == doppler
    assert (shares[[0, 1, 3, 5, 6]] > 0.5).all()


@pytest.mark.parametrize("doppler", [True, False], ids=["doppler", "positions"])
@pytest.mark.parametrize("first_order", [True, False], ids=["first-order", "exact"])
@pytest.mark.parametrize(
    "mounting", [Mounting(), CORNER, Mounting(-0.9, -0.87, -2.9)], ids=["origin", "left", "rear"]
)
@pytest.mark.parametrize(
    "outlier", [DEFAULT_OUTLIER, UniformOutlier(1e-3), None], ids=["corrupted", "uniform", "none"]
)
def test_the_estimate_is_the_optimum_of_the_naive_joint_cost(
    doppler, first_order, mounting, outlier
):
    """Breaks with any slip in the cost, or if gradient or Hessian are not those of the velocity.

    Differences are taken in standard deviations of the estimate, in which the Hessian is I.
    """
    theta = np.array([12.0, -0.5, 0.6])
    previous, current = scan_pair(np.random.default_rng(21), theta, mounting, size=7)
    if outlier is not None:  # one target that has moved, one that is new
        changed = current.doppler + np.array([0, 0, 4.0, 0, 0, 0, 0])
        distance = current.range + np.array([0, 0, 0, 0, 6.0, 0, 0])
        current = RadarScan(current.time, distance, current.azimuth, changed, *SIGMAS)
    estimate = estimate_ego_motion(
        previous,
        current,
        mounting,
        doppler=doppler,
        outlier=outlier,
        initial=theta,
        first_order=first_order,
    )
    assert estimate.converged

    def cost(theta):
        return naive_cost(theta, previous, current, mounting, outlier, doppler, first_order)

    assert_optimum_of(estimate, cost)


@pytest.mark.parametrize("doppler", [True, False], ids=["doppler", "positions"])
@pytest.mark.parametrize(
    "theta",
    [[0.0, 0.0, 0.0], [8.0, 0.0, 0.0], [15.0, -0.4, 0.5], [-2.0, 0.1, -0.3]],
    ids=["standing", "straight", "bend", "reversing"],
)
@pytest.mark.parametrize("sharp", [False, True], ids=["from-doppler", "sharp-near-truth"])
def test_a_noise_free_motion_is_recovered(theta, doppler, sharp):
    """Breaks if scans are registered the wrong way round, or against another interval.

    Not exactly: neighbours pull, and covariances that differ in direction between the scans move
    the optimum, the less the smaller the sigmas are.
    """
    sigmas = (0.01, 1e-4, 0.01) if sharp else SIGMAS
    start = np.add(theta, [0.02, -0.02, 0.001]) if sharp else None
    previous, current = scan_pair(np.random.default_rng(22), theta, sigmas=sigmas, noisy=False)
    estimate = estimate_ego_motion(previous, current, CORNER, doppler=doppler, initial=start)
    assert estimate.converged
    deviations = np.sqrt(np.diag(estimate.covariance))
    assert (np.abs(estimate.theta - theta) < (0.001 if sharp else 0.2) * deviations).all()
    if sharp:
        assert_allclose(estimate.theta, theta, rtol=0, atol=1e-5)


def test_fast_car_among_moving_ones_needs_no_start():
    """Breaks if the default start is zero, which ends in a wrong optimum here, or not robust."""
    rng, theta, size = np.random.default_rng(23), np.array([30.0, 0.2, 0.05]), 40
    from_doppler, from_zero = [], []
    for _ in range(25):
        previous, current = scan_pair(rng, theta, size=size, interval=0.075)
        moving = np.arange(size) < 12
        distance = np.where(moving, current.range + rng.uniform(-2.0, 2.0, size), current.range)
        doppler = np.where(moving, current.doppler + rng.uniform(-25, 25, size), current.doppler)
        current = RadarScan(current.time, distance, current.azimuth, doppler, *SIGMAS)
        estimate = estimate_ego_motion(previous, current, CORNER)
        assert estimate.converged
        from_doppler.append(estimate.theta - theta)
        from_zero.append(
            estimate_ego_motion(previous, current, CORNER, initial=np.zeros(3)).theta - theta
        )
    assert np.abs(from_doppler)[:, 0].max() < 0.3
    assert np.abs(from_doppler)[:, 1].max() < 1.0
    assert np.abs(from_zero)[:, 0].max() > 1.0, "the scene is too easy to tell starts apart"


@pytest.mark.parametrize("doppler", [True, False], ids=["doppler", "positions"])
def test_covariances_are_credible(doppler):
    """Breaks if the covariance is not of the velocity, too large or too small by a few percent."""
    rng, theta = np.random.default_rng(24), np.array([10.0, 0.3, 0.3])
    errors, covariances = [], []
    for _ in range(1000):  # few targets, so that it is clear which meets which
        pair = scan_pair(rng, theta, size=12)
        estimate = estimate_ego_motion(*pair, CORNER, doppler=doppler)
        if estimate.converged:
            errors.append(estimate.theta - theta)
            covariances.append(estimate.covariance)
    assert len(errors) > 990
    judged = credibility(np.array(errors), np.array(covariances))
    assert judged.consistent, f"ANEES {judged.anees:.3f} outside {judged.bounds}"
    assert abs(judged.inclination) < 0.5


def test_first_order_takes_the_chord_for_the_velocity():
    """Breaks if first_order changes the motion that is found, and not only how it is read."""
    theta = np.array([10.0, 0.0, 1.0])
    previous, current = scan_pair(np.random.default_rng(25), theta)
    exact, first = (
        estimate_ego_motion(previous, current, CORNER, doppler=False, first_order=flag)
        for flag in (False, True)
    )
    chord = arc(exact.theta, 0.1)[:2, 2] / 0.1
    assert_allclose(first.theta, [*chord, exact.theta[2]], rtol=0, atol=1e-6)
    assert first.theta[1] - exact.theta[1] > 0.4  # v omega tau / 2


def test_a_different_interval_scales_the_velocity():
    """Breaks if the interval is taken from elsewhere than the scans' times."""
    previous, current = scan_pair(np.random.default_rng(26), [5.0, 0.0, 0.1])
    later = RadarScan(
        previous.time + 2 * (current.time - previous.time),
        current.range,
        current.azimuth,
        current.doppler,
        *SIGMAS,
    )
    slow = estimate_ego_motion(previous, later, CORNER, doppler=False, initial=[2.5, 0, 0.05])
    fast = estimate_ego_motion(previous, current, CORNER, doppler=False, initial=[5.0, 0, 0.1])
    assert_allclose(slow.theta, fast.theta / 2.0, rtol=1e-6, atol=1e-9)
    assert_allclose(slow.covariance, fast.covariance / 4.0, rtol=1e-6, atol=1e-12)


def test_scales_reach_the_optimum_from_a_far_start():
    """Breaks if the schedule is not handed on to the registration."""
    theta = np.array([40.0, 0.0, 0.0])
    previous, current = scan_pair(np.random.default_rng(27), theta)
    options = {"doppler": False, "initial": np.zeros(3)}
    direct = estimate_ego_motion(previous, current, CORNER, **options)
    annealed = estimate_ego_motion(previous, current, CORNER, scales=(8, 4, 2, 1), **options)
    assert abs(direct.theta[0] - 40.0) > 10.0, "the start is too near to tell"
    assert abs(annealed.theta[0] - 40.0) < 3.0 * np.sqrt(annealed.covariance[0, 0])
    assert annealed.value < direct.value


@pytest.mark.parametrize("later", [0.0, -0.1])
def test_scans_out_of_time_order_are_refused(later):
    """Breaks if a zero interval divides, or time runs backwards."""
    scan = scan_pair(np.random.default_rng(28), [5.0, 0.0, 0.0])[0]
    other = RadarScan(scan.time + later, scan.range, scan.azimuth, scan.doppler, *SIGMAS)
    with pytest.raises(ValueError, match=r"^current must be later than previous"):
        estimate_ego_motion(scan, other, CORNER)


@pytest.mark.parametrize("which", ["previous", "current"])
def test_an_empty_scan_is_refused_by_name(which):
    """Breaks if the error comes from the point set and does not say which scan."""
    scans = dict(
        zip(("previous", "current"), scan_pair(np.random.default_rng(29), [5.0, 0, 0]), strict=True)
    )
    scans[which] = scans[which][:0]
    with pytest.raises(ValueError, match=f"^{which} holds no targets"):
        estimate_ego_motion(**scans, mounting=CORNER)


@pytest.mark.parametrize(
    "initial", [1.0, [1.0, 2.0], [1.0, 2.0, 3.0, 4.0], [1.0, 2.0, np.nan]], ids=str
)
def test_a_wrong_start_is_refused_by_name(initial):
    """Breaks if the error speaks of twists and thetas that the caller never gave."""
    with pytest.raises(ValueError, match=r"^initial must"):
        estimate_ego_motion(
            *scan_pair(np.random.default_rng(30), [5.0, 0, 0]), CORNER, initial=initial
        )


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_batch_of_starts_is_refused_by_name(count):
    """Breaks if several starts get through: the covariances of three came out wrong in silence."""
    with pytest.raises(ValueError, match=r"^initial must have the shape \(3,\)"):
        estimate_ego_motion(
            *scan_pair(np.random.default_rng(31), [5.0, 0, 0]), CORNER, initial=np.ones((count, 3))
        )


# ---- several sensors at once

MOUNTINGS = (CORNER, Mounting(3.6, -0.9, -1.48), Mounting(-0.9, -0.87, -2.9))


def joint_pairs(rng, theta, size=7, mountings=MOUNTINGS, **options):
    """A pair of scans of each sensor, over intervals of their own and not at the same times."""
    pairs = []
    for i, mounting in enumerate(mountings):
        previous, current = scan_pair(
            rng, theta, mounting, size=size, interval=0.07 + 0.02 * i, **options
        )
        pairs.append((at_time(previous, previous.time + 0.01 * i), current, mounting))
        pairs[-1] = (pairs[-1][0], at_time(current, current.time + 0.01 * i), mounting)
    return pairs


def at_time(scan: RadarScan, time: float) -> RadarScan:
    """The scan with another time stamp."""
    return RadarScan(
        time,
        scan.range,
        scan.azimuth,
        scan.doppler,
        scan.sigma_range,
        scan.sigma_azimuth,
        scan.sigma_doppler,
    )


@pytest.mark.parametrize("doppler", [True, False], ids=["doppler", "positions"])
@pytest.mark.parametrize("outlier", [DEFAULT_OUTLIER, None], ids=["corrupted", "none"])
def test_the_joint_estimate_is_the_optimum_of_the_sum_of_naive_costs(doppler, outlier):
    """Breaks if a pair's interval, mounting or chain rule is another's, or one is left out."""
    theta = np.array([12.0, -0.5, 0.6])
    pairs = joint_pairs(np.random.default_rng(60), theta)
    if outlier is not None:  # one target that has moved
        previous, current, mounting = pairs[1]
        changed = current.doppler + np.array([0, 0, 4.0, 0, 0, 0, 0])
        pairs[1] = previous, with_doppler(current, changed), mounting
    estimate = estimate_joint_ego_motion(pairs, doppler=doppler, outlier=outlier, initial=theta)
    assert estimate.converged

    def cost(theta):
        return sum(naive_cost(theta, *pair, outlier, doppler, False) for pair in pairs)

    assert_optimum_of(estimate, cost)


@pytest.mark.parametrize("doppler", [True, False], ids=["doppler", "positions"])
@pytest.mark.parametrize("scales", [(1.0,), (8.0, 4.0, 2.0, 1.0)], ids=["direct", "annealed"])
def test_one_pair_alone_gives_what_a_single_sensor_gives(doppler, scales):
    """Breaks if the optimiser stops early, or the covariance is not of the velocity."""
    pair = (*scan_pair(np.random.default_rng(61), [12.0, -0.5, 0.6], size=30), CORNER)
    options = {"doppler": doppler, "initial": [11.5, 0.0, 0.5], "scales": scales}
    alone = estimate_ego_motion(*pair, **options)
    joint = estimate_joint_ego_motion([pair], **options)
    assert joint.converged
    assert_allclose(joint.theta, alone.theta, rtol=0, atol=1e-6)
    assert_allclose(joint.covariance, alone.covariance, rtol=1e-5)
    assert joint.value == pytest.approx(float(alone.value), rel=1e-12)


def test_joint_covariances_are_credible_and_smaller_than_each_sensor_s():
    """Breaks if the sum's Hessian is not that of the velocity, or sensors are weighed wrongly."""
    rng, theta = np.random.default_rng(62), np.array([10.0, 0.3, 0.3])
    errors, covariances = [], []
    for _ in range(150):
        pairs = joint_pairs(rng, theta, size=6)
        estimate = estimate_joint_ego_motion(pairs)
        assert estimate.converged
        errors.append(estimate.theta - theta)
        covariances.append(estimate.covariance)
    judged = credibility(np.array(errors), np.array(covariances))
    assert judged.consistent, f"ANEES {judged.anees:.3f} outside {judged.bounds}"
    for pair in pairs:
        alone = estimate_ego_motion(*pair, initial=theta)
        assert np.linalg.eigvalsh(alone.covariance - covariances[-1]).min() > 0.0


def test_joint_start_comes_from_all_sensors_doppler_velocities():
    """Breaks if the default start is zero, from where the positions find another optimum."""
    theta = np.array([40.0, 0.2, 0.4])
    pairs = joint_pairs(np.random.default_rng(63), theta, size=40)
    estimate = estimate_joint_ego_motion(pairs, doppler=False)
    assert estimate.converged
    assert (np.abs(estimate.theta - theta) < 4.0 * np.sqrt(np.diag(estimate.covariance))).all()
    from_zero = estimate_joint_ego_motion(pairs, doppler=False, initial=np.zeros(3))
    assert np.abs(from_zero.theta - theta)[0] > 1.0, "the scene is too easy to tell starts apart"


def test_a_joint_start_that_the_doppler_velocities_do_not_show_is_tried_both_ways():
    """Breaks if a single sensor, whose yaw rate Doppler cannot tell, has no start."""
    pair = (*scan_pair(np.random.default_rng(64), [25.0, 0.0, 0.5], size=30), CORNER)
    assert_allclose(
        estimate_joint_ego_motion([pair]).theta, estimate_ego_motion(*pair).theta, atol=1e-6
    )


@pytest.mark.parametrize("initial", [1.0, [1.0, 2.0], [1.0, 2.0, np.nan], np.ones((2, 3))], ids=str)
def test_a_wrong_joint_start_is_refused_by_name(initial):
    """Breaks if it fails in the optimiser instead."""
    pairs = joint_pairs(np.random.default_rng(65), [5.0, 0.0, 0.0])
    with pytest.raises(ValueError, match=r"^initial must"):
        estimate_joint_ego_motion(pairs, initial=initial)


def test_no_pair_or_an_empty_or_swapped_scan_is_refused_by_name():
    """Breaks if a sum over nothing is minimised."""
    previous, current, mounting = joint_pairs(np.random.default_rng(66), [5.0, 0.0, 0.0])[0]
    with pytest.raises(ValueError, match=r"^pairs must hold at least one"):
        estimate_joint_ego_motion([])
    with pytest.raises(ValueError, match=r"^current holds no targets"):
        estimate_joint_ego_motion([(previous, current[:0], mounting)])
    with pytest.raises(ValueError, match=r"^current must be later"):
        estimate_joint_ego_motion([(current, previous, mounting)])


@pytest.mark.parametrize(
    ("times", "expected"),
    [
        ([[0.0, 1.0, 2.0]], [[(0, 0)], [(0, 1)], [(0, 2)]]),
        ([[0.0, 1.0], [0.5, 1.5]], [[(0, 0), (1, 0)], [(0, 1), (1, 1)]]),
        ([[0.5, 1.5], [0.0, 1.0]], [[(1, 0), (0, 0)], [(1, 1), (0, 1)]]),
        # the second sensor misses its turn, and comes back
        ([[0.0, 1.0, 2.0], [0.1, 2.1]], [[(0, 0), (1, 0)], [(0, 1)], [(0, 2), (1, 1)]]),
        ([[0.0, 1.0], [0.0, 1.0]], [[(0, 0), (1, 0)], [(0, 1), (1, 1)]]),
        ([[], [0.0]], [[(1, 0)]]),
        # at equal times, sensors stay together whichever is named first and starts late
        ([[0.0, 1.0, 2.0], [1.0, 2.0]], [[(0, 0)], [(0, 1), (1, 0)], [(0, 2), (1, 1)]]),
        ([[1.0, 2.0], [0.0, 1.0, 2.0]], [[(1, 0)], [(0, 0), (1, 1)], [(0, 1), (1, 2)]]),
    ],
    ids=["alone", "in-turn", "other-first", "missing", "same-time", "never", "late", "late-first"],
)
def test_rounds_hold_each_sensor_once_and_follow_time(times, expected):
    """Breaks if a scan is used twice or never, or a gap of one sensor stops the others."""
    scan = scan_pair(np.random.default_rng(67), [5.0, 0.0, 0.0])[0]
    assert rounds([[at_time(scan, t) for t in own] for own in times]) == expected


# ---- along a drive


@cache
def whole_drive(seed: int) -> Drive:
    """A simulated drive of a minute, simulated once."""
    return simulate_drive(np.random.default_rng(seed), 60.0, mounting=CORNER)


def drive(count: int = 40, seed: int = 0) -> Drive:
    """The beginning of a simulated drive."""
    whole = whole_drive(seed)
    truth = whole.truth
    part = Reference(truth.times[:count], truth.theta[:count], truth.poses[:count])
    return replace(whole, scans=whole.scans[:count], truth=part)


def with_doppler(scan: RadarScan, doppler) -> RadarScan:
    """The scan with other Doppler velocities."""
    return RadarScan(
        scan.time,
        scan.range,
        scan.azimuth,
        np.broadcast_to(doppler, scan.range.shape),
        scan.sigma_range,
        scan.sigma_azimuth,
        scan.sigma_doppler,
    )


def straight_scans(count: int = 12, seed: int = 40) -> tuple[list[RadarScan], np.ndarray]:
    """Scans of one world from a car at 12 m/s, too fast to be registered from a start at zero."""
    rng, theta = np.random.default_rng(seed), np.array([12.0, 0.0, 0.1])
    points = rng.uniform([-10.0, -60.0], [90.0, 60.0], (400, 2))
    scans = []
    for i in range(count):
        pose = arc(theta, 0.1 * i)
        noise = rng.standard_normal((3, len(points)))
        full = observe(points, pose, 0.1 * i, theta, CORNER, noise, (0.05, 1e-3, 0.06))
        scans.append(full[(np.abs(full.azimuth) < 0.8) & (full.range < 45.0)])
    return scans, theta


def test_track_estimates_each_pair_of_a_drive():
    """Breaks if pairs are skipped, or times are not those of each pair's later scan."""
    driven = drive()
    result = track(driven.scans, driven.mounting)
    times = np.array([scan.time for scan in driven.scans])
    assert_allclose(result.times, times[1:])
    assert_allclose(result.intervals, np.diff(times))
    assert result.converged.all()
    assert result.converged.dtype == bool
    for i in (0, 7, len(times) - 2):
        alone = estimate_ego_motion(
            *driven.scans[i : i + 2], driven.mounting, initial=driven.truth.theta[i]
        )
        assert_allclose(result.theta[i], alone.theta, rtol=0, atol=1e-5)
        assert_allclose(result.covariance[i], alone.covariance, rtol=1e-4)


def test_a_fast_drive_is_not_lost():
    """Breaks if the last velocity is the only start: 2 pairs in 100 then end elsewhere."""
    drive = simulate_drive(np.random.default_rng(0), 10.0, 20.0)
    found = track(drive.scans, drive.mounting)
    assert found.converged.all()
    assert (np.abs(found.theta - drive.truth.theta[1:])[:, 0] < 0.5).all()


def test_each_pair_starts_at_the_last_velocity():
    """Breaks if each scan starts from its own Doppler velocities, which are nonsense here."""
    scans, theta = straight_scans()
    scans[2:] = [with_doppler(scan, 25.0) for scan in scans[2:]]
    result = track(scans, CORNER, doppler=False)
    assert result.converged.all()
    assert np.abs(result.theta - theta)[:, 0].max() < 0.6
    lost = estimate_ego_motion(scans[3], scans[4], CORNER, doppler=False)
    assert abs(lost.theta[0] - 12.0) > 2.0, "the Doppler start is too good to tell"


def test_initial_starts_the_first_pair():
    """Breaks if the option is dropped, or given to every pair."""
    scans, theta = straight_scans()
    scans = [with_doppler(scan, 25.0) for scan in scans]
    with_start = track(scans, CORNER, doppler=False, initial=theta)
    without = track(scans, CORNER, doppler=False)
    assert np.abs(with_start.theta - theta)[:, 0].max() < 0.6
    assert abs(without.theta[0, 0] - 12.0) > 2.0, "the Doppler start is too good to tell"


def test_options_reach_the_estimate():
    """Breaks if track does not hand on what it does not know itself."""
    driven = drive(10)
    with_it, without = (track(driven.scans, driven.mounting, doppler=d) for d in (True, False))
    assert (with_it.covariance[:, 0, 0] < 0.2 * without.covariance[:, 0, 0]).all()
    with pytest.raises(TypeError, match="dopler"):
        track(driven.scans, driven.mounting, dopler=True)


@pytest.mark.parametrize("doppler", [True, False])
def test_an_empty_scan_does_not_lose_the_drive(doppler):
    """Breaks if the drive ends there, or a pair without an estimate looks like a good one."""
    driven = drive()
    scans = list(driven.scans)
    scans[10] = scans[10][:0]
    result = track(scans, driven.mounting, doppler=doppler)
    lost = np.zeros(len(scans) - 1, dtype=bool)
    lost[9:11] = True
    assert_array_equal(result.converged, ~lost)
    assert np.isnan(result.covariance[lost]).all()
    assert np.isfinite(result.covariance[~lost]).all()
    assert_array_equal(result.theta[9], result.theta[8])
    assert_array_equal(result.theta[10], result.theta[8])
    whole = track(driven.scans, driven.mounting, doppler=doppler)
    assert_allclose(result.theta[11:], whole.theta[11:], rtol=0, atol=1e-4)
    assert np.isfinite(result.poses()).all()


def test_empty_scans_at_the_beginning_leave_the_start_to_the_first_good_pair():
    """Breaks if a prediction of zero is taken for an estimate to start from."""
    driven = drive(10)
    scans = [driven.scans[0][:0], driven.scans[1][:0], *driven.scans[2:]]
    result = track(scans, driven.mounting)
    assert_array_equal(result.converged[:3], [False, False, True])
    assert_array_equal(result.theta[:2], np.zeros((2, 3)))
    assert np.abs(result.theta[2:, 0] - driven.truth.theta[3:, 0]).max() < 0.1


def test_a_scan_of_another_place_does_not_lose_the_drive():
    """Breaks if an estimate that did not converge becomes the start of the next pair."""
    scans, theta = straight_scans()
    far = scans[5]
    scans[5] = RadarScan(
        far.time, far.range + 5000.0, far.azimuth, far.doppler, 0.05, 1e-3, far.sigma_doppler
    )
    result = track(scans, CORNER, doppler=False, outlier=UniformOutlier(1e-3))
    assert_array_equal(np.flatnonzero(~result.converged), [4, 5])
    assert_array_equal(result.theta[4:6], result.theta[[3, 3]])
    assert np.abs(result.theta - theta)[:, 0].max() < 0.6


@pytest.mark.parametrize("count", [0, 1])
def test_a_track_needs_two_scans(count):
    """Breaks if nothing is returned as a track of nothing."""
    with pytest.raises(ValueError, match=r"^scans must hold at least two scans"):
        track(drive(10).scans[:count], CORNER)


@pytest.mark.parametrize("order", [[0, 2, 1, 3], [0, 1, 1, 2]], ids=["swapped", "twice"])
def test_a_track_out_of_time_order_is_refused(order):
    """Breaks if the error comes only when half of the drive is estimated, or does not say where."""
    scans = drive(10).scans
    with pytest.raises(ValueError, match=r"^scans must be in strictly increasing time, but scan 2"):
        track([scans[i] for i in order], CORNER)


def test_a_wrong_start_of_a_track_is_refused():
    """Breaks if the first pair swallows it."""
    with pytest.raises(ValueError, match=r"^initial must"):
        track(drive(10).scans, CORNER, initial=[1.0, 2.0])


def test_one_sensor_given_twice_is_refused():
    """Breaks if a slip of the pen halves the covariance, or puts one radar at two places."""
    scans = drive(10).scans
    again = [replace(scan) for scan in scans]
    for second, mounting in ((scans, CORNER), (again[3:], MOUNTINGS[1])):
        with pytest.raises(ValueError, match=r"^sensors must be .* sensors\[0\] and sensors\[1\]"):
            track_joint([(scans, CORNER), (second, mounting)])
    none, alone = [scan[:0] for scan in scans], [scan[:1] for scan in scans]
    for few in (none, alone):  # which may be alike by chance
        assert not track_joint([(few, CORNER), (few, MOUNTINGS[1])]).converged.any()


def surround_scans(
    count: int = 12, theta=(12.0, 0.0, 0.1), times=None, shift: float = 0.013
) -> list[tuple[list[RadarScan], Mounting]]:
    """Scans of one world by three sensors that do not run in step, at these times."""
    rng, theta = np.random.default_rng(70), np.array(theta)
    points = rng.uniform([-60.0, -60.0], [90.0, 60.0], (600, 2))
    sensors = []
    for s, mounting in enumerate(MOUNTINGS):
        scans = []
        for time in (0.1 * np.arange(count) if times is None else np.asarray(times)) + shift * s:
            noise = rng.standard_normal((3, len(points)))
            full = observe(
                points, arc(theta, time), time, theta, mounting, noise, (0.05, 1e-3, 0.06)
            )
            scans.append(full[(np.abs(full.azimuth) < 0.8) & (full.range < 45.0)])
        sensors.append((scans, mounting))
    return sensors


def front_alone(sensors, **options) -> Track:
    """The first sensor's track."""
    return track(*sensors[0], **options)


either_tracker = pytest.mark.parametrize(
    "driven_by", [front_alone, track_joint], ids=["one-sensor", "joint"]
)


def changed(sensors, change, which=slice(5, 6)):
    """The sensors with some scans of each replaced by ``change(scan)``."""
    return [
        (scans[: which.start] + [change(scan) for scan in scans[which]] + scans[which.stop :], at)
        for scans, at in sensors
    ]


@either_tracker
@pytest.mark.parametrize("baseline", [1, 2, 3])
def test_a_longer_baseline_keeps_the_rows_and_sharpens_the_yaw_rate(driven_by, baseline):
    """Breaks if rows are lost, the interval is not that of the scans registered, or no use."""
    theta = np.array([12.0, 0.0, 0.1])
    sensors = surround_scans(30)
    result = driven_by(sensors, baseline=baseline)
    assert result.converged.all()
    assert len(result.times) == 29
    sigma = np.sqrt(result.covariance[5:, 2, 2]).mean()
    once = np.sqrt(driven_by(sensors).covariance[5:, 2, 2]).mean()
    assert 0.8 < baseline * sigma / once < 1.4  # farther apart, the scans share fewer targets
    assert (np.abs(result.theta - theta)[:, 2] < 5.0 * np.sqrt(result.covariance[:, 2, 2])).all()
    if driven_by is front_alone:
        scans, mounting = sensors[0]
        alone = estimate_ego_motion(scans[8 - baseline], scans[8], mounting, initial=theta)
        assert_allclose(result.theta[7], alone.theta, rtol=0, atol=1e-6)


@either_tracker
@pytest.mark.parametrize("baseline", [0, -1, 1.5])
def test_a_wrong_baseline_is_refused_by_name(driven_by, baseline):
    """Breaks if a scan can be registered with itself."""
    with pytest.raises(ValueError, match=r"^baseline must"):
        driven_by(surround_scans(3), baseline=baseline)


@either_tracker
@pytest.mark.parametrize(("horizon", "baseline"), [(0.3, 3), (0.26, 3), (0.05, 1), (0.35, 3)])
def test_a_horizon_is_the_baseline_nearest_to_it(driven_by, horizon, baseline):
    """Breaks if another scan is taken, or if rounding decides between two that are equally near."""
    sensors = surround_scans(12)
    found = driven_by(sensors, horizon=horizon)
    assert_array_equal(found.theta, driven_by(sensors, baseline=baseline).theta)


@either_tracker
@pytest.mark.parametrize(
    "options", [{"horizon": 0.0}, {"horizon": 300.0}, {"horizon": 0.3, "baseline": 2}]
)
def test_a_wrong_horizon_is_refused_by_name(driven_by, options):
    """Breaks if one of two contradicting options is ignored, or milliseconds are taken."""
    with pytest.raises(ValueError, match=r"^horizon"):
        driven_by(surround_scans(3), **options)


@either_tracker
def test_a_full_turn_between_two_scans_is_no_motion(driven_by):
    """Breaks if times in ms of a 20 Hz radar, in which a drive is a circle each 50 s, converge."""
    drive = simulate_drive(np.random.default_rng(3), 2.0, sensor=Sensor(rate=20.0))
    late = [replace(scan, time=1000.0 * scan.time) for scan in drive.scans]
    driven = driven_by([(late, drive.mounting)])
    assert not driven.converged.any()
    turns = [reason.startswith("a turn of 3") for reason in driven.reasons.tolist()]
    assert np.mean(turns) > 0.3
    assert all(reason.endswith(" deg between scans") for reason in driven.reasons[turns].tolist())


def test_a_joint_track_estimates_each_round():
    """Breaks if pairs of a round are lost, or its time is not the mean of its scans' times."""
    sensors, theta = surround_scans(), np.array([12.0, 0.0, 0.1])
    result = track_joint(sensors)
    assert_allclose(result.times, 0.1 * np.arange(1, 12) + 0.013, atol=1e-12)
    assert_allclose(result.intervals, 0.1, atol=1e-12)
    pairs = [(scans[6], scans[7], mounting) for scans, mounting in sensors]
    alone = estimate_joint_ego_motion(pairs, initial=theta)
    assert_allclose(result.theta[6], alone.theta, rtol=0, atol=1e-6)
    assert_allclose(result.covariance[6], alone.covariance, rtol=1e-4)


def test_a_sensor_that_fails_leaves_the_joint_track_to_the_others():
    """Breaks if one empty or missing scan loses the round, or a blind sensor the drive."""
    sensors, theta = surround_scans(), np.array([12.0, 0.0, 0.1])
    scans, mounting = sensors[1]
    blind = [scan[:0] for scan in scans]
    for other in (blind, scans[:3] + scans[7:], scans[:4] + blind[4:]):
        result = track_joint([sensors[0], (other, mounting), sensors[2]])
        assert result.converged.all()
        assert len(result.times) == 11
        assert np.abs(result.theta - theta).max() < 0.1


def test_a_joint_track_needs_two_rounds_in_time_order():
    """Breaks if nothing is returned as a track of nothing, or a clock runs backwards unseen."""
    sensors = surround_scans(3)
    for too_few in ([], [([], CORNER)], [(scans[:1], at) for scans, at in sensors]):
        with pytest.raises(ValueError, match=r"^sensors must have at least two rounds"):
            track_joint(too_few)
    scans, mounting = sensors[1]
    with pytest.raises(ValueError, match=r"sensor 1 .* must be in strictly increasing time"):
        track_joint([sensors[0], ([scans[0], scans[2], scans[1]], mounting)])


@either_tracker
def test_scans_without_targets_are_marked_and_passed_over(driven_by):
    """Breaks if the drive ends there, or a prediction looks like an estimate."""
    result = driven_by(changed(surround_scans(), lambda scan: scan[:0]))
    assert_array_equal(np.flatnonzero(~result.converged), [4, 5])
    assert np.isnan(result.covariance[4:6]).all()
    assert_array_equal(result.theta[4:6], result.theta[[3, 3]])


@either_tracker
def test_one_target_tells_little_and_says_so(driven_by):
    """Breaks if a motion that one target cannot show is given with a small covariance."""
    theta = np.array([12.0, 0.0, 0.1])
    result = driven_by(changed(surround_scans(), lambda scan: scan[:1]))
    usual = np.sqrt(np.linalg.eigvalsh(result.covariance[2])[-1])
    for i in (4, 5):
        if result.converged[i]:
            spread = np.sqrt(np.linalg.eigvalsh(result.covariance[i])[-1])
            assert spread > 2.0 * usual
            error = result.theta[i] - theta
            assert error @ np.linalg.solve(result.covariance[i], error) < 30.0
    assert result.converged[6:].all()
    assert np.abs(result.theta[6:] - theta)[:, 0].max() < 0.3


@either_tracker
def test_a_scan_in_which_everything_moves_is_marked(driven_by):
    """Breaks if an optimum that rejects all targets is taken for the motion, and carried on."""
    rng, theta = np.random.default_rng(71), np.array([12.0, 0.0, 0.1])

    def astir(scan):
        size = scan.size
        return RadarScan(
            scan.time,
            scan.range + rng.uniform(2.0, 40.0, size),
            scan.azimuth,
            rng.uniform(-60.0, 60.0, size),
            scan.sigma_range,
            scan.sigma_azimuth,
            scan.sigma_doppler,
        )

    result = driven_by(changed(surround_scans(), astir))
    assert not result.converged[4]
    assert result.converged[6:].all()
    assert np.abs(result.theta - theta)[:, 0].max() < 0.5


def test_an_optimum_that_rejects_everything_is_what_the_mark_is_for():
    """Breaks if the cost has no such optimum any more, and the rule no purpose."""
    scans, _ = straight_scans()
    start = [400.0, 0.0, 0.0]
    estimate = estimate_ego_motion(scans[0], scans[1], CORNER, initial=start)
    shares = inlier_probabilities(estimate.theta, scans[0], scans[1], CORNER)
    assert estimate.converged
    assert shares.mean() < MIN_EXPLAINED
    result = track(scans, CORNER, initial=start)
    assert result.converged.all()
    assert np.abs(result.theta[:, 0] - 12.0).max() < 0.3


@either_tracker
def test_targets_in_one_direction_leave_the_motion_across_uncertain(driven_by):
    """Breaks if what is not observable is given with a small covariance, or ends the drive."""
    theta = np.array([12.0, 0.0, 0.1])

    def bundle(scan):
        near = np.argsort(np.abs(scan.azimuth - 0.1))[:6]
        return scan[np.sort(near)]

    usual = driven_by(surround_scans())
    result = driven_by(changed(surround_scans(), bundle, slice(4, 7)))
    good = np.flatnonzero(result.converged)
    assert set(range(3)) | set(range(7, 11)) <= set(good)
    errors = result.theta[good] - theta
    nees = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(result.covariance[good]), errors)
    assert nees.max() < 30.0
    for i in set(good) & {4, 5}:
        assert np.trace(result.covariance[i]) > 4.0 * np.trace(usual.covariance[i])


@either_tracker
def test_a_gap_of_two_seconds_does_not_lose_the_drive(driven_by):
    """Breaks if the interval of the gap is taken for the usual one, or the end is not found."""
    theta, times = np.array([12.0, 0.0, 0.1]), [0.0, 0.1, 0.2, 0.3, 2.3, 2.4, 2.5, 2.6]
    result = driven_by(surround_scans(theta=theta, times=times))
    assert_allclose(result.intervals[3], 2.0, atol=1e-9)
    assert result.converged[[0, 1, 2, 4, 5, 6]].all()
    assert np.abs(result.theta - theta)[:, 0].max() < 0.3
    position = result.poses()[-1, :2] - arc(theta, 2.6)[:2, 2]
    assert np.hypot(*position) < 2.0


@either_tracker
def test_a_standing_vehicle_stands(driven_by):
    """Breaks if a velocity of zero divides, or is taken for no estimate."""
    result = driven_by(surround_scans(theta=(0.0, 0.0, 0.0)))
    assert result.converged.all()
    assert np.abs(result.theta).max() < 0.1
    errors = result.theta
    nees = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(result.covariance), errors)
    assert nees.mean() < 6.0


@either_tracker
def test_a_time_stamp_given_twice_is_refused(driven_by):
    """Breaks if an interval of zero divides; two sensors may share a time."""
    sensors = surround_scans(6, shift=0.0)
    assert driven_by(sensors).converged.all()
    scans, mounting = sensors[0]
    with pytest.raises(ValueError, match=r"must be in strictly increasing time, but scan 3"):
        driven_by([([*scans[:3], at_time(scans[3], scans[2].time)], mounting), *sensors[1:]])


# ---- poses


def track_of(theta, intervals) -> Track:
    """A track with these velocities."""
    theta, intervals = np.asarray(theta, dtype=float), np.asarray(intervals, dtype=float)
    n = len(theta)
    covariance = np.broadcast_to(np.eye(3), (n, 3, 3))
    return Track(np.cumsum(intervals), intervals, theta, covariance, np.ones(n, dtype=bool))


@pytest.mark.parametrize("v_y", [0.0, 1.5])
@pytest.mark.parametrize("count", [1, 10, 500])
def test_a_constant_velocity_drives_a_circle(count, v_y):
    """Breaks if chords are added instead of arcs: then the number of pairs matters."""
    v, omega, duration = 10.0, 0.4, 12.0
    poses = track_of([[v, v_y, omega]] * count, [duration / count] * count).poses()
    t = np.linspace(0.0, duration, count + 1)
    sine, versine = np.sin(omega * t) / omega, (1.0 - np.cos(omega * t)) / omega
    expected = np.column_stack([v * sine - v_y * versine, v * versine + v_y * sine, omega * t])
    assert_allclose(poses, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("start", [(0.0, 0.0, 0.0), (100.0, -30.0, 2.0), (5.0, 5.0, -40.0)])
def test_poses_are_products_of_matrix_exponentials(start):
    """Breaks if motions are applied in the world's axes, or the start is only added."""
    rng = np.random.default_rng(50)
    theta = rng.uniform([-5.0, -2.0, -1.5], [25.0, 2.0, 1.5], (40, 3))
    theta[3:6, 2] = 0.0, 1e-12, -1e-7
    intervals = rng.uniform(0.05, 0.3, 40)
    poses = track_of(theta, intervals).poses(start)
    assert_array_equal(poses, integrate(theta, intervals, start))
    assert_array_equal(poses[0], start)
    pose = arc([0.0, 0.0, start[2]], 1.0)
    pose[:2, 2] = start[:2]
    for i in range(40):
        pose = pose @ arc(theta[i], intervals[i])
        assert_allclose(poses[i + 1, :2], pose[:2, 2], rtol=0, atol=1e-9)
        assert np.exp(1j * poses[i + 1, 2]) == pytest.approx(pose[0, 0] + 1j * pose[1, 0], abs=1e-9)
    assert_allclose(np.diff(poses[:, 2]), theta[:, 2] * intervals, atol=1e-12)


@pytest.mark.parametrize("start", [(0.0, 0.0), (0.0, 0.0, np.nan), 1.0], ids=str)
def test_poses_refuse_a_wrong_start(start):
    """Breaks if half a pose is taken for one."""
    with pytest.raises(ValueError, match=r"^start must"):
        track_of([[1.0, 0.0, 0.0]], [0.1]).poses(start)


def test_poses_of_the_track_are_near_the_truth_and_evo_agrees_how_near():
    """Breaks if the poses' frame or order is not what trajectory tools expect."""
    trajectory = pytest.importorskip("evo.core.trajectory")
    metrics = pytest.importorskip("evo.core.metrics")
    driven = drive(200, seed=51)
    result = track(driven.scans, driven.mounting)
    poses, true = result.poses(driven.truth.poses[0]), driven.truth.poses

    def path(rows):
        matrices = []
        for x, y, yaw in rows:
            matrix = np.eye(4)
            matrix[:2, :2] = arc([0.0, 0.0, yaw], 1.0)[:2, :2]
            matrix[:2, 3] = x, y
            matrices.append(matrix)
        return trajectory.PosePath3D(poses_se3=matrices)

    ape = metrics.APE(metrics.PoseRelation.translation_part)
    ape.process_data((path(true), path(poses)))
    rmse = np.sqrt(np.mean(np.sum((poses - true)[:, :2] ** 2, axis=1)))
    assert ape.get_statistic(metrics.StatisticsType.rmse) == pytest.approx(rmse, rel=1e-6)
    assert rmse < 1.0
    rpe = metrics.RPE(
        metrics.PoseRelation.rotation_angle_rad, delta=1, delta_unit=metrics.Unit.frames
    )
    rpe.process_data((path(true), path(poses)))
    turns = np.abs(np.diff((poses - true)[:, 2]))
    assert_allclose(rpe.error, turns, rtol=0, atol=1e-6)


def test_a_tum_file_is_what_evo_reads(tmp_path):
    """Breaks if columns change places, the first pose is lost, or quaternions are not of yaw."""
    file_interface = pytest.importorskip("evo.tools.file_interface")
    rng = np.random.default_rng(52)
    driven = track_of(
        rng.uniform([-5.0, -1, -2], [20.0, 1, 2], (30, 3)), rng.uniform(0.05, 0.3, 30)
    )
    start = (3.0, -2.0, 2.5)
    driven.write_tum(tmp_path / "path.tum", start)
    read = file_interface.read_tum_trajectory_file(tmp_path / "path.tum")
    poses = driven.poses(start)
    assert_allclose(read.timestamps, np.concatenate([[0.0], driven.times]), rtol=0, atol=1e-8)
    assert_allclose(read.positions_xyz, np.column_stack([poses[:, :2], np.zeros(31)]), atol=1e-8)
    for matrix, yaw in zip(read.poses_se3, poses[:, 2], strict=True):
        assert_allclose(matrix[:2, :2], arc([0.0, 0.0, yaw], 1.0)[:2, :2], rtol=0, atol=1e-7)
    assert read.check()[0]


def test_a_track_can_be_changed_only_by_making_another():
    """Breaks if a track is no longer frozen; replace() is how a study makes variants."""
    one = track_of([[1.0, 0.0, 0.0]], [0.1])
    with pytest.raises(AttributeError):
        one.theta = np.zeros((1, 3))
    assert_allclose(replace(one, intervals=np.array([2.0])).poses()[-1], [2.0, 0.0, 0.0])


@pytest.mark.parametrize("scales", [[], 1.0, [[1.0]], [0.0]])
def test_wrong_joint_scales_are_refused_by_name(scales):
    previous, current = scan_pair(np.random.default_rng(1), np.array([5.0, 0.0, 0.1]))
    with pytest.raises(ValueError, match=r"^scales must be"):
        estimate_joint_ego_motion([(previous, current, CORNER)], scales=scales)


@pytest.mark.parametrize("position", [0, 1], ids=["previous", "current"])
def test_what_is_no_scan_is_refused_by_name(position):
    scans = list(scan_pair(np.random.default_rng(1), np.array([5.0, 0.0, 0.1])))
    scans[position] = "a scan"
    with pytest.raises(ValueError, match=rf"^{('previous', 'current')[position]} must be a RadarS"):
        estimate_ego_motion(*scans, CORNER)


def test_a_path_begins_at_one_pose():
    with pytest.raises(ValueError, match=r"^start must have the shape \(3,\)"):
        integrate(np.zeros((2, 3)), np.ones(2), np.zeros((0, 3)))


@pytest.mark.parametrize("initial", [[1.0], np.zeros((2, 3))])
def test_a_track_begins_at_one_velocity(initial):
    scans = scan_pair(np.random.default_rng(1), np.array([5.0, 0.0, 0.1]))
    with pytest.raises(ValueError, match=r"^initial must have the shape \(3,\)"):
        track(scans, CORNER, initial=initial)


def test_a_scan_is_placed_once_for_each_mounting():
    """Breaks if a scan seen from another mounting gives the points of the first."""
    scan, _ = scan_pair(np.random.default_rng(1), np.array([5.0, 0.0, 0.1]))
    there, here = scan.point_set(CORNER), scan.point_set(Mounting())
    assert scan.point_set(CORNER) is there
    assert np.abs(there.means - here.means).max() > 0.5
