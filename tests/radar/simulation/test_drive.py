"""The simulated drive: a lap around a block, a sensor with the noise and the limits it says."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.interpolate import CubicSpline
from scipy.stats import kstest

from d2d.radar import Drive, Mounting, doppler_velocity, simulate_drive
from d2d.radar.simulation.drive import CAR_SPEED, MAX_STEPS, Sensor
from d2d.radar.simulation.world import KINDS, build_world, open_field
from tests.strategies import central_difference

MOUNTING = Mounting(1.2, -0.4, 0.3)
EXACT = Sensor(quantised=False)
SILENT = replace(EXACT, sigma_range=1e-9, sigma_azimuth=1e-9, sigma_doppler=1e-9, clutter=0.0)
KEEN = replace(SILENT, max_targets=10_000, half_range=1e4)  # detects all that is in view
OUTPUTS = ("range", "azimuth", "doppler")


@cache
def drive(seed: int = 0, duration: float = 30.0, **options) -> Drive:
    """A drive, simulated once for all tests that look at it."""
    return simulate_drive(np.random.default_rng(seed), duration, **options)


def sensor_frame(pose: np.ndarray, mounting: Mounting) -> tuple[complex, complex]:
    """Position of the sensor in the world and its direction, as complex numbers."""
    direction = np.exp(1j * pose[2])
    at = complex(*pose[:2]) + complex(mounting.x, mounting.y) * direction
    return at, direction * np.exp(1j * mounting.yaw)


def everything(driven: Drive, i: int) -> tuple[np.ndarray, np.ndarray]:
    """All points of the world in the sensor's frame at scan i, and their velocities over ground."""
    at, direction = sensor_frame(driven.truth.poses[i], driven.mounting)
    moving, velocity = driven.world.movers.at(driven.truth.times[i])
    points = np.concatenate([driven.world.points, moving]) @ [1.0, 1.0j]
    ground = np.concatenate([np.zeros(len(points) - len(moving)), velocity @ [1.0, 1.0j]])
    return (points - at) / direction, ground / direction


def test_the_same_seed_gives_the_same_drive():
    """Breaks if anything draws from a state other than the generator."""
    first, again, other = (simulate_drive(np.random.default_rng(seed), 5.0) for seed in (1, 1, 2))
    assert_array_equal(first.world.points, again.world.points)
    for a, b in zip(first.scans, again.scans, strict=True):
        for name in ("time", *OUTPUTS, "sigma_azimuth"):
            assert_array_equal(getattr(a, name), getattr(b, name))
    for a, b in zip(first.targets, again.targets, strict=True):
        assert_array_equal(a.kind, b.kind)
    assert not np.array_equal(first.scans[0].azimuth[:5], other.scans[0].azimuth[:5])
    given = simulate_drive(np.random.default_rng(4), 2.0, world=other.world)
    assert given.world is other.world


def test_scans_truth_and_labels_are_given_at_the_same_times():
    """Breaks if the rate is not 10 Hz or a list has another length."""
    driven = drive()
    times = np.array([scan.time for scan in driven.scans])
    assert_array_equal(times, driven.truth.times)
    assert_allclose(times, np.arange(301) / 10.0, rtol=0, atol=1e-12)
    assert driven.truth.theta.shape == driven.truth.poses.shape == (301, 3)
    assert [scan.size for scan in driven.scans] == [len(true.kind) for true in driven.targets]
    fast = simulate_drive(np.random.default_rng(0), 0.7, sensor=Sensor(rate=30.0))
    assert_allclose(fast.truth.times, np.arange(22) / 30.0, rtol=0, atol=1e-12)


def test_velocity_is_the_derivative_of_the_poses():
    """Breaks if theta is not in the vehicle's axes."""
    often, world, speed = Sensor(rate=50.0), open_field(np.empty((0, 2)), 1.0), CAR_SPEED
    rng = np.random.default_rng(0)
    truth = simulate_drive(rng, 300.0 / speed, speed, sensor=often, world=world).truth
    inner = slice(10, -10)  # a spline is less exact at its ends
    rate = CubicSpline(truth.times, truth.poses)(truth.times[inner], 1)
    turned = rate[:, :2] @ [1.0, 1.0j] * np.exp(-1j * truth.poses[inner, 2])
    numeric = np.column_stack([turned.real, turned.imag, rate[:, 2]])
    assert_allclose(numeric, truth.theta[inner], rtol=0, atol=2e-4 * speed)
    assert (truth.theta[:, 0] > 0).all()
    assert_array_equal(truth.theta[:, 1], 0.0)
    assert truth.theta[:, 2].max() > 0.05 * speed
    assert truth.theta[:, 2].min() < -0.05 * speed
    closed = truth.poses[-1] - truth.poses[0]
    assert_allclose(closed, [0, 0, 2.0 * np.pi], rtol=0, atol=0.1 * speed)


def test_a_keen_sensor_sees_all_that_nothing_hides():
    """Breaks if something is seen through a wall, or the field of view is the vehicle's."""
    driven = drive(4, 8.0, mounting=MOUNTING, sensor=KEEN)
    hidden = 0
    for i in (0, 40, 80):
        points, _ = everything(driven, i)
        inside = (abs(points) > 1.0) & (abs(points) < 50.0)
        inside &= abs(np.angle(points)) < np.deg2rad(40.0)
        inside = np.flatnonzero(inside)
        at, direction = sensor_frame(driven.truth.poses[i], MOUNTING)
        outlines = np.concatenate([driven.world.buildings, driven.world.cars]) @ [1.0, 1.0j]
        rays = at + direction * np.linspace(0.0, 1.0, 2001)[:-1] * points[inside, None]
        free = ~np.any([within(rays, outline) for outline in outlines], axis=(0, 2))
        hidden += len(inside) - free.sum()
        wrong = np.setxor1d(driven.targets[i].point, inside[free])
        assert len(wrong) <= 3, "steps of 2 cm may miss a corner"
        assert free.sum() > 30
    assert hidden > 300


def within(points: np.ndarray, outline: np.ndarray) -> np.ndarray:
    """Whether complex points lie inside the convex, counter-clockwise outline."""
    inside = np.ones(points.shape, dtype=bool)
    for start, end in zip(outline, np.roll(outline, -1), strict=True):
        inside &= ((points - start) / (end - start)).imag > 1e-9
    return inside


def test_truth_of_the_targets_is_that_of_their_points():
    """Breaks if targets and labels change places when the strongest are chosen."""
    driven = drive(6, mounting=MOUNTING)
    still = len(driven.world.kind)
    for i in range(0, 301, 10):
        true = driven.targets[i]
        real = true.kind != "clutter"
        assert_array_equal(true.point >= 0, real)
        assert np.isnan([getattr(true, name)[~real] for name in OUTPUTS]).all()
        true = true[real]
        points, _ = everything(driven, i)
        assert len(set(true.point)) == len(true.point)
        assert_allclose(true.range, abs(points[true.point]), rtol=0, atol=1e-9)
        assert_allclose(true.azimuth, np.angle(points[true.point]), rtol=0, atol=1e-9)
        moving = true.point >= still
        assert_array_equal(true.kind == "moving", moving)
        kinds = driven.world.kind[true.point[~moving]]
        assert_array_equal(true.kind[~moving], kinds)
    assert {kind for true in driven.targets for kind in true.kind} == set(KINDS)


def test_doppler_is_the_range_rate_along_the_drive():
    """Breaks if the Doppler velocities are not those of the moving, turning sensor and target."""
    driven = drive(6, mounting=MOUNTING)
    moving = 0
    for i in range(0, 300, 10):
        pose, theta, now = driven.truth.poses[i], driven.truth.theta[i], driven.truth.times[i]
        true = driven.targets[i][driven.targets[i].kind != "clutter"]

        def distances(time, pose=pose, theta=theta, now=now, true=true):
            """As the vehicle goes on with the velocity of now, and the movers go on."""
            step = time[0] * theta
            velocity = theta[0] * np.exp(1j * (pose[2] + 0.5 * step[2]))
            moved = pose + np.array([time[0] * velocity.real, time[0] * velocity.imag, step[2]])
            at, _ = sensor_frame(moved, MOUNTING)
            movers = driven.world.movers.at(now + time[0])[0]
            points = np.concatenate([driven.world.points, movers]) @ [1.0, 1.0j]
            return abs(points[true.point] - at)

        rate = central_difference(distances, np.zeros(1), np.array([1e-3]))[:, 0]
        assert_allclose(true.doppler, rate, rtol=0, atol=1e-5)
        model = doppler_velocity(theta, true.azimuth, MOUNTING)
        static = true.kind != "moving"
        assert_allclose(true.doppler[static], model[static], rtol=0, atol=1e-12)
        moving += (np.abs(true.doppler - model)[~static] > 0.5).sum()
    assert moving > 10


def test_errors_are_standard_normal_in_units_of_the_reported_sigma():
    """Breaks if a sigma is a variance, or two quantities or two scans share their noise."""
    driven = drive(7, mounting=MOUNTING, sensor=EXACT)
    errors = []
    for scan, true in zip(driven.scans, driven.targets, strict=True):
        real = true.kind != "clutter"
        parts = [
            (getattr(scan, name) - getattr(true, name)) / getattr(scan, f"sigma_{name}")
            for name in OUTPUTS
        ]
        errors.append(np.stack(parts)[:, real])
    normal = np.concatenate(errors, axis=1)
    count = normal.shape[1]
    assert count > 5000
    for z in normal:
        assert kstest(z, "norm").pvalue > 0.01
        assert z.std() == pytest.approx(1.0, abs=3.0 / np.sqrt(2.0 * count))
        assert abs(np.corrcoef(z[:-1], z[1:])[0, 1]) < 4.0 / np.sqrt(count)
    shared = np.corrcoef(normal)[np.triu_indices(3, 1)]
    assert np.abs(shared).max() < 4.0 / np.sqrt(count)


def test_sigmas_grow_from_strong_to_weak_targets():
    """Breaks if the reported sigmas are constant, or not those of the sensor."""
    for scan in drive(7, mounting=MOUNTING, sensor=EXACT).scans[::50]:
        for name, least in (("range", 0.1), ("azimuth", 0.009), ("doppler", 0.06)):
            sigma = getattr(scan, f"sigma_{name}")
            assert (np.diff(sigma) >= 0.0).all(), "the strongest first"
            assert (sigma > least).all()
            assert (sigma < 2.0 * least).all()
            assert sigma[-1] > 1.1 * sigma[0]


def test_quantised_values_lie_on_the_grid_of_the_sensor():
    """Breaks if a step is wrong, values are cut off instead of rounded, a sigma becomes zero or
    needs more than six bits."""
    driven = drive(0, mounting=MOUNTING)
    coarse = simulate_drive(np.random.default_rng(0), 5.0, sensor=Sensor(sigma_range=6.0))
    steps = {"range": 0.0625, "azimuth": 0.0002, "doppler": 0.0625}
    sigma_steps = {"sigma_range": 0.0625, "sigma_azimuth": 0.001, "sigma_doppler": 0.0625}
    for scan in [*driven.scans[::10], *coarse.scans[::10]]:
        for name, step in (steps | sigma_steps).items():
            number = getattr(scan, name) / step
            assert_allclose(number, np.round(number), rtol=0, atol=1e-6)
        for name, step in sigma_steps.items():
            assert getattr(scan, name).min() > 0.999 * step
            assert getattr(scan, name).max() < (MAX_STEPS + 1e-6) * step
    assert max(scan.sigma_range.max() for scan in coarse.scans) == pytest.approx(63 * 0.0625)
    fine, rounded = (
        simulate_drive(np.random.default_rng(2), 5.0, sensor=replace(SILENT, quantised=quantised))
        for quantised in (False, True)
    )
    for a, b in zip(fine.scans, rounded.scans, strict=True):
        for name, step in steps.items():
            assert np.abs(getattr(a, name) - getattr(b, name)).max() <= step / 2 + 1e-9


def test_a_scan_holds_at_most_48_targets_the_strongest():
    """Breaks if the cut keeps others than a sensor without the limit would put first."""
    limited, free = (
        simulate_drive(np.random.default_rng(5), 0.05, sensor=replace(SILENT, max_targets=most))
        for most in (20, 1000)
    )
    assert limited.scans[0].size == 20
    assert free.scans[0].size > 30
    assert_array_equal(limited.targets[0].point, free.targets[0].point[:20])
    sizes = [scan.size for scan in drive(0).scans]
    assert max(sizes) == 48
    assert min(sizes) < 48


def test_detection_falls_with_range_as_swerling_says():
    """Breaks if a point of strength 1 at the half range is not detected every other time."""
    ranges, angle = np.array([12.0, 25.0, 35.0]), np.array([-0.3, 0.0, 0.3])
    world = open_field(np.column_stack([ranges * np.cos(angle), ranges * np.sin(angle)]), 1.0)
    sensor = replace(SILENT, max_range=60.0, max_targets=10_000, rate=1.0)
    still = simulate_drive(
        np.random.default_rng(0), 3000.0, 1e-9, mounting=Mounting(), sensor=sensor, world=world
    )
    seen = np.concatenate([true.point for true in still.targets])
    found = np.bincount(seen, minlength=3) / len(still.scans)
    expected = 0.5 ** ((ranges / 25.0) ** 4)
    deviation = np.sqrt(expected * (1.0 - expected) / len(still.scans))
    assert (np.abs(found - expected) < 4.0 * deviation).all()


def test_clutter_comes_as_often_as_asked_for_and_from_everywhere():
    """Breaks if clutter is left out, or keeps to a part of what is in view."""
    blind = Sensor(half_range=1e-3, clutter=3.0, quantised=False)
    driven = simulate_drive(np.random.default_rng(1), 120.0, sensor=blind)
    counts = np.array([scan.size for scan in driven.scans])
    assert {kind for true in driven.targets for kind in true.kind} == {"clutter"}
    assert counts.mean() == pytest.approx(3.0, abs=4.0 * np.sqrt(3.0 / len(counts)))
    assert counts.var() == pytest.approx(3.0, rel=0.2)
    for name, low, high in (
        ("range", 1.0, 50.0),
        ("azimuth", -np.deg2rad(40.0), np.deg2rad(40.0)),
        ("doppler", -10.0, 10.0),
    ):
        values = np.concatenate([getattr(scan, name) for scan in driven.scans])
        assert kstest(values, "uniform", args=(low, high - low)).pvalue > 0.01
    world = open_field(np.empty((0, 2)), 1.0)
    for sensor, options in ((replace(blind, clutter=0.0), {}), (SILENT, {"world": world})):
        none = simulate_drive(np.random.default_rng(1), 5.0, sensor=sensor, **options)
        assert {scan.size for scan in none.scans} == {0}


def test_bad_input_is_refused_by_name():
    """Breaks if a bad number ends in an endless drive, or a seed draws from global state."""
    for name, bad in (
        *(("duration", 0.0), ("duration", np.inf), ("speed", -1.0), ("speed", "fast")),
        *(("start", "late"), ("mounting", 3), ("sensor", {}), ("world", 3), ("errors", 3)),
    ):
        with pytest.raises(ValueError, match=f"^{name} must be"):
            simulate_drive(np.random.default_rng(0), **{name: bad})
    for function in (simulate_drive, build_world):
        with pytest.raises(ValueError, match=r"^rng must be"):
            function(7)
    for name, bad in (
        *(("rate", 0.0), ("max_targets", 4.5), ("field_of_view", 40.0), ("max_range", 0.5)),
        *(("half_range", np.nan), ("sigma_azimuth", -1.0), ("clutter", -0.1)),
    ):
        with pytest.raises(ValueError, match=f"^{name} must"):
            Sensor(**{name: bad})
