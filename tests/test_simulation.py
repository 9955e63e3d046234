"""The simulated drive: a closed path, a static world, a sensor with the noise it says it has."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree
from scipy.stats import kstest

from d2d.radar import Drive, Mounting, simulate_drive, track
from d2d.radar.simulation import FIELD_OF_VIEW, LONGEST_RANGE, MOST_TARGETS, RATE, SHORTEST_RANGE
from d2d.study.drives import DriveErrors
from tests.strategies import central_difference

MOUNTING = Mounting(1.2, -0.4, 0.3)
SILENT = {"sigma_range": 1e-9, "sigma_azimuth": 1e-9, "sigma_doppler": 1e-9}


@cache
def drive(seed: int = 0, duration: float = 30.0, **options) -> Drive:
    """A drive, simulated once for all tests that look at it."""
    return simulate_drive(np.random.default_rng(seed), duration, **options)


def positions(poses: np.ndarray, mounting: Mounting) -> tuple[np.ndarray, np.ndarray]:
    """Of the sensor along the drive, as complex numbers, and its direction."""
    direction = np.exp(1j * poses[..., 2])
    at = poses[..., 0] + 1j * poses[..., 1] + complex(mounting.x, mounting.y) * direction
    return at, direction * np.exp(1j * mounting.yaw)


def visible(driven: Drive, i: int) -> np.ndarray:
    """True positions, in the sensor frame, of all that scan i can see, the nearest first."""
    at, direction = positions(driven.truth.poses[i], driven.mounting)
    seen = (driven.reflectors @ [1.0, 1.0j] - at) / direction
    inside = (abs(seen) < LONGEST_RANGE) & (abs(seen) > SHORTEST_RANGE)
    inside &= abs(np.angle(seen)) < FIELD_OF_VIEW
    return np.sort_complex(abs(seen[inside]) + 1j * np.angle(seen[inside]))


def test_the_same_seed_gives_the_same_drive():
    """Breaks if anything draws from a state other than the generator."""
    first, again, other = (simulate_drive(np.random.default_rng(seed), 10.0) for seed in (1, 1, 2))
    assert_array_equal(first.reflectors, again.reflectors)
    for a, b in zip(first.scans, again.scans, strict=True):
        for name in ("time", "range", "azimuth", "doppler"):
            assert_array_equal(getattr(a, name), getattr(b, name))
    assert not np.array_equal(first.scans[0].range[:5], other.scans[0].range[:5])


def test_scans_and_truth_are_given_at_the_same_times():
    """Breaks if the rate is not 10 Hz or the truth has another length."""
    driven = drive()
    times = np.array([scan.time for scan in driven.scans])
    assert_array_equal(times, driven.truth.times)
    assert_allclose(times, np.arange(301) / RATE, rtol=0, atol=1e-12)
    assert driven.truth.theta.shape == driven.truth.poses.shape == (301, 3)


@pytest.mark.parametrize(("duration", "speed"), [(60.0, 2.0), (120.0, 8.0)])
def test_velocity_is_the_derivative_of_the_poses(duration, speed):
    """Breaks if theta is not in the vehicle's axes, or the closed-form derivatives are wrong."""
    truth = drive(0, duration, speed=speed, density=1e-6).truth
    spline = CubicSpline(truth.times, truth.poses)
    inner = slice(10, -10)  # a spline is less exact at its ends
    rate = spline(truth.times[inner], 1)
    cosine, sine = np.cos(truth.poses[inner, 2]), np.sin(truth.poses[inner, 2])
    forward = cosine * rate[:, 0] + sine * rate[:, 1]
    left = cosine * rate[:, 1] - sine * rate[:, 0]
    numeric = np.column_stack([forward, left, rate[:, 2]])
    assert_allclose(numeric, truth.theta[inner], rtol=0, atol=2e-4 * speed)
    assert (truth.theta[:, 0] > 0).all()
    assert_array_equal(truth.theta[:, 1], 0.0)
    assert (truth.theta[:, 2] > 0.02).any()
    assert (truth.theta[:, 2] < -0.02).any()


@pytest.mark.parametrize(("duration", "speed"), [(60.0, 2.0), (45.0, 7.0)])
def test_the_loop_closes_at_the_mean_speed(duration, speed):
    """Breaks if the progress does not make whole laps, or the lap's length is wrong."""
    truth = drive(0, duration, speed=speed, density=1e-6).truth
    assert_allclose(truth.poses[-1] - truth.poses[0], [0, 0, 2.0 * np.pi], rtol=0, atol=1e-9)
    assert np.abs(np.diff(truth.poses[:, 2])).max() < 0.2, "yaw jumps"
    length = np.hypot(*np.diff(truth.poses[:, :2], axis=0).T).sum()
    assert length == pytest.approx(speed * duration, rel=1e-3)
    assert truth.theta[:-1, 0].mean() == pytest.approx(speed, rel=1e-3)


@pytest.mark.parametrize("mounting", [Mounting(0.4), MOUNTING])
def test_everything_in_view_is_seen_the_nearest_first(mounting):
    """Breaks if the field of view is cut in the vehicle's frame, or far targets displace near."""
    driven = drive(4, mounting=mounting, detection=1.0, density=0.05, **SILENT)
    crowded = 0
    for i in range(0, 301, 7):
        scan, expected = driven.scans[i], visible(driven, i)
        crowded += len(expected) > MOST_TARGETS
        expected = expected[:MOST_TARGETS]
        assert scan.size == len(expected)
        assert_allclose(scan.range, expected.real, rtol=0, atol=1e-7)
        assert_allclose(scan.azimuth, expected.imag, rtol=0, atol=1e-7)
    assert crowded > 0, "no scan was cut"
    assert max(scan.size for scan in driven.scans) == MOST_TARGETS == 48


def test_not_everything_in_view_is_detected():
    """Breaks if the probability is not of each reflector in each scan."""
    driven = drive(5, density=0.02, detection=0.6, **SILENT)
    chances = np.array([len(visible(driven, i)) for i in range(301)])
    found = np.array([scan.size for scan in driven.scans])
    assert (chances <= MOST_TARGETS).all()
    assert (found <= chances).all()
    deviation = np.sqrt((chances * 0.6 * 0.4).sum())
    assert abs(found.sum() - 0.6 * chances.sum()) < 3.0 * deviation
    z = (found - 0.6 * chances) / np.sqrt(0.24 * chances)
    assert 0.85 < z.std() < 1.15


def test_doppler_is_the_range_rate_along_the_drive():
    """Breaks if the Doppler velocities are not those of the moving, turning sensor."""
    driven = drive(6, mounting=MOUNTING, detection=1.0, density=0.02, **SILENT)
    for i in range(0, 300, 30):
        pose, theta = driven.truth.poses[i], driven.truth.theta[i]

        def distances(time, pose=pose, theta=theta, i=i):
            """As the vehicle goes on with the velocity of now; the world is sorted by range."""
            step = time[0] * theta
            velocity = theta[0] * np.exp(1j * (pose[2] + 0.5 * step[2]))
            moved = pose + np.array([time[0] * velocity.real, time[0] * velocity.imag, step[2]])
            at, _ = positions(moved, MOUNTING)
            here, direction = positions(pose, MOUNTING)
            expected = visible(driven, i)[:MOST_TARGETS]
            world = here + direction * expected.real * np.exp(1j * expected.imag)
            return abs(world - at)

        rate = central_difference(distances, np.zeros(1), np.array([1e-3]))[:, 0]
        assert_allclose(driven.scans[i].doppler, rate, rtol=0, atol=1e-6)


@pytest.mark.parametrize("quantity", ["range", "azimuth", "doppler"])
def test_noise_is_standard_normal_in_units_of_its_sigma(quantity):
    """Breaks if a sigma is a variance, degrees are radians, or two quantities share their noise."""
    options = {"mounting": MOUNTING, "detection": 1.0, "density": 0.03}
    driven = drive(7, **options)
    others = []
    errors = []
    for i, scan in enumerate(driven.scans):
        true = visible(driven, i)[:MOST_TARGETS]
        v_x, _, omega = driven.truth.theta[i]
        angle = true.imag + MOUNTING.yaw
        doppler = -(v_x - omega * MOUNTING.y) * np.cos(angle) - omega * MOUNTING.x * np.sin(angle)
        whole = {
            "range": (scan.range - true.real) / 0.15,
            "azimuth": (scan.azimuth - true.imag) / np.deg2rad(1.0),
            "doppler": (scan.doppler - doppler) / 0.06,
        }
        errors.append(whole.pop(quantity))
        others.append(np.stack(list(whole.values())))
    z, rest = np.concatenate(errors), np.concatenate(others, axis=1)
    assert len(z) > 5000
    assert kstest(z, "norm").pvalue > 0.01
    assert z.std() == pytest.approx(1.0, abs=3.0 / np.sqrt(2.0 * len(z)))
    assert np.abs(np.corrcoef(z, rest)[0, 1:]).max() < 4.0 / np.sqrt(len(z))
    assert abs(np.corrcoef(z[:-1], z[1:])[0, 1]) < 4.0 / np.sqrt(len(z))


def test_sigmas_that_are_given_are_those_of_the_scans():
    """Breaks if the scans claim another noise than the simulation adds."""
    scan = drive(8, sigma_range=0.1, sigma_azimuth=0.002, sigma_doppler=0.03).scans[5]
    assert_array_equal(scan.sigma_range, 0.1)
    assert_array_equal(scan.sigma_azimuth, 0.002)
    assert_array_equal(scan.sigma_doppler, 0.03)


def test_reflectors_have_the_density_that_is_asked_for():
    """Breaks if the world ends within the sensor's range of the path."""
    driven = drive(9, density=0.04)
    path = driven.truth.poses[:, :2]
    near = cKDTree(path).query(driven.reflectors)[0]
    rng = np.random.default_rng(10)
    low, high = path.min(axis=0) - 45.0, path.max(axis=0) + 45.0
    inside = ((driven.reflectors > low) & (driven.reflectors < high)).all(axis=1) & (near > 2.5)
    free = (cKDTree(path).query(rng.uniform(low, high, (20000, 2)))[0] > 2.5).mean()
    expected = 0.04 * free * np.prod(high - low)
    assert abs(inside.sum() - expected) < 4.0 * np.sqrt(expected)


@pytest.mark.parametrize("speed", [2.0, 20.0])
def test_reflectors_keep_two_metres_away_from_the_path(speed):
    """Breaks if only every other scan's position is looked at: at 20 m/s these are 4 m apart."""
    driven = drive(3, speed=speed)
    spline = CubicSpline(driven.truth.times, driven.truth.poses[:, :2])
    path = spline(np.linspace(0.0, 30.0, 30001))
    assert cKDTree(path).query(driven.reflectors)[0].min() > 1.9


@pytest.mark.parametrize(
    "name",
    ["duration", "speed", "density", "detection", "sigma_range", "sigma_azimuth", "sigma_doppler"],
)
@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf, "fast", [1.0, 2.0]], ids=str)
def test_bad_input_is_refused_by_name(name, bad):
    """Breaks if a bad number ends in a shape error or an endless world."""
    with pytest.raises(ValueError, match=f"^{name} must be"):
        simulate_drive(np.random.default_rng(0), **{name: bad})


def test_a_detection_probability_above_one_is_refused():
    """Breaks if more than everything can be detected."""
    with pytest.raises(ValueError, match=r"^detection must lie within \(0, 1\]"):
        simulate_drive(np.random.default_rng(0), detection=1.01)


def test_a_coarse_range_does_not_end_the_simulation():
    """Breaks if noise takes a near target's range below zero and the scan refuses it."""
    for seed in range(60):
        driven = simulate_drive(np.random.default_rng(seed), 5.0, sigma_range=1.0)
        assert all((scan.range > 0).all() for scan in driven.scans)


def test_an_empty_world_gives_empty_scans():
    """Breaks if nothing to see is an error."""
    driven = drive(0, density=1e-9)
    assert len(driven.scans) == 301
    assert {scan.size for scan in driven.scans} == {0}


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_doppler_sharpens_the_velocity_and_stays_credible(seed):
    """Breaks if the Doppler velocities do not help, or the covariances stop being honest.

    The bounds are not those of the chi-square distribution: the truth is that of the scan's time,
    while positions tell the mean velocity since the previous scan, which is not the same in a bend.
    """
    driven = simulate_drive(np.random.default_rng(seed), 40.0)
    sharp, plain = (
        DriveErrors.of(track(driven.scans, driven.mounting, doppler=doppler), driven.truth)
        for doppler in (True, False)
    )
    assert sharp.share > 0.99
    assert plain.share > 0.99
    assert sharp.rmse[0] < 0.03
    assert plain.rmse[0] > 5.0 * sharp.rmse[0]
    assert plain.rmse[1] > 5.0 * sharp.rmse[1]
    for judged in (sharp.credibility, plain.credibility):
        assert 0.85 < judged.anees < 1.25
        assert abs(judged.inclination) < 1.0
