"""A simulated drive with a Doppler radar, which anyone can reproduce."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from d2d import rigid
from d2d._checks import (
    ANGLE,
    FINITE,
    NOT_NEGATIVE,
    POSITIVE,
    Bounded,
    Bounds,
    check_count,
    check_instance,
    number,
)
from d2d._types import Array
from d2d.radar.scans.reference import Reference
from d2d.radar.scans.scan import Mounting, RadarScan, doppler_gradients
from d2d.radar.simulation.world import World, build_world, lap_motion, visible

# The thesis's robot, and a car in town, which is driven hard.  Only at the speed of a road does it
# accelerate as recorded cars do.
ROBOT_SPEED, ROBOT_MOUNTING = 2.5, Mounting(0.4, 0.0, 0.0)
CAR_SPEED, CAR_MOUNTING = 8.0, Mounting(3.6, 0.0, 0.0)
ROAD_SPEED = 4.0

# Quantisation steps of what the sensor reports, from the public driver of the thesis's group
# (ros_radar), and the maximum of a standard deviation in steps, which has six bits.
STEPS = np.array([[0.0625], [0.0002], [0.0625]])  # of range (m), azimuth (rad), Doppler (m/s)
SIGMA_STEPS = np.array([[0.0625], [0.001], [0.0625]])
MAX_STEPS = 63

_MAX_CLUTTER_DOPPLER = 10.0  # m/s
_TARGET = np.dtype(
    [("kind", "U10"), ("point", "i8"), ("range", "f8"), ("azimuth", "f8"), ("doppler", "f8")]
)
_RIDGE = 1e-9  # relative variance that keeps points at the same place from a singular covariance


@dataclass(frozen=True)
class Sensor(Bounded):
    """A 77 GHz radar; the defaults are those of the thesis (sec. 7.2) as far as it gives them.

    It takes ``rate`` scans per second of the ``max_targets`` strongest detections within
    ``field_of_view`` (rad) to either side, and between ``min_range`` and ``max_range`` (m).  The
    power received of a reflection point is its strength divided by range⁴, times an exponential
    variate drawn anew for every scan (Swerling case 1).  A point of strength 1 exceeds the
    threshold of detection at ``half_range`` (m) every other time.  The standard deviations
    ``sigma_range``, ``sigma_azimuth`` and ``sigma_doppler`` (m, rad, m/s) are those of a strong
    target; at the threshold they are twice as large.  ``clutter`` is the mean number of false
    detections in a scan.  If ``quantised``, what is reported is rounded to the sensor's steps.
    """

    rate: float = number(10.0, POSITIVE)
    max_targets: int = 48
    field_of_view: float = number(float(np.deg2rad(40.0)), ANGLE._replace(above=0.0, most=np.pi))
    min_range: float = number(1.0, POSITIVE)
    max_range: float = number(50.0, POSITIVE)
    half_range: float = number(25.0, POSITIVE)
    sigma_range: float = number(0.1, POSITIVE)
    sigma_azimuth: float = number(0.009, POSITIVE)
    sigma_doppler: float = number(0.06, POSITIVE)
    clutter: float = number(2.0, NOT_NEGATIVE)
    quantised: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        check_count("max_targets", self.max_targets)
        if self.max_range <= self.min_range:
            raise ValueError(f"max_range must exceed min_range, but is {self.max_range:g}")


@dataclass(frozen=True)
class SensorErrors(Bounded):
    """Errors that the targets of a simulated scan share, and scatter of the reflection points.

    All are constant over a drive.  To all azimuths, ``azimuth`` (rad) is added, and to all Doppler
    velocities ``doppler`` (m/s), after their relative error ``scale``.  A scan shows the world as
    it was ``lag`` (s) before its time stamp.  Targets scatter about their reflection points by the
    standard deviation ``extent`` (m) along each axis, anew in each scan, correlated as
    exp(-distance / ``neighbours``) (m).  A quantised sensor's steps are ``rounding`` times its own.
    """

    azimuth: float = number(0.0, ANGLE)
    doppler: float = number(0.0)
    scale: float = number(0.0, Bounds(above=-1.0))
    lag: float = number(0.0)
    extent: float = number(0.0, NOT_NEGATIVE)
    neighbours: float = number(0.0, NOT_NEGATIVE)
    rounding: float = number(1.0, POSITIVE)

    def moved(self, rng: np.random.Generator, points: Array) -> Array:
        """The places (n, 2) in m at which points (n, 2) are seen in one scan."""
        shift = rng.standard_normal(points.shape)
        if self.neighbours:
            distance = np.linalg.norm(points[:, None] - points, axis=-1)
            correlation = np.exp(-distance / self.neighbours)
            shift = np.linalg.cholesky(correlation + _RIDGE * np.eye(len(points))) @ shift
        return points + self.extent * shift


@dataclass(frozen=True, eq=False)
class Drive:
    """A simulated drive: scans, the true motion at their times, and the truth behind each scan.

    The ``targets`` of a scan, a record each, have a ``kind``, one of `KINDS`, and the ``point`` of
    the world, those of movers last; ``range``, ``azimuth`` and ``doppler`` in m, rad, m/s are
    without the sensor's errors.  Clutter has the point -1 and nan.
    """

    scans: list[RadarScan]
    mounting: Mounting
    truth: Reference
    targets: list["np.recarray[Any, Any]"]
    world: World


def simulate_drive(
    rng: np.random.Generator,
    duration: float = 120.0,
    speed: float = ROBOT_SPEED,
    *,
    start: float = 0.0,
    mounting: Mounting = ROBOT_MOUNTING,
    sensor: Sensor | None = None,
    world: World | None = None,
    errors: SensorErrors | None = None,
) -> Drive:
    """Drive around a block of houses with a radar.

    A lap is 300 m long; at the default mean ``speed`` (m/s), a robot's, it takes 120 s.  For a car
    in town, use `CAR_SPEED` and `CAR_MOUNTING` of ``d2d.radar.simulation.drive``.  The vehicle
    drives without side slip, slows down in bends, and has driven for ``start`` seconds at time 0.
    By default, `build_world` draws the world.  Without a lag, the ``errors`` change neither what is
    detected nor the targets' own noise.
    """
    check_instance("rng", rng, np.random.Generator)
    duration, speed = POSITIVE.number("duration", duration), POSITIVE.number("speed", speed)
    check_instance("mounting", mounting, Mounting)
    check_instance("sensor", sensor, Sensor, optional=True)
    check_instance("world", world, World, optional=True)
    check_instance("errors", errors, SensorErrors, optional=True)
    motion = partial(lap_motion, start=FINITE.number("start", start), speed=speed)
    sensor, world = sensor or Sensor(), world or build_world(rng)
    times = np.arange(int(np.floor(duration * sensor.rate + 1e-9)) + 1) / sensor.rate
    return drive_along(rng, motion, times, mounting, sensor, world, errors or SensorErrors())


def drive_along(
    rng: np.random.Generator,
    motion: Callable[[Array], Reference],
    times: Array,
    mounting: Mounting,
    sensor: Sensor,
    world: World,
    errors: SensorErrors,
) -> Drive:
    """Take scans at ``times`` (n,) in s from a vehicle with a given ``motion`` at any times."""
    seen = motion(times - errors.lag)
    shifts = rng.spawn(1)[0] if errors.extent else None  # leaves the other streams alone
    # the movers' reflection points come last, and clutter has the index -1
    moving = world.movers.strength
    strength = np.concatenate([world.strength, moving])
    kind = np.concatenate([world.kind, np.full(len(moving), "moving"), ["clutter"]])
    ends, count = world.walls.reshape(-1, 2), len(world.points)
    back = rigid.inverse(rigid.compose(seen.poses, mounting.pose))
    turns = np.swapaxes(rigid.rotation(back[:, 2]), -1, -2)
    places, velocities = world.movers.at(seen.times)
    scans, targets = [], []
    for i, turn in enumerate(turns):  # in the sensor frame
        points = np.concatenate([world.points, places[i]]) @ turn + back[i, :2]
        walls = (ends @ turn + back[i, :2]).reshape(-1, 2, 2)
        point, power = _detected(rng, points, strength, walls, sensor)
        at = points[point] if shifts is None else errors.moved(shifts, points[point])
        distance, azimuth = np.hypot(*at.T), np.arctan2(at[:, 1], at[:, 0])
        doppler = np.einsum("kp,p->k", doppler_gradients(azimuth, mounting)[0], seen.theta[i])
        moves = point >= count
        over_ground = velocities[i][point[moves] - count] @ turn
        doppler[moves] += (over_ground * (at[moves] / distance[moves, None])).sum(axis=1)
        true = np.column_stack([np.stack([distance, azimuth, doppler]), np.full(3, np.nan)])
        scan, which = _measured(rng, float(times[i]), true, power, sensor, errors)
        point = np.append(point, -1)[which]
        scans.append(scan)
        targets.append(np.rec.fromarrays([kind[point], point, *true[:, which]], _TARGET))
    return Drive(scans, mounting, motion(times), targets, world)


def _detected(
    rng: np.random.Generator, points: Array, strength: Array, walls: Array, sensor: Sensor
) -> tuple[NDArray[np.int_], Array]:
    """The points (n, 2) that are detected, and their power relative to the threshold."""
    distance = np.hypot(*points.T)
    point = np.flatnonzero((distance > sensor.min_range) & (distance < sensor.max_range))
    azimuth = np.arctan2(points[point, 1], points[point, 0])
    point = point[np.abs(azimuth) < sensor.field_of_view]
    mean = strength[point] * (sensor.half_range / distance[point]) ** 4 / np.log(2.0)
    power = mean * rng.exponential(size=len(point))
    point, power = point[power > 1.0], power[power > 1.0]
    seen = visible(points[point], walls)
    return point[seen], power[seen]


def _measured(
    rng: np.random.Generator,
    time: float,
    true: Array,
    power: Array,
    sensor: Sensor,
    errors: SensorErrors,
) -> tuple[RadarScan, NDArray[np.int_]]:
    """A scan, strongest target first, and the column of each target in ``true`` (3, n + 1).

    The last column stands for clutter; targets of which the measured range is not positive go.
    """
    # noise that exceeds the threshold exceeds it only slightly
    power = np.append(power, 1.0 + rng.exponential(size=rng.poisson(sensor.clutter)))
    order = np.argsort(-power)[: sensor.max_targets]
    of_strong = sensor.sigma_range, sensor.sigma_azimuth, sensor.sigma_doppler
    sigma = np.outer(of_strong, np.sqrt(1.0 + 3.0 / power[order]))
    last = true.shape[1] - 1
    which = np.minimum(order, last)
    factor, shared = (1.0, 1.0, 1.0 + errors.scale), (0.0, errors.azimuth, errors.doppler)
    values = (true.T[which] * factor + shared).T
    values += sigma * rng.standard_normal(values.shape)
    low = np.array([sensor.min_range, -sensor.field_of_view, -_MAX_CLUTTER_DOPPLER])
    high = np.array([sensor.max_range, sensor.field_of_view, _MAX_CLUTTER_DOPPLER])
    values[:, which == last] = rng.uniform(low, high, ((which == last).sum(), 3)).T
    if sensor.quantised:
        steps = errors.rounding * STEPS
        values = np.round(values / steps) * steps
        sigma = np.clip(np.round(sigma / SIGMA_STEPS), 1, MAX_STEPS) * SIGMA_STEPS
    kept = values[0] > 0.0
    return RadarScan(time, *values[:, kept], *sigma[:, kept]), which[kept]
