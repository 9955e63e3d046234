"""Targets above and below the plane, and sensors that are pitched or rolled."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from d2d import credibility, rigid
from d2d.radar import Mounting, RadarScan, Tracker, doppler_ego_motion, estimate_ego_motion, track
from d2d.radar.scans.scan import level

THETA = np.array([8.0, 0.0, 0.2])
SIGMAS = np.array([0.1, np.deg2rad(0.5), 0.05, np.deg2rad(1.0)])


def solid_scans(mounting: Mounting, count: int = 150) -> list[RadarScan]:
    """Scans of a world from 8 m below the sensor to 15 m above it, on a circle."""
    rng = np.random.default_rng(0)
    points = rng.uniform([-90.0, -50.0, -8.0], [90.0, 130.0, 15.0], (6000, 3))
    angles = [mounting.yaw, mounting.pitch, mounting.roll]
    turn = Rotation.from_euler("ZYX", angles).as_matrix()
    arm = np.array([mounting.x, mounting.y, 0.0])
    velocity = np.append(THETA[:2], 0.0) + np.cross([0.0, 0.0, THETA[2]], arm)
    scans, pose = [], np.zeros(3)
    for k in range(count):
        back = Rotation.from_euler("z", pose[2]).as_matrix()
        rel = (points - [*pose[:2], 0.0]) @ back - arm
        distance, sight = np.linalg.norm(rel, axis=1), rel @ turn
        azimuth = np.arctan2(sight[:, 1], sight[:, 0])
        elevation = np.arcsin(sight[:, 2] / distance)
        seen = (distance > 3.0) & (distance < 50.0) & (abs(azimuth) < 0.9) & (abs(elevation) < 0.35)
        some = np.flatnonzero(seen)[:50]
        doppler = -(rel[some] @ velocity) / distance[some]
        true = np.stack([distance[some], azimuth[some], doppler, elevation[some]])
        measured = true + SIGMAS[:, None] * rng.standard_normal(true.shape)
        upwards = {"elevation": measured[3], "sigma_elevation": SIGMAS[3]}
        scans.append(RadarScan(0.1 * k, *measured[:3], *SIGMAS[:3], **upwards))
        pose = rigid.compose(pose, rigid.exponential(0.1 * THETA))
    return scans


@pytest.mark.parametrize(
    ("yaw", "pitch", "roll"), [(0.0, 0.0, 0.0), (0.0, 0.26, 0.0), (-1.0, -0.35, 0.2)]
)
def test_a_solid_world_gives_a_credible_flat_motion(yaw, pitch, roll):
    """Breaks if range or Doppler velocity is not projected, an angle has another sign, or the
    errors of the elevation are left out."""
    mounting = Mounting(3.5, 0.5, yaw, pitch, roll)
    scans = solid_scans(mounting)
    driven = track((scans, mounting), baseline=1, carry=False)
    errors = driven.theta - THETA
    assert driven.converged.all()
    assert abs(errors[:, 0].mean()) < 4.0 * errors[:, 0].std() / np.sqrt(len(errors))
    assert 0.75 < credibility(errors, driven.covariance).anees < 1.3
    tracker = Tracker({"radar": mounting}, baseline=1, carry=False)
    found = [each for scan in scans[:5] for each in tracker.add("radar", scan)]
    assert_array_equal([each.theta for each in found], driven.theta[: len(found)])
    alone = doppler_ego_motion([(scans[0], mounting)], side_slip=False).theta
    assert_allclose(alone[[0, 2]], THETA[[0, 2]], atol=0.2)


def test_sigmas_are_those_of_draws():
    """Breaks if a derivative of the projection is wrong: against 100 000 draws."""
    rng = np.random.default_rng(1)
    mounting = Mounting(0.0, 0.0, 0.3, 0.3, -0.2)
    true = np.array([30.0, 0.4, -7.0, 0.2])
    draws = true[:, None] + SIGMAS[:, None] * rng.standard_normal((4, 100_000))
    upwards = {"elevation": draws[3], "sigma_elevation": SIGMAS[3]}
    scan, _ = level(RadarScan(0.0, *draws[:3], *SIGMAS[:3], **upwards), mounting)
    for name in ("range", "azimuth", "doppler"):
        stated = getattr(scan, f"sigma_{name}").mean()
        assert getattr(scan, name).std() == pytest.approx(stated, rel=0.02)


def test_positions_with_heights_are_the_same_targets():
    """Breaks if z is dropped, or a covariance is projected onto other directions."""
    rng = np.random.default_rng(2)
    place = rng.uniform([5.0, -9.0, -4.0], [20.0, 9.0, 4.0], (6, 3))
    velocity = rng.normal(0.0, 5.0, (6, 3))
    covariance = np.diag([0.01, 0.04, 0.09])
    scan = RadarScan.from_cartesian(
        0.0, *place.T, velocity=velocity, covariance=covariance, sigma_doppler=0.1
    )
    assert_allclose(scan.range, np.linalg.norm(place, axis=1))
    assert_allclose(scan.doppler, (velocity * place).sum(axis=1) / scan.range)
    flat, _ = level(scan, Mounting())
    assert_allclose(flat.point_set(Mounting()).means, place[:, :2])
    draws = place[0] + rng.standard_normal((100_000, 3)) * [0.1, 0.2, 0.3]
    ways = (np.linalg.norm(draws, axis=1), np.arctan2(draws[:, 1], draws[:, 0]))
    rising = np.arctan2(draws[:, 2], np.hypot(*draws.T[:2]))
    for name, values in zip(("range", "azimuth", "elevation"), (*ways, rising), strict=True):
        assert values.std() == pytest.approx(getattr(scan, f"sigma_{name}")[0], rel=0.02)


def test_the_vertical_shows_nothing():
    """Breaks if a target overhead is divided by zero or refused, or a flat scan is changed."""
    targets = [5.0, 9.0], [0.0, 0.1], [9e3, 1.0], 0.1, 0.01, 0.1
    for steep in (0.5 * np.pi, 1.5):  # the other moves at 127 km/s along the ground
        scan = RadarScan(0.0, *targets, elevation=[steep, 0.1])
        assert_array_equal(scan.sigma_elevation, [0.01, 0.01])
        assert len(level(scan, Mounting())[0]) == 1
    flat, later = (RadarScan(time, [5.0], [0.0], [0.0], 0.1, 0.01, 0.1) for time in (0.0, 0.1))
    assert level(flat, Mounting(1.0))[0] is flat
    with pytest.raises(ValueError, match="holds no targets"):
        estimate_ego_motion(flat, later, Mounting(pitch=0.5 * np.pi))
    with pytest.raises(ValueError, match=r"^elevation must be in radians"):
        RadarScan(0.0, [5.0], [0.0], [0.0], 0.1, 0.01, 0.1, elevation=[10.0])
