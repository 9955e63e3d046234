"""Identities of ego-motion over random scans, mountings, velocities and batch axes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from d2d import UniformOutlier, rigid
from d2d.radar import (
    Mounting,
    RadarScan,
    doppler_ego_motion,
    doppler_velocity,
    estimate_ego_motion,
    estimate_joint_ego_motion,
    inlier_probabilities,
    propagate_ego_motion,
    sensor_velocity,
    simulate_drive,
    track,
    track_joint,
)
from d2d.radar.scans.scan import doppler_gradients
from tests.strategies import reals, seeds

FEW = settings(max_examples=8)  # of tests that take long

batches = st.sampled_from([(), (1,), (3,), (2, 3), (2, 1)])


def scan_of(seed: int, count: int, theta: Any = (8.0, 0.0, 0.1), at: Any = None) -> RadarScan:
    """Static targets around, measured exactly, with their Doppler velocities."""
    rng = np.random.default_rng(seed)
    azimuth = rng.uniform(-0.7, 0.7, count)
    mounting = Mounting() if at is None else at
    speed = doppler_velocity(theta, azimuth, mounting)
    return RadarScan(0.0, rng.uniform(5.0, 40.0, count), azimuth, speed, 0.1, 0.01, 0.05)


velocities = st.tuples(reals(-40.0, 40.0), reals(-3.0, 3.0), reals(-1.0, 1.0)).map(np.array)
mountings = st.builds(Mounting, reals(-4.0, 4.0), reals(-2.0, 2.0), reals(-3.2, 3.2))


@given(seeds, velocities, mountings, st.integers(0, 500), batches)
def test_doppler_velocity_is_linear_and_that_of_the_sensor(seed, theta, mounting, count, batch):
    """Breaks if the lever arm has the wrong sign, or one motion of a batch meets another's scan."""
    rng = np.random.default_rng(seed)
    azimuth = rng.uniform(-4.0, 4.0, (*batch, count))
    seen = doppler_velocity(theta, azimuth, mounting)
    assert seen.shape == (*batch, count)
    u = theta[:2] + theta[2] * np.array([-mounting.y, mounting.x])
    line = azimuth + mounting.yaw
    assert_allclose(seen, -u[0] * np.cos(line) - u[1] * np.sin(line), atol=1e-11)
    assert_allclose(doppler_velocity(-2.0 * theta, azimuth, mounting), -2.0 * seen, atol=1e-11)
    gain, slope = doppler_gradients(azimuth, mounting)
    turned, _ = doppler_gradients(azimuth + 1e-6, mounting)
    assert_allclose((turned - gain) / 1e-6, slope, atol=1e-4)


@given(seeds, velocities, mountings, st.integers(3, 300))
def test_exact_doppler_velocities_give_the_velocity(seed, theta, mounting, count):
    """Breaks if a sensor's frame is left out, or good targets are thrown away."""
    scan = scan_of(seed, count, theta, mounting)
    assume(np.ptp(scan.azimuth) > 0.2)
    u = theta[:2] + theta[2] * np.array([-mounting.y, mounting.x])
    assert_allclose(sensor_velocity(scan, mounting), u, atol=1e-6 * (1.0 + np.abs(u).max()))
    rear = Mounting(mounting.x - 3.0, mounting.y + 1.0, mounting.yaw + 2.0)
    found = doppler_ego_motion([(scan, mounting), (scan_of(seed + 1, count, theta, rear), rear)])
    if np.isfinite(found.covariance).all():
        limit = 1e-6 + 10.0 * np.sqrt(np.diagonal(found.covariance))
        assert (np.abs(found.theta - theta) <= limit).all()


def successive(seed: int, theta: np.ndarray, at: Mounting, count: int) -> tuple[RadarScan, ...]:
    """Two scans, a tenth of a second apart, of the same targets without errors."""
    now = replace(scan_of(seed, count, theta, at), time=0.1)
    points = now.range[:, None] * np.stack([np.cos(now.azimuth), np.sin(now.azimuth)], axis=-1)
    moved = rigid.compose(
        rigid.inverse(at.pose), rigid.compose(rigid.exponential(0.1 * theta), at.pose)
    )
    x, y = rigid.transform_means(moved, points).T
    azimuth = np.arctan2(y, x)
    before = RadarScan(
        0.0, np.hypot(x, y), azimuth, doppler_velocity(theta, azimuth, at), 0.1, 0.01, 0.05
    )
    return before, now


@given(seeds, velocities, mountings, st.booleans(), st.booleans())
def test_ego_motion_of_exact_scans_is_the_true_one(seed, theta, mounting, doppler, joint):
    """Breaks if positions, Doppler velocities, mounting or interval do not fit together."""
    pair = (*successive(seed, theta, mounting, 30), mounting)
    options = {"doppler": doppler, "initial": theta, "outlier": UniformOutlier(1e-6)}
    estimate = (
        estimate_joint_ego_motion([pair], **options)
        if joint
        else estimate_ego_motion(*pair, **options)
    )
    assert estimate.converged
    sigma = np.sqrt(np.diagonal(estimate.covariance))
    # neighbours within the errors' reach pull the optimum a little from the truth
    assert (np.abs(estimate.theta - theta) <= 1.5 * sigma + 1e-9).all()
    if not joint:
        model = {"doppler": doppler, "outlier": options["outlier"]}
        share = inlier_probabilities(estimate.theta, *pair, **model)
        assert share.shape == (30,)
        assert share.min() > 0.9
        spread = propagate_ego_motion(estimate, *pair, **model)
        assert np.linalg.eigvalsh(spread / np.outer(sigma, sigma))[0] > 0.0


@FEW
@given(seeds, st.integers(2, 6), st.integers(1, 3), st.booleans())
def test_a_track_of_one_sensor_is_the_chain_of_its_pairs(seed, count, baseline, joint):
    """Breaks if a pair is left out, or a scan is registered with another one than was asked for."""
    drive = simulate_drive(np.random.default_rng(seed), duration=0.1 * count)
    scans = [scan[:12] for scan in drive.scans]
    assume(all(scan.size > 5 for scan in scans))
    path = (
        track_joint([(scans, drive.mounting)], baseline=baseline)
        if joint
        else track((scans, drive.mounting), baseline=baseline)
    )
    assert path.theta.shape == (len(scans) - 1, 3)
    assert_allclose(path.times, [scan.time for scan in scans[1:]])
    assert (np.isfinite(path.covariance).all(axis=(1, 2)) == path.converged).all()
    poses = path.poses((1.0, -2.0, 3.0))
    assert_array_equal(poses[0], [1.0, -2.0, 3.0])
    for before, after, theta, interval in zip(
        poses[:-1], poses[1:], path.theta, path.intervals, strict=True
    ):
        step = rigid.compose(before, rigid.exponential(theta * interval))
        assert_allclose(after, step, atol=1e-12)
