"""Drives from folders, summaries of their scans, and experiments on what makes errors large."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import cumulative_trapezoid

from d2d.radar import Comparison, RadarScan, Recording, Reference, Track, load_nuscenes
from d2d.radar.readers.nuscenes import MOUNTING_ERRORS
from d2d.radar.scans.scan import Mounting, doppler_velocity
from d2d.study.road.displacements import LENGTH, by_its_velocities, drift, span_errors
from d2d.study.road.drive import CHANNELS, Drive, Source, find_drives, pick
from d2d.study.road.extrapolation import doppler_residuals, fit_turning, load_stated
from d2d.study.road.scan_profile import EDGES, scan_profile
from d2d.study.road.suspects import beside_changed_reference, parts, without_slow_part


def root(folder, *sequences: int):
    """A folder with the layout of RadarScenes, without its data."""
    for number in sequences:
        (folder / "data" / f"sequence_{number}").mkdir(parents=True)
    return folder


def test_finds_each_drive_once_and_in_order(tmp_path):
    """Breaks if a second folder's excerpt of the same sequence counts as another drive."""
    whole, excerpt = root(tmp_path / "a", 9, 108), root(tmp_path / "b", 9, 10)
    found = find_drives([whole, excerpt])["RadarScenes"]
    expected = [(whole, "9"), (whole, "108"), (excerpt, "10")]
    assert [(each.root, each.name) for each in found] == expected
    assert pick(found, ["10", "9"]) == {"10": found[2], "9": found[0]}
    with pytest.raises(ValueError, match="109"):
        pick(found, ["9", "109"])
    with pytest.raises(ValueError, match="holds no drive"):
        find_drives([whole, tmp_path])


def exact(motion, seconds: float) -> tuple[Track, Reference]:
    """A track of exact velocities at 10 Hz, and the reference, whose path is summed finely."""
    fine = np.arange(0.0, seconds, 1e-4)
    theta = motion(fine)
    yaw = cumulative_trapezoid(theta[:, 2], fine, initial=0.0)
    velocity = theta[:, 0] * np.exp(1j * yaw)
    path = cumulative_trapezoid(velocity, fine, initial=0.0)
    known = slice(None, None, 200)
    poses = np.column_stack([path.real, path.imag, yaw])[known]
    times = np.arange(0.1, seconds, 0.1)
    unit, good = np.tile(np.eye(3), (len(times), 1, 1)), np.ones(len(times), bool)
    driven = Track(times, np.full(len(times), 0.1), motion(times), 1e-4 * unit, good)
    return driven, Reference(fine[known], theta[known], poses)


def bends(times):
    """A car that brakes and turns to both sides."""
    forward, turning = 12.0 + 3.0 * np.sin(1.3 * times), 0.25 * np.sin(1.7 * times)
    return np.column_stack([forward, np.zeros_like(times), turning])


def straight(times):
    return np.tile([10.0, 0.0, 0.0], (len(times), 1))


@pytest.mark.parametrize("motion", [straight, bends])
def test_exact_velocities_do_not_drift(motion):
    """Breaks if estimates and reference are integrated by rules that differ, or by a wrong one."""
    driven, reference = exact(motion, 40.0)
    assert np.abs(drift(driven, reference)).max() < 0.05
    for truth in (reference, by_its_velocities(reference)):
        errors, covariances = span_errors(driven, truth, 5.0)
        assert len(errors) == len(covariances) == 14
        assert np.abs(errors).max() < 0.03
    own = by_its_velocities(reference).at(reference.times[:-1]).poses
    assert_allclose(own, reference.poses[:-1], atol=0.02)  # after 480 m


def test_errors_of_a_wrong_yaw_rate_and_of_a_wrong_speed():
    """On a straight road a yaw rate off by w turns by w s and moves the end by w s L / 2."""
    driven, reference = exact(straight, 40.0)
    seconds, off = LENGTH / 10.0, np.array([0.0, 0.0, 1e-4])
    turned = drift(replace(driven, theta=driven.theta + off), reference)
    # a stretch ends at an estimate, up to a metre later
    assert_allclose(turned[:, 1], 1e-4 * seconds, rtol=0.011)
    assert_allclose(turned[:, 0], 1e-4 * seconds * LENGTH / 2.0, rtol=0.022)
    slow = drift(replace(driven, theta=0.99 * driven.theta), reference)
    assert_allclose(slow[:, 0], 0.01 * LENGTH, rtol=0.011)
    errors, _ = span_errors(replace(driven, theta=driven.theta + 10.0 * off), reference, 1.0)
    assert_allclose(errors[:, 2], 1e-3, atol=2e-6)


def scan(time, distance, azimuth, doppler) -> RadarScan:
    return RadarScan(time, distance, azimuth, doppler, 0.1, 0.01, 0.1)


def test_a_profile_counts_each_target_in_its_bin():
    """Breaks if scans are weighted wrongly, or azimuths are counted in radians."""
    scans = [
        scan(0.0, [5.0, 15.0, 15.0], np.deg2rad([-40.0, 20.0, 20.0]), [-12.0, -12.0, 3.0]),
        scan(0.1, [5.0], np.deg2rad([20.0]), [3.0]),
    ]
    profile = scan_profile(scans)
    assert profile["targets"] == 2.0
    assert profile["range (m)"][:3].tolist() == [1.0, 1.0, 0.0]
    of_azimuth = dict(zip(EDGES["azimuth (°)"], profile["azimuth (°)"], strict=False))
    assert (of_azimuth[-45.0], of_azimuth[15.0]) == (0.5, 1.5)
    assert sum(profile["Doppler velocity (m/s)"]) == 2.0


SIGMA = np.array([0.02, 0.1, 0.02])


def comparison(slow: float = 0.0, count: int = 2000) -> Comparison:
    """Independent errors of the stated size, ten a second, and a slow one in v_x beside them."""
    times = 0.1 * np.arange(count)
    errors = SIGMA * np.random.default_rng(0).standard_normal((count, 3))
    errors[:, 0] += slow * np.sin(2.0 * np.pi * times / 30.0)
    return Comparison(times, errors, np.tile(np.diag(SIGMA**2), (count, 1, 1)), 1.0, 1.0)


def test_a_slow_error_is_taken_off_and_noise_is_left():
    """Breaks if the window is not centred, or of another length: noise loses 1 part in 11."""
    drifting = comparison(slow=0.1)
    assert parts(drifting)["whitened"][0] > 10.0
    left = parts(without_slow_part(drifting, 1.0))["whitened"]
    assert_allclose(left, 10.0 / 11.0, atol=0.12)


def test_a_changed_reference_is_later_and_faster():
    """Breaks if the lag has the other sign or the factor is that of another component."""
    times = 0.1 * np.arange(50)
    theta = np.column_stack([10.0 + 2.0 * times, 0.1 * times, 0.3 * times])
    covariance = np.tile(np.diag(SIGMA**2), (50, 1, 1))
    driven = Track(times, np.full(50, 0.1), theta, covariance, np.ones(50, dtype=bool))
    errors = np.zeros((50, 3))
    errors[:3] = np.nan
    found = beside_changed_reference(driven, errors, lag=0.05, speed=0.01)
    assert found.times[0] == pytest.approx(0.4)
    earlier = theta[4:] - 0.05 * np.array([2.0, 0.1, 0.3])
    assert_allclose(found.errors, theta[4:] - earlier * [1.01, 1.0, 1.0])
    same = beside_changed_reference(driven, errors)
    assert_allclose(same.errors, 0.0, atol=1e-12)


TRUE = np.deg2rad([1.0, -0.5])  # errors of the stated mountings
TIME = 0.04  # s
NOISE = 0.05  # m/s


def recording(rng: np.random.Generator, stated: Mounting, error: float) -> Recording:
    """A sensor that is mounted otherwise than stated and looks ahead in turns."""
    mounting = Mounting(stated.x, stated.y, stated.yaw + error)
    times = 0.1 * np.arange(40)
    theta = np.column_stack([np.full(40, 6.0), np.zeros(40), np.linspace(-0.5, 0.5, 40)])
    scans = []
    for time, velocity in zip(times, theta, strict=True):
        azimuth, distance = rng.uniform(-0.8, 0.8, 30), rng.uniform(5.0, 60.0, 30)
        doppler = doppler_velocity(velocity, azimuth, mounting) + NOISE * rng.standard_normal(30)
        doppler += TIME * velocity[2] ** 2 * distance
        doppler[:5] += rng.uniform(-8.0, 8.0, 5)  # these move
        scans.append(RadarScan(time, distance, azimuth, doppler, 0.2, 0.01, 0.1))
    return Recording(scans, stated, Reference(times, theta, np.zeros((40, 3))))


def test_finds_prediction_time_and_mounting_errors():
    """Breaks if a sign is wrong, movers pull, or one effect is taken for the other."""
    rng = np.random.default_rng(0)
    stated = (Mounting(3.4, 0.0, 0.0), Mounting(-0.6, 0.6, 2.9))
    drive = Drive("", [recording(rng, *each) for each in zip(stated, TRUE, strict=True)])
    found = fit_turning(doppler_residuals(drive))
    assert found.time == pytest.approx(TIME, rel=0.03)
    assert found.bounds[0] < TIME < found.bounds[1]
    assert np.diff(found.bounds) < 0.005
    assert_allclose(found.mountings, TRUE, atol=np.deg2rad(0.1))
    assert found.rms == pytest.approx(NOISE, rel=0.2)
    assert found.rms_without > 1.5 * found.rms


@pytest.mark.nuscenes
@pytest.mark.parametrize("scene", ["scene-0061", "scene-0103", "scene-0916", "scene-1077"])
def test_the_reader_has_the_numbers_of_the_training_scenes(nuscenes, scene):
    """Breaks if the frozen constants are no longer those of the fit, or of one scene alone."""
    found = fit_turning(doppler_residuals(load_stated(Source("nuScenes", nuscenes, scene))))
    if scene != "scene-0103":  # hardly a turn
        assert found.time == pytest.approx(0.037, abs=5e-4 if scene == "scene-0061" else 0.005)
    if scene in ("scene-0061", "scene-0103"):
        for channel, error in zip(CHANNELS, found.mountings, strict=True):
            stated = load_nuscenes(nuscenes, scene, channel, stated_mounting=True).mounting.yaw
            known = MOUNTING_ERRORS[channel][round(float(np.rad2deg(stated)), 2)]
            assert known == pytest.approx(float(np.rad2deg(error)), abs=0.01)
