"""A drive with a Doppler radar that anyone can recompute."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from d2d import rigid
from d2d._checks import Array, positive, scalar
from d2d.radar.reference import Reference
from d2d.radar.scan import Mounting, RadarScan, doppler_velocity

# The thesis's sensor: 77 GHz, 10 Hz, at most 48 targets a scan (thesis sec. 7.2).
RATE = 10.0
MOST_TARGETS = 48
FIELD_OF_VIEW = np.deg2rad(40.0)
LONGEST_RANGE = 50.0
SHORTEST_RANGE = 1.0
CLEARANCE = 2.0  # m, between the driven path and the reflectors
MOUNTING = Mounting(0.4, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Drive:
    """A simulated drive.

    Attributes
    ----------
    scans : list of RadarScan
    mounting : Mounting
    truth : Reference
        At the times of the scans.
    reflectors : (n, 2) array, m
        Static reflectors of the world.
    """

    scans: list[RadarScan]
    mounting: Mounting
    truth: Reference
    reflectors: Array


def simulate_drive(
    rng: np.random.Generator,
    duration: float = 60.0,
    speed: float = 2.0,
    *,
    mounting: Mounting = MOUNTING,
    density: float = 0.04,
    detection: float = 0.8,
    sigma_range: float = 0.15,
    sigma_azimuth: float = np.deg2rad(1.0),
    sigma_doppler: float = 0.06,
) -> Drive:
    """Drive a closed loop through a static world of point reflectors.

    Parameters
    ----------
    rng : numpy.random.Generator
    duration : float, s
        Of one lap of the loop: the shorter, the tighter are its bends.
    speed : float, m/s
        Mean speed; it swings between about 0.4 and 1.6 times that.
    mounting : Mounting
        Of the sensor in the vehicle frame.
    density : float, 1/m^2
        Of the reflectors, which keep 2 m away from the driven path.
    detection : float
        Probability that a reflector in the field of view (40 deg to either side, 1 to 50 m) is
        detected; of more than 48 detections a scan keeps the nearest 48.
    sigma_range, sigma_azimuth, sigma_doppler : float, m, rad, m/s
        Standard deviations of the Gaussian noise.

    Returns
    -------
    Drive

    Raises
    ------
    ValueError
        Naming the argument that is not positive, or a detection probability outside (0, 1].
    """
    if not isinstance(rng, np.random.Generator):
        raise ValueError(f"rng must be a numpy.random.Generator, but is a {type(rng).__name__}")
    for name, value in (
        ("duration", duration),
        ("speed", speed),
        ("density", density),
        ("sigma_range", sigma_range),
        ("sigma_azimuth", sigma_azimuth),
        ("sigma_doppler", sigma_doppler),
        ("detection", detection),
    ):
        positive(name, scalar(name, value))
    if detection > 1:
        raise ValueError(f"detection must lie within (0, 1], but is {detection:g}")
    truth = _closed_loop(duration, speed)
    reflectors = _scatter(rng, truth.poses[:, :2], density)
    sigmas = (sigma_range, sigma_azimuth, sigma_doppler)
    scans = [
        _scan(rng, time, theta, pose, mounting, reflectors, detection, sigmas)
        for time, theta, pose in zip(truth.times, truth.theta, truth.poses, strict=True)
    ]
    return Drive(scans, mounting, truth, reflectors)


def _closed_loop(duration: float, speed: float) -> Reference:
    """A smooth closed path with bends to either side, driven without side slip.

    The path is a circle whose radius swings with the angle; its derivatives are in closed form, so
    the velocities are exact.
    """
    times = np.arange(int(np.floor(duration * RATE)) + 1) / RATE
    share = times / duration
    # progress along the path, faster and slower three times a lap
    u = 2.0 * np.pi * share + 0.15 * np.sin(6.0 * np.pi * share)
    rate = (2.0 * np.pi + 0.9 * np.pi * np.cos(6.0 * np.pi * share)) / duration
    radius = 1.0 + 0.25 * np.cos(3.0 * u)
    d_radius, dd_radius = -0.75 * np.sin(3.0 * u), -2.25 * np.cos(3.0 * u)
    length = _lap_length()
    size = speed * duration / length
    cosine, sine = np.cos(u), np.sin(u)
    d = np.stack([d_radius * cosine - radius * sine, d_radius * sine + radius * cosine])
    dd = np.stack(
        [
            dd_radius * cosine - 2.0 * d_radius * sine - radius * cosine,
            dd_radius * sine + 2.0 * d_radius * cosine - radius * sine,
        ]
    )
    pace = np.hypot(*d)
    forward = size * pace * rate
    turn = (d[0] * dd[1] - d[1] * dd[0]) / pace**2 * rate
    yaw = np.unwrap(np.arctan2(d[1], d[0]))
    position = size * np.column_stack([radius * cosine, radius * sine])
    theta = np.column_stack([forward, np.zeros_like(forward), turn])
    return Reference(times, theta, np.column_stack([position, yaw]))


def _lap_length() -> float:
    u = np.linspace(0.0, 2.0 * np.pi, 2001)[:-1]
    return float(
        np.hypot(1.0 + 0.25 * np.cos(3.0 * u), 0.75 * np.sin(3.0 * u)).mean() * 2.0 * np.pi
    )


def _scatter(rng: np.random.Generator, path: Array, density: float) -> Array:
    low, high = path.min(axis=0) - LONGEST_RANGE, path.max(axis=0) + LONGEST_RANGE
    count = rng.poisson(density * np.prod(high - low))
    points = rng.uniform(low, high, size=(count, 2))
    steps = np.linspace(0.0, len(path) - 1.0, int(np.ceil(_length(path) / 0.1)) + 1)
    fine = [np.interp(steps, np.arange(len(path)), axis) for axis in path.T]
    gaps, _ = cKDTree(np.column_stack(fine)).query(points)
    return np.asarray(points[gaps > CLEARANCE])


def _length(path: Array) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def _scan(
    rng: np.random.Generator,
    time: float,
    theta: Array,
    pose: Array,
    mounting: Mounting,
    reflectors: Array,
    detection: float,
    sigmas: tuple[float, float, float],
) -> RadarScan:
    sensor = rigid.compose(pose, mounting.pose)
    local = rigid.transform_means(rigid.inverse(sensor), reflectors)
    distance, azimuth = np.hypot(local[:, 0], local[:, 1]), np.arctan2(local[:, 1], local[:, 0])
    seen = (distance > SHORTEST_RANGE) & (distance < LONGEST_RANGE)
    seen &= (np.abs(azimuth) < FIELD_OF_VIEW) & (rng.random(len(distance)) < detection)
    nearest = np.flatnonzero(seen)
    nearest = nearest[np.argsort(distance[nearest])][:MOST_TARGETS]
    distance, azimuth = distance[nearest], azimuth[nearest]
    doppler = doppler_velocity(theta, azimuth, mounting)
    noise = rng.standard_normal((3, len(nearest)))
    measured = distance + sigmas[0] * noise[0]
    kept = measured > 0.0  # a coarse range may fall behind the sensor, which no radar reports
    return RadarScan(
        time,
        measured[kept],
        (azimuth + sigmas[1] * noise[1])[kept],
        (doppler + sigmas[2] * noise[2])[kept],
        *sigmas,
    )
