"""Scans of static points by sensors of a moving vehicle, which the tests of the radar share."""

from dataclasses import replace
from functools import cache

import numpy as np
from hypothesis import strategies as st
from scipy.linalg import expm

from d2d.radar import Drive, Mounting, RadarScan, Reference, doppler_velocity, simulate_drive
from tests.strategies import reals

CORNER = Mounting(3.86, 0.7, 0.436)
AROUND = (CORNER, Mounting(3.6, -0.9, -1.48), Mounting(-0.9, -0.87, -2.9))
SIGMAS = (0.15, np.deg2rad(0.5), 0.06)
STRAIGHT = np.array([12.0, 0.0, 0.1])

velocities = st.tuples(reals(-40.0, 40.0), reals(-3.0, 3.0), reals(-1.0, 1.0)).map(np.array)
mountings = st.builds(Mounting, reals(-4.0, 4.0), reals(-2.0, 2.0), reals(-3.2, 3.2))


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
    points = np.column_stack([points, np.ones(len(points))])
    local = np.linalg.solve(pose @ frame(mounting), points.T)
    distance, azimuth = np.hypot(local[0], local[1]), np.arctan2(local[1], local[0])
    values = np.stack([distance, azimuth, doppler_velocity(theta, azimuth, mounting)])
    return RadarScan(time, *(values + np.array(sigmas)[:, None] * noise), *sigmas)


def two_scans(
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


@cache
def _whole_drive() -> Drive:
    """A simulated drive of a minute, simulated once."""
    return simulate_drive(np.random.default_rng(0), 60.0, mounting=CORNER)


def beginning(count: int = 40) -> Drive:
    """The first scans of a simulated drive."""
    whole = _whole_drive()
    truth = whole.truth
    part = Reference(truth.times[:count], truth.theta[:count], truth.poses[:count])
    return replace(whole, scans=whole.scans[:count], truth=part)


def straight_scans() -> list[RadarScan]:
    """Scans of one world from a car at 12 m/s, too fast to be registered from a start at zero."""
    rng = np.random.default_rng(40)
    points = rng.uniform([-10.0, -60.0], [90.0, 60.0], (400, 2))
    return _seen(rng, points, 0.1 * np.arange(12), STRAIGHT, CORNER)


def surround_scans(
    count: int = 12, theta=STRAIGHT, times=None, shift: float = 0.013
) -> list[tuple[list[RadarScan], Mounting]]:
    """Scans of one world by three sensors that do not run in step, at these times."""
    rng, theta = np.random.default_rng(70), np.array(theta)
    points = rng.uniform([-60.0, -60.0], [90.0, 60.0], (600, 2))
    times = 0.1 * np.arange(count) if times is None else np.asarray(times)
    return [
        (_seen(rng, points, times + shift * s, theta, mounting), mounting)
        for s, mounting in enumerate(AROUND)
    ]


def named_sensors(count=30, **options) -> dict[str, tuple[list[RadarScan], Mounting]]:
    """Three sensors by their names."""
    return dict(zip(("left", "right", "rear"), surround_scans(count, **options), strict=True))


def in_order(sensors):
    """Times, names and scans as they are measured."""
    return sorted((scan.time, name, scan) for name, (scans, _) in sensors.items() for scan in scans)


def accelerating(rates, offsets, acceleration, mountings, jitter=0.0, noise=0.0, seed=0, end=3.0):
    """Scans of static points by sensors of a vehicle with a constant acceleration."""
    rng, start, step = np.random.default_rng(seed), np.array([12.0, 0.0, 0.05]), 1e-3
    poses = [np.eye(3)]
    for i in range(round(end / step) + 1):
        poses.append(poses[-1] @ arc(start + acceleration * (i + 0.5) * step, step))
    middle = [poses[i][:2, 2] for i in rng.integers(0, len(poses), 250)]
    points = np.array(middle) + rng.uniform(-45.0, 45.0, (250, 2))
    sensors = []
    for rate, offset, mounting in zip(rates, offsets, mountings, strict=True):
        scans = []
        for k in range(int(end * rate)):
            ticks = round((offset + (k + jitter * rng.uniform()) / rate) / step)
            pose, time = poses[ticks], ticks * step
            far = points[np.hypot(*(points - pose[:2, 2]).T) > 8.0]
            errors = noise * rng.standard_normal((3, len(far)))
            theta = start + acceleration * time
            full = observe(far, pose, time, theta, mounting, errors, (0.1, 0.005, 0.06))
            scans.append(full[(np.abs(full.azimuth) < 0.8) & (full.range < 50.0)])
        sensors.append((scans, mounting))
    return sensors, lambda times: start + np.outer(times, acceleration)


def _seen(rng, points, times, theta, mounting) -> list[RadarScan]:
    """Scans of world points at each time, of those in front of the sensor."""
    scans = []
    for time in times:
        noise = rng.standard_normal((3, len(points)))
        full = observe(points, arc(theta, time), time, theta, mounting, noise, (0.05, 1e-3, 0.06))
        scans.append(full[(np.abs(full.azimuth) < 0.8) & (full.range < 45.0)])
    return scans
