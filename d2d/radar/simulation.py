"""A drive with a Doppler radar that anyone can recompute."""

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from d2d import rigid
from d2d._checks import Array, count, flag, instance, positive, scalar
from d2d.radar.reference import Reference
from d2d.radar.scan import Mounting, RadarScan, doppler_velocity
from d2d.radar.world import (
    World,
    build_world,
    lap_curvature,
    lap_poses,
    lap_progress,
    visible,
)

# The vehicles: the thesis's robot, and a car in town.
ROBOT_SPEED, ROBOT_MOUNTING = 2.5, Mounting(0.4, 0.0, 0.0)
CAR_SPEED, CAR_MOUNTING = 8.0, Mounting(3.6, 0.0, 0.0)

# Steps of what the sensor reports, after the public driver of the thesis's group (ros_radar), and
# the largest number of steps of a standard deviation, of six bits.
STEPS = np.array([[0.0625], [0.0002], [0.0625]])  # of range (m), azimuth (rad), Doppler (m/s)
SIGMA_STEPS = np.array([[0.0625], [0.001], [0.0625]])
MOST_STEPS = 63

_FASTEST_CLUTTER = 10.0  # m/s


@dataclass(frozen=True)
class Sensor:
    """A 77 GHz radar; the defaults are the thesis's (its sec. 7.2) as far as it gives them.

    The received power of a reflection point is its strength over range^4, times an exponential
    variate drawn afresh in every scan (Swerling's case 1).  What exceeds a threshold is detected.

    Attributes
    ----------
    rate : float, Hz
        Scans a second.
    most_targets : int
        Of one scan; of more detections the strongest are kept.
    field_of_view : float, rad
        To either side.
    shortest, longest : float, m
        Limits of the range.
    half_range : float, m
        Where a point of strength 1 is detected every other time.
    sigma_range, sigma_azimuth, sigma_doppler : float, m, rad, m/s
        Standard deviations of a strong target's errors; twice as large at the threshold.
    clutter : float
        Mean number of false detections in a scan, anywhere in view, of any Doppler velocity up to
        10 m/s.
    quantised : bool
        Whether measurements and reported standard deviations are rounded to the sensor's steps.

    Raises
    ------
    ValueError
        Naming the attribute that is out of range.
    """

    rate: float = 10.0
    most_targets: int = 48
    field_of_view: float = float(np.deg2rad(40.0))
    shortest: float = 1.0
    longest: float = 50.0
    half_range: float = 25.0
    sigma_range: float = 0.1
    sigma_azimuth: float = 0.009
    sigma_doppler: float = 0.06
    clutter: float = 2.0
    quantised: bool = True

    def __post_init__(self) -> None:
        count("most_targets", self.most_targets)
        flag("quantised", self.quantised)
        for field in fields(self):
            if field.type is float and field.name != "clutter":
                positive(field.name, scalar(field.name, getattr(self, field.name)))
        if scalar("clutter", self.clutter) < 0.0:
            raise ValueError(f"clutter must not be negative, but is {self.clutter:g}")
        if self.field_of_view > np.pi:
            raise ValueError(f"field_of_view must be at most pi, but is {self.field_of_view:g}")
        if self.longest <= self.shortest:
            raise ValueError(f"longest must exceed shortest, but is {self.longest:g}")


@dataclass(frozen=True, eq=False)
class TrueTargets:
    """What the targets of one scan really are.

    Attributes
    ----------
    kind : (K,) array of str
        Of `d2d.radar.world.KINDS`.
    point : (K,) array of int
        Number of the reflection point in the world, movers' after those that stand still; -1 for
        clutter.
    range, azimuth, doppler : (K,) arrays, m, rad, m/s
        Without the sensor's errors; nan for clutter.
    """

    kind: NDArray[np.str_]
    point: NDArray[np.int_]
    range: Array
    azimuth: Array
    doppler: Array

    def __getitem__(self, index: slice | NDArray[np.bool_] | NDArray[np.int_]) -> "TrueTargets":
        """Only some of the targets, by a slice, a mask or a list of indices.

        Raises ``IndexError`` for an index that does not fit the targets.
        """
        return TrueTargets(*(getattr(self, field.name)[index] for field in fields(self)))

    __iter__ = None  # or Python would try the indices 0, 1, ... until the IndexError


@dataclass(frozen=True, eq=False)
class Drive:
    """A simulated drive.

    Attributes
    ----------
    scans : list of RadarScan
    mounting : Mounting
    truth : Reference
        At the times of the scans.
    targets : list of TrueTargets
        One for each scan.
    world : World
    """

    scans: list[RadarScan]
    mounting: Mounting
    truth: Reference
    targets: list[TrueTargets]
    world: World


def simulate_drive(
    rng: np.random.Generator,
    duration: float = 120.0,
    speed: float = ROBOT_SPEED,
    *,
    mounting: Mounting = ROBOT_MOUNTING,
    sensor: Sensor | None = None,
    world: World | None = None,
) -> Drive:
    """Drive around a block of houses with a radar.

    A lap is 300 m, however long the drive takes: at the default speed it closes after 120 s.  The
    vehicle drives without side slip and slows down in bends.

    Parameters
    ----------
    rng : numpy.random.Generator
    duration : float, s
    speed : float, m/s
        Mean over a lap.  The default is a robot's; `CAR_SPEED` with `CAR_MOUNTING` is a car in
        town.
    mounting : Mounting
        Of the sensor in the vehicle frame.
    sensor : Sensor, optional
        The thesis's unless given.
    world : World, optional
        Drawn by `d2d.radar.world.build_world` unless given.

    Returns
    -------
    Drive

    Raises
    ------
    ValueError
        Naming the argument that is not positive or of another type.
    """
    instance("rng", rng, np.random.Generator)
    duration = float(positive("duration", scalar("duration", duration)))
    speed = float(positive("speed", scalar("speed", speed)))
    instance("mounting", mounting, Mounting)
    sensor = Sensor() if sensor is None else sensor
    instance("sensor", sensor, Sensor)
    world = build_world(rng) if world is None else world
    instance("world", world, World)
    times = np.arange(int(np.floor(duration * sensor.rate + 1e-9)) + 1) / sensor.rate
    along, forward = lap_progress(times, speed)
    turning = forward * lap_curvature(along)
    theta = np.stack([forward, np.zeros_like(forward), turning], axis=-1)
    truth = Reference(times, theta, lap_poses(along))
    places, velocities = world.movers.at(times)
    scans, targets = [], []
    for i, time in enumerate(times):
        scene = _Scene.seen_from(truth.poses[i], mounting, world, places[i], velocities[i])
        true, power = _detections(rng, scene, truth.theta[i], mounting, sensor)
        scan, kept = _measured(rng, float(time), true, power, sensor)
        scans.append(scan)
        targets.append(kept)
    return Drive(scans, mounting, truth, targets, world)


class _Scene(NamedTuple):
    """The world in the sensor's frame at one instant: all reflection points, the movers' last."""

    points: Array  # (n, 2)
    velocities: Array  # (n, 2), over ground
    strength: Array  # (n,)
    kind: NDArray[np.str_]  # (n,)
    walls: Array  # (S, 2, 2)

    @classmethod
    def seen_from(
        cls, pose: Array, mounting: Mounting, world: World, places: Array, velocities: Array
    ) -> "_Scene":
        """Movers are at ``places`` with ``velocities``, (m, 2) each."""
        back = rigid.inverse(rigid.compose(pose, mounting.pose))
        still, moving = world.reflectors, world.movers
        points = np.concatenate([still.positions, places])
        over_ground = np.concatenate([np.zeros_like(still.positions), velocities])
        return cls(
            rigid.transform_means(back, points),
            over_ground @ rigid.rotation(back[2]).T,
            np.concatenate([still.strength, moving.strength]),
            np.concatenate([still.kind, np.full(len(moving.strength), "moving")]),
            rigid.transform_means(back, world.walls.reshape(-1, 2)).reshape(-1, 2, 2),
        )


def _detections(
    rng: np.random.Generator, scene: _Scene, theta: Array, mounting: Mounting, sensor: Sensor
) -> tuple[TrueTargets, Array]:
    """What exceeds the threshold, and its power relative to that, the strongest first."""
    distance = np.hypot(*scene.points.T)
    azimuth = np.arctan2(scene.points[:, 1], scene.points[:, 0])
    inside = (distance > sensor.shortest) & (distance < sensor.longest)
    point = np.flatnonzero(inside & (np.abs(azimuth) < sensor.field_of_view))
    mean = scene.strength[point] * (sensor.half_range / distance[point]) ** 4 / np.log(2.0)
    power = mean * rng.exponential(size=len(point))
    point, power = point[power > 1.0], power[power > 1.0]
    seen = visible(scene.points[point], scene.walls)
    point, power = point[seen], power[seen]
    sight = scene.points[point] / distance[point, None]
    away = (scene.velocities[point] * sight).sum(axis=1)
    false = rng.poisson(sensor.clutter)
    unknown = np.full(false, np.nan)
    true = TrueTargets(
        np.concatenate([scene.kind[point], np.full(false, "clutter")]),
        np.concatenate([point, np.full(false, -1)]),
        np.concatenate([distance[point], unknown]),
        np.concatenate([azimuth[point], unknown]),
        np.concatenate([doppler_velocity(theta, azimuth[point], mounting) + away, unknown]),
    )
    # noise that exceeds the threshold does so by little
    power = np.concatenate([power, 1.0 + rng.exponential(size=false)])
    order = np.argsort(-power)[: sensor.most_targets]
    return true[order], power[order]


def _measured(
    rng: np.random.Generator, time: float, true: TrueTargets, power: Array, sensor: Sensor
) -> tuple[RadarScan, TrueTargets]:
    """The scan with its errors, and what its targets are.

    A near target whose range comes out at zero or below is not reported.
    """
    worse = np.sqrt(1.0 + 3.0 / power)
    sigma = np.array([[sensor.sigma_range], [sensor.sigma_azimuth], [sensor.sigma_doppler]]) * worse
    values = np.stack([true.range, true.azimuth, true.doppler])
    values += sigma * rng.standard_normal(values.shape)
    clutter = true.kind == "clutter"
    low = np.array([sensor.shortest, -sensor.field_of_view, -_FASTEST_CLUTTER])
    high = np.array([sensor.longest, sensor.field_of_view, _FASTEST_CLUTTER])
    values[:, clutter] = rng.uniform(low, high, (clutter.sum(), 3)).T
    if sensor.quantised:
        values = np.round(values / STEPS) * STEPS
        sigma = np.clip(np.round(sigma / SIGMA_STEPS), 1, MOST_STEPS) * SIGMA_STEPS
    kept = values[0] > 0.0
    return RadarScan(time, *values[:, kept], *sigma[:, kept]), true[kept]
