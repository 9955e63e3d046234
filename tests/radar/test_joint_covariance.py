"""The propagated covariance of a joint estimate, in which scans are used several times.

The references are the gradient and the joint optimum with measured values changed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d import PointSet, rigid
from d2d.radar import (
    Mounting,
    RadarScan,
    doppler_velocity,
    estimate_ego_motion,
    estimate_joint_ego_motion,
    propagate_ego_motion,
    propagate_joint_ego_motion,
)
from d2d.radar.motion.covariance import distinct_views, influences, noise_covariance
from d2d.radar.motion.model import EgoMotionModel
from d2d.radar.motion.pairs import scan_pair

THETA = np.array([12.0, -0.5, 0.4])
SIGMAS = (0.15, np.deg2rad(1.0), 0.06)
SENSORS = (Mounting(3.86, 0.7, 0.436), Mounting(-0.5, -0.8, 2.6))


def seen(mounting: Mounting, times, size=12, rng=None) -> list[RadarScan]:
    """Scans of the same static targets at constant velocity, with noise if ``rng`` is given."""
    draw = np.random.default_rng(int(100 * mounting.yaw))
    distance, azimuth = draw.uniform(5.0, 40.0, size), draw.uniform(-0.9, 0.9, size)
    ahead = distance[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    scans = []
    for time in times:
        pose = rigid.compose(rigid.exponential(time * THETA), mounting.pose)
        to_sensor = rigid.compose(rigid.inverse(pose), mounting.pose)
        points = rigid.transform_means(to_sensor, ahead)
        angle = np.arctan2(points[:, 1], points[:, 0])
        doppler = doppler_velocity(THETA, angle, mounting)
        scan = RadarScan(time, np.hypot(*points.T), angle, doppler, *SIGMAS)
        errors = 0.0 if rng is None else rng.standard_normal((3, size))
        scans.append(with_errors(scan, np.array(SIGMAS)[:, None] * errors))
    return scans


def with_errors(scan: RadarScan, errors) -> RadarScan:
    """The scan with errors (3, K) added to range, azimuth and Doppler velocity."""
    values = np.stack([scan.range, scan.azimuth, scan.doppler]) + errors
    return RadarScan(scan.time, *values, scan.sigma_range, scan.sigma_azimuth, scan.sigma_doppler)


def pairs_of(scans, baselines=((0, 1), (1, 2), (0, 2))):
    """All baselines of both sensors: each middle scan is a previous and a current one."""
    return [
        (own[i], own[j], mounting)
        for own, mounting in zip(scans, SENSORS, strict=True)
        for i, j in baselines
    ]


def scene(rng=None):
    times = np.array([0.0, 0.06, 0.13])
    return [
        seen(mounting, times + 0.02 * number, rng=rng) for number, mounting in enumerate(SENSORS)
    ]


def optimum(scans, **options) -> np.ndarray:
    found = estimate_joint_ego_motion(pairs_of(scans), initial=THETA, **options)
    assert found.converged
    return found.theta


def changed(scans, sensor, index, errors):
    """All scans, one of them with errors (3, K), in every pair that it is in."""
    every = [list(own) for own in scans]
    every[sensor][index] = with_errors(every[sensor][index], errors)
    return every


def same(actual, expected, tolerance):
    root = np.linalg.inv(np.linalg.cholesky(expected))
    assert_allclose(np.linalg.eigvalsh(root @ actual @ root.T), 1.0, atol=tolerance)


@pytest.mark.parametrize("first_order", [False, True], ids=["arc", "chord"])
def test_cross_derivatives_of_a_velocity_are_those_of_its_gradient(first_order):
    """Breaks if a pair's interval, chart or place among the targets of all pairs is wrong."""
    model = EgoMotionModel(first_order=first_order)
    pairs = [scan_pair(*pair, model) for pair in pairs_of(scene(np.random.default_rng(1)))]
    problem = model.problem(pairs)
    bound = problem.bind(THETA)
    cross = problem.cross_derivatives(bound, 0, 1)

    def gradient(number, field, target, axis, step):
        pair = pairs[number]
        if field == "measurement":
            value = pair.measurement.value.copy()
            value[target] += step
            other = pair._replace(measurement=replace_value(pair.measurement, value))
        else:
            points = getattr(pair, field)
            means = points.means.copy()
            means[target, axis] += step
            other = pair._replace(**{field: PointSet(means, points.covariances, points.weights)})
        moved = model.problem([*pairs[:number], other, *pairs[number + 1 :]])
        return moved.derivatives(moved.bind(THETA))[1][0]

    def difference(*which):
        return (gradient(*which, 1e-5) - gradient(*which, -1e-5)) / 2e-5

    for number, target in ((0, 3), (1, 0), (5, 11)):
        at = 12 * number + target
        for field, block in (("fixed", cross.fixed), ("moving", cross.moving)):
            for axis in (0, 1):
                expected = difference(number, field, target, axis)
                assert_allclose(
                    block[0, at, :, axis], expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max()
                )
        expected = difference(number, "measurement", target, 0)
        assert_allclose(cross.measured[0, at], expected, rtol=1e-6, atol=1e-6)


def replace_value(measurement, value):
    return type(measurement)(
        value,
        measurement.sigma,
        measurement.sigma_input,
        measurement.gain,
        measurement.slope,
        measurement.of_twist,
    )


def test_one_pair_alone_is_what_one_sensor_gives():
    """Breaks if the two public functions disagree where they mean the same."""
    previous, current = seen(SENSORS[0], (0.0, 0.06), rng=np.random.default_rng(2))
    for options in ({}, {"doppler": False}, {"outlier": None}, {"first_order": True}):
        estimate = estimate_ego_motion(previous, current, SENSORS[0], initial=THETA, **options)
        for shared in (True, False):
            alone = propagate_ego_motion(
                estimate, previous, current, SENSORS[0], shared_azimuth=shared, **options
            )
            joint = propagate_joint_ego_motion(
                estimate, [(previous, current, SENSORS[0])], shared_azimuth=shared, **options
            )
            assert_array_equal(alone, joint)


def test_the_same_pair_twice_tells_nothing_new():
    """Breaks if what is used twice counts as two measurements, as the inverse Hessian takes it."""
    previous, current = seen(SENSORS[0], (0.0, 0.06), rng=np.random.default_rng(3))
    pair = (previous, current, SENSORS[0])
    copy = (with_errors(previous, 0.0), with_errors(current, 0.0), SENSORS[0])
    once = estimate_joint_ego_motion([pair], initial=THETA)
    twice = estimate_joint_ego_motion([pair, copy], initial=THETA)
    assert_allclose(2.0 * twice.covariance, once.covariance, rtol=1e-6)
    assert_allclose(
        propagate_joint_ego_motion(twice, [pair, copy]),
        propagate_joint_ego_motion(once, [pair]),
        rtol=1e-6,
    )


@pytest.mark.parametrize("shared", [True, False], ids=["shared", "apart"])
def test_it_is_how_the_joint_optimum_moves(shared):
    """Breaks if a scan's uses in several pairs are squared one by one, or one of them is lost.

    As in `test_whole_scans_registered_again_give_the_same`: noise-free, so that what is computed at
    a measured point hardly matters.
    """
    scans = scene()
    total, step = np.zeros((3, 3)), 1e-2
    for sensor, index, coordinate, target in np.ndindex(2, 3, 3, 12):
        errors = np.zeros((3, 12))
        errors[coordinate, target] = step * SIGMAS[coordinate]
        ahead, behind = (optimum(changed(scans, sensor, index, by)) for by in (errors, -errors))
        change = (ahead - behind) / (2.0 * step)
        total += np.outer(change, change)
    pairs = pairs_of(scans)
    estimate = estimate_joint_ego_motion(pairs, initial=THETA)
    covariance = propagate_joint_ego_motion(estimate, pairs, shared_azimuth=shared)
    if shared:
        same(covariance, total, 0.03)
        return
    with pytest.raises(AssertionError):
        same(covariance, total, 0.03)


def test_each_use_on_its_own_is_another_covariance():
    """Breaks if adding up before squaring makes no difference, so that nothing is tested."""
    pairs = pairs_of(scene())
    estimate = estimate_joint_ego_motion(pairs, initial=THETA)
    together = propagate_joint_ego_motion(estimate, pairs)
    model = EgoMotionModel()
    problem = model.problem([scan_pair(*pair, model) for pair in pairs])
    views = [(scan, pair[2]) for pair in pairs for scan in pair[:2]]
    sides = [(2 * number, 2 * number + 1) for number in range(len(pairs))]
    apart = noise_covariance(influences(problem, estimate, views, sides))
    ratio = np.diag(apart) / np.diag(together)
    assert (np.abs(ratio - 1.0) > 0.2).any()


@pytest.mark.parametrize("sensor", [0, 1])
def test_shared_errors_are_sums_of_influences(sensor):
    """Breaks if an azimuth bias or a Doppler scale of one sensor moves the optimum otherwise."""
    scans = scene()
    pairs = pairs_of(scans)
    views, sides = distinct_views(pairs)
    assert len(views) == 6
    model = EgoMotionModel()
    problem = model.problem([scan_pair(*pair, model) for pair in pairs])
    estimate = estimate_joint_ego_motion(pairs, initial=THETA)
    found = [
        each
        for each in influences(problem, estimate, views, sides)
        if each.mounting == SENSORS[sensor]
    ]
    assert len(found) == 3
    for row, size, expected in (
        (1, 1e-5, sum(each.azimuth.sum(axis=0) for each in found)),
        (2, 1e-4, sum((each.doppler * each.scan.doppler[:, None]).sum(axis=0) for each in found)),
    ):

        def moved(by, row=row):
            every = scans
            for index in range(3):
                errors = np.zeros((3, 12))
                errors[row] = by if row == 1 else by * scans[sensor][index].doppler
                every = changed(every, sensor, index, errors)
            return optimum(every)

        change = (moved(size) - moved(-size)) / (2.0 * size)
        assert_allclose(change, expected, rtol=0.02, atol=0.02 * np.abs(expected).max())


def test_more_scatter_of_the_positions_is_none_of_the_azimuth():
    """Breaks if the azimuth's share is taken from the positions' covariances instead of its sigma.

    The extent of an object makes those larger.
    """
    pairs = pairs_of(scene(np.random.default_rng(4)))
    model = EgoMotionModel()
    extended = []
    for pair in (scan_pair(*pair, model) for pair in pairs):
        sets = (
            PointSet(points.means, points.covariances + 0.09 * np.eye(2))
            for points in (pair.fixed, pair.moving)
        )
        extended.append(pair._replace(**dict(zip(("fixed", "moving"), sets, strict=True))))
    problem = model.problem(extended)
    estimate = estimate_joint_ego_motion(pairs, initial=THETA)
    found = influences(problem, estimate, *distinct_views(pairs))
    without = [each._replace(covariances=each.covariances - 0.09 * np.eye(2)) for each in found]
    more = sum(np.einsum("kid,kjd->ij", each.position, each.position) for each in found)
    assert_allclose(noise_covariance(found), noise_covariance(without) + 0.09 * more, rtol=1e-9)
    for each, view in zip(found, distinct_views(pairs)[0], strict=True):
        expected = view[0].point_set(view[1]).covariances + 0.09 * np.eye(2)
        assert_allclose(each.covariances, expected, rtol=1e-12)


def test_what_did_not_converge_has_no_covariance():
    """Breaks if a covariance is made up where there is no optimum."""
    pairs = pairs_of(scene())
    estimate = estimate_joint_ego_motion(pairs, initial=THETA)
    lost = replace(estimate, converged=np.bool_(False), covariance=np.full((3, 3), np.nan))
    assert np.isnan(propagate_joint_ego_motion(lost, pairs)).all()


def test_bad_input_is_refused_by_name():
    """Breaks if an argument that does not fit gives a number or an obscure error."""
    pairs = pairs_of(scene())
    estimate = estimate_joint_ego_motion(pairs, initial=THETA)
    with pytest.raises(ValueError, match="pairs"):
        propagate_joint_ego_motion(estimate, [])
    with pytest.raises(ValueError, match=r"pairs\[1\]"):
        propagate_joint_ego_motion(estimate, [pairs[0], pairs[0][:2]])
    with pytest.raises(ValueError, match="estimate"):
        propagate_joint_ego_motion(THETA, pairs)
    with pytest.raises(ValueError, match="shared_azimuth"):
        propagate_joint_ego_motion(estimate, pairs, shared_azimuth=1)
    with pytest.raises(ValueError, match="current"):
        propagate_joint_ego_motion(estimate, [(pairs[0][1], pairs[0][0], SENSORS[0])])
