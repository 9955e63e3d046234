"""Simulated logs of many vehicles and radars, right ones and ones with a fault, for `diagnose`."""

from collections.abc import Callable
from dataclasses import replace
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from d2d import rigid
from d2d._types import Array
from d2d.radar import Mounting, RadarScan, Reference, doppler_velocity, over_ground_undone

Sensors = dict[str, tuple[list[RadarScan], Mounting]]
_STEP = 0.02  # s, of the integrated path
_DOPPLER, _AZIMUTH, _RANGE = 0.06, np.deg2rad(0.5), 0.1  # standard deviations in m/s, rad, m


class Vehicle(NamedTuple):
    """How a vehicle drives, and what is beside its way."""

    speeds: tuple[float, float]  # m/s, between which its speed changes
    turn: float  # rad/s, how fast it turns at most
    beside: tuple[float, float]  # m to either side, where static targets are
    reach: float  # m, of the radars
    front: float  # m, how far a front radar is ahead of the rear axle
    traffic: int  # other vehicles
    stands: float = 0.0  # share of the time at rest


VEHICLES = {
    "car": Vehicle((4.0, 20.0), 0.25, (4.0, 30.0), 60.0, 3.6, 4),
    "robot": Vehicle((0.4, 2.5), 0.5, (2.0, 20.0), 30.0, 0.4, 1),
    "train": Vehicle((25.0, 50.0), 0.01, (4.0, 30.0), 90.0, 8.0, 1),
    "truck": Vehicle((3.0, 15.0), 0.15, (4.0, 30.0), 60.0, 5.5, 3),
    "indoor": Vehicle((0.2, 1.0), 0.5, (1.0, 6.0), 15.0, 0.3, 1),
    "tunnel": Vehicle((8.0, 20.0), 0.03, (4.0, 5.0), 60.0, 3.6, 3),
    "standing in traffic": Vehicle((2.0, 10.0), 0.1, (5.0, 30.0), 60.0, 3.6, 10, 0.5),
}
PLACES = {  # of one radar to five, relative to the front radar's distance from the axle
    1: [(1.0, 0.0, 0.0)],
    2: [(0.97, 0.7, 0.9), (0.97, -0.7, -0.9)],
    3: [(1.0, 0.0, 0.0), (0.0, 0.7, 2.4), (0.0, -0.7, -2.4)],
    4: [(0.97, 0.7, 0.9), (0.97, -0.7, -0.9), (-0.2, 0.7, 2.4), (-0.2, -0.7, -2.4)],
}
PLACES[5] = [*PLACES[1], *PLACES[4]]


class Log(NamedTuple):
    """A log, the motion that it is of, and what it is a log of."""

    sensors: Sensors
    truth: Reference
    vehicle: str


def right_log(
    rng: np.random.Generator,
    vehicle: str,
    radars: int = 1,
    rate: float = 10.0,
    targets: int = 40,
    duration: float = 20.0,
) -> Log:
    """A log without any fault, of radars that see up to so many targets in each scan."""
    kind = VEHICLES[vehicle]
    truth = _motion(rng, kind, duration)
    points = _static_points(rng, kind, truth.poses)
    sensors: Sensors = {}
    for number, (ahead, left, yaw) in enumerate(PLACES[radars], start=1):
        mounting = Mounting(kind.front * ahead, left, yaw)
        times = np.arange(0.01 * number, duration, 1.0 / rate) + 2e-3 * rng.standard_normal()
        motion = truth.at(np.clip(times, 0.0, duration))
        moving = _traffic(np.random.default_rng(rng.integers(1 << 30)), kind, motion)
        still = np.pad(points, ((0, 0), (0, 2)))
        scans = [
            _scan(rng, np.concatenate([others, still]), t, pose, v, mounting, kind.reach, targets)
            for others, t, pose, v in zip(moving, times, motion.poses, motion.theta, strict=True)
        ]
        sensors[f"r{number}"] = scans, mounting
    return Log(sensors, truth, vehicle)


def _motion(rng: np.random.Generator, kind: Vehicle, duration: float) -> Reference:
    """The motion of a vehicle whose rear axle does not slip."""
    times = np.arange(0.0, duration + _STEP, _STEP)
    knots = np.arange(0.0, duration + 4.0, 4.0)
    speed = np.interp(times, knots, rng.uniform(*kind.speeds, len(knots)))
    if kind.stands:
        stop = rng.uniform(0.2, 0.4) * duration
        held = (times > stop) & (times < stop + kind.stands * duration)
        away = np.minimum(np.abs(times - stop), np.abs(times - stop - kind.stands * duration))
        speed = np.where(held, 0.0, np.minimum(speed, 3.0 * away))
    omega = np.interp(times, knots, rng.uniform(-kind.turn, kind.turn, len(knots)))
    omega *= np.minimum(speed / kind.speeds[0], 1.0)
    theta = np.column_stack([speed, 0.0 * speed, omega])
    poses = np.zeros((len(times), 3))
    for i, step in enumerate(_STEP * 0.5 * (theta[1:] + theta[:-1])):
        poses[i + 1] = rigid.compose(poses[i], rigid.exponential(step))
    return Reference(times, theta, poses)


def _static_points(rng: np.random.Generator, kind: Vehicle, poses: Array) -> Array:
    """Static points (n, 2) in m to either side of the whole path, and beyond its ends."""
    length = np.hypot(*np.diff(poses[:, :2], axis=0).T).sum() + 4.0 * kind.reach
    count = int(120.0 * length / kind.reach) + 200
    along = rng.uniform(-1.5 * kind.reach, length - 2.5 * kind.reach, count)
    driven = np.r_[0.0, np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))]
    nearest = poses[np.clip(np.searchsorted(driven, along), 0, len(poses) - 1)]
    over = along - np.clip(along, 0.0, driven[-1])
    beside = rng.uniform(*kind.beside, count) * rng.choice([-1.0, 1.0], count)
    places = rigid.compose(nearest, np.column_stack([over, beside, 0.0 * over]))[:, :2]
    clear = [np.abs(poses[::10, :2] - p).max(axis=1).min() > 0.7 * kind.beside[0] for p in places]
    return np.asarray(places[clear])


def _traffic(rng: np.random.Generator, kind: Vehicle, motion: Reference) -> Array:
    """Places and velocities (scans, points, 4) of other vehicles, about this one's way."""
    cars, fastest = kind.traffic, kind.speeds[1]
    lane = rng.choice([-3.5, 3.5], cars)
    pace = np.where(lane > 0.0, -1.0, 1.0) * rng.uniform(0.5, 1.0, cars) * fastest
    begin = rng.uniform(-kind.reach, 2.0 * kind.reach, cars)
    heading = motion.poses[0, 2]
    ahead, left = rigid.rotation(heading).T
    extent = rng.uniform(-1.5, 1.5, (cars, 3)) * min(1.0, kind.front)
    along = (
        begin[:, None] + extent + pace[:, None] * (motion.times - motion.times[0])[:, None, None]
    )
    about = motion.poses[:, None, None, :2] @ ahead
    along = (along - about + kind.reach) % (3.0 * kind.reach) - kind.reach + about
    side = motion.poses[:, None, None, :2] @ left + lane[:, None] + 0.0 * extent
    place = along[..., None] * ahead + side[..., None] * left
    velocity = np.broadcast_to((pace[:, None] + 0.0 * extent)[..., None] * ahead, place.shape)
    return np.concatenate([place, velocity], axis=-1).reshape(len(motion.times), -1, 4)


def _scan(
    rng: np.random.Generator,
    points: Array,
    time: float,
    pose: Array,
    theta: Array,
    mounting: Mounting,
    reach: float,
    most: int,
) -> RadarScan:
    """A scan of points with their velocities over ground (n, 4), with some clutter."""
    at = rigid.compose(pose, mounting.pose)
    local = (points[:, :2] - at[:2]) @ rigid.rotation(at[2])
    distance, azimuth = np.hypot(*local.T), np.arctan2(local[:, 1], local[:, 0])
    shown = (distance < reach) & (distance > 0.5) & (np.abs(azimuth) < 1.05)
    shown &= rng.random(len(points)) < 0.8
    (kept,) = np.nonzero(shown)
    kept = kept[np.argsort(distance[kept] * rng.uniform(0.7, 1.3, len(kept)))][:most]
    doppler = doppler_velocity(theta, azimuth[kept], mounting)
    sight = local[kept] / distance[kept, None]
    doppler += np.einsum("ki,ki->k", points[kept, 2:] @ rigid.rotation(at[2]), sight)
    false = rng.uniform([1.0, -1.0, -5.0], [reach, 1.0, 5.0], (rng.poisson(1.0), 3))
    noise = rng.standard_normal((3, len(kept))) * [[_RANGE], [_AZIMUTH], [_DOPPLER]]
    values = np.stack([distance[kept], azimuth[kept], doppler]) + noise
    values = np.concatenate([values, false.T], axis=1)
    far, angle, speed = values
    return RadarScan(time, np.maximum(far, 0.1), angle, speed, _RANGE, _AZIMUTH, _DOPPLER)


# ---- Faults

Put = Callable[[np.random.Generator, Log], Sensors]


class Fault(NamedTuple):
    """A fault that is put into a log, and what names it."""

    put: Put
    symptoms: tuple[str, ...]
    radars: tuple[int, ...] = (1, 2, 4)  # of the logs that it is put into
    vehicles: tuple[str, ...] = tuple(VEHICLES)


def _changed(
    log: Log, change: Callable[[list[RadarScan], Mounting], list[RadarScan]], *names: str
) -> Sensors:
    """The sensors after a change of the scans of those with these names, or of all."""
    return {
        name: (change(scans, at) if not names or name in names else scans, at)
        for name, (scans, at) in log.sensors.items()
    }


def _scans(change: Callable[[RadarScan], RadarScan], *names: str) -> Put:
    return lambda rng, log: _changed(log, lambda scans, at: [change(s) for s in scans], *names)


def _field(name: str, change: Callable[[Any], Any]) -> Put:
    """A change of one field of every scan."""
    return _scans(lambda scan: replace(scan, **{name: change(getattr(scan, name))}))


def _places(change: Callable[[Mounting], Mounting], *names: str) -> Put:
    return lambda rng, log: {
        name: (scans, change(at) if not names or name in names else at)
        for name, (scans, at) in log.sensors.items()
    }


def _turned(degrees: float) -> Put:
    return _places(lambda at: replace(at, yaw=at.yaw + np.deg2rad(degrees)), "r1")


def _late(lag: float) -> Put:
    return _scans(lambda scan: replace(scan, time=scan.time + lag), "r1")


def _regrouped(stamp: Callable[[RadarScan], float]) -> Put:
    """Scans with other time stamps; those of equal times in succession become one."""

    def regrouped(scans: list[RadarScan], at: Mounting) -> list[RadarScan]:
        return [_joined(time, [*own]) for time, own in groupby(scans, key=stamp)]

    return lambda rng, log: _changed(log, regrouped)


def _joined(time: float, scans: list[RadarScan]) -> RadarScan:
    fields = ("range", "azimuth", "doppler", "sigma_range", "sigma_azimuth", "sigma_doppler")
    values = [np.concatenate([getattr(scan, name) for scan in scans]) for name in fields]
    return RadarScan(time, *values)


def _split(rng: np.random.Generator, log: Log) -> Sensors:
    def halves(scans: list[RadarScan], at: Mounting) -> list[RadarScan]:
        return [
            replace(scan[part], time=scan.time + 1e-3 * i)
            for scan in scans
            for i, part in enumerate((scan.azimuth < 0.0, scan.azimuth >= 0.0))
        ]

    return _changed(log, halves)


def _over_ground(rng: np.random.Generator, log: Log) -> Sensors:
    def fixed(scans: list[RadarScan], at: Mounting) -> list[RadarScan]:
        motion = log.truth.at([scan.time for scan in scans]).theta
        return over_ground_undone(scans, -motion, at)

    return _changed(log, fixed)


def _intensities(rng: np.random.Generator, log: Log) -> Sensors:
    return _scans(lambda s: replace(s, doppler=rng.uniform(5.0, 30.0, s.size)))(rng, log)


def _folded(limit: float) -> Put:
    return _field("doppler", lambda v: (v + limit) % (2.0 * limit) - limit)


def _distorted(scan: RadarScan) -> RadarScan:
    return replace(scan, doppler=scan.doppler + 0.3 * np.clip(scan.azimuth / 0.2 - 1.0, 0.0, 1.0))


def _exchanged(rng: np.random.Generator, log: Log) -> Sensors:
    (first, (scans, at)), (second, (others, beside)), *rest = log.sensors.items()
    return {first: (scans, beside), second: (others, at), **dict(rest)}


SEVERAL = (2, 3, 4, 5)
# Beside the limits of 2 and 5 m/s at which Doppler velocities fold.
FAST = ("car", "train", "truck", "tunnel", "standing in traffic")
FAULTS = {
    "nothing": Fault(lambda rng, log: log.sensors, (), (1, *SEVERAL)),
    "times in ms": Fault(_field("time", lambda v: 1e3 * v), ("times in another unit than s",)),
    "clock restarts": Fault(_field("time", lambda v: v % 9.3), ("the clock jumps",)),
    "clock wraps": Fault(_field("time", lambda v: v % 4.29), ("the clock jumps",)),
    "two stamps 1 ms apart": Fault(_split, ("several time stamps in a scan",)),
    "times in whole seconds": Fault(
        _regrouped(lambda s: float(np.round(s.time))), ("times are rounded",)
    ),
    "Doppler sign": Fault(_field("doppler", lambda v: -v), ("the path runs backwards",)),
    "Doppler in km/h": Fault(_field("doppler", lambda v: 3.6 * v), ("Doppler velocities in km/h",)),
    "Doppler over ground": Fault(_over_ground, ("the vehicle hardly moves",)),
    "Doppler zero": Fault(_field("doppler", lambda v: 0.0 * v), ("the vehicle hardly moves",)),
    "Doppler is an intensity": Fault(_intensities, ("Doppler velocities show another motion",)),
    "folded at 1.9 m/s": Fault(_folded(1.93), ("Doppler velocities are folded",), vehicles=FAST),
    "folded at 5 m/s": Fault(_folded(5.0), ("Doppler velocities are folded",), vehicles=FAST),
    "radians as degrees": Fault(
        _field("azimuth", np.deg2rad), ("azimuths in radians, read as degrees",)
    ),
    "azimuths clockwise": Fault(
        _field("azimuth", lambda v: -v),
        ("azimuths count clockwise", "sensors are swapped"),
        SEVERAL,
    ),
    "x and y swapped": Fault(
        _field("azimuth", lambda v: 0.5 * np.pi - v),
        ("x and y are swapped", "a mounting is turned"),
    ),
    "mounting 4 deg off": Fault(_turned(4.0), ("a mounting is turned",)),
    "mounting 20 deg off": Fault(_turned(20.0), ("a mounting is turned",)),
    "mounting 90 deg off": Fault(_turned(90.0), ("a mounting is turned", "x and y are swapped")),
    "yaw in radians": Fault(
        _places(lambda at: replace(at, yaw=np.deg2rad(at.yaw))),
        ("yaw of the mountings in radians", "a mounting is turned"),
        SEVERAL,
    ),
    "sensors exchanged": Fault(
        _exchanged,
        ("sensors are swapped", "a mounting is turned", "azimuths count clockwise"),
        SEVERAL,
    ),
    "clock 0.3 s late": Fault(_late(0.3), ("the clock of a sensor is off",), SEVERAL),
    "clock 3 s late": Fault(_late(3.0), ("the clock of a sensor is off",), SEVERAL),
    "clock 8 s late": Fault(_late(8.0), ("the clock of a sensor is off",), SEVERAL),
    "azimuths distorted": Fault(
        _scans(_distorted), ("Doppler velocities are distorted at some azimuths",)
    ),
    "sigma in degrees": Fault(
        _field("sigma_azimuth", np.deg2rad), ("standard deviation of the azimuth too small",)
    ),
    "ranges in feet": Fault(_field("range", lambda v: v / 0.3048), ("ranges in feet",)),
}
