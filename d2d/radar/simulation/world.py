"""A street around a block: the path that a vehicle drives, and what a radar sees along it."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from d2d import rigid
from d2d._checks import check_instance
from d2d._types import Array
from d2d.radar.scans.reference import Reference

KINDS = ("wall", "car", "pole", "vegetation", "moving", "clutter")  # origins of a detection

LAP = 300.0  # m, length of a lap
_CORNER = 24.0  # m: length of a quarter turn, whose smallest radius is 7.6 m
_STEP = 0.05  # m, of the splines

# Offsets to the left of the path, in m.  Traffic drives on the right, so the kerb is to the right
# of the vehicle's lane and the oncoming lane to its left.
_CLEARANCE = 5.0  # minimum distance of a building from the whole path
_PARKED = (-2.7, 5.6)
_POLES = (-3.9, 6.8)
_BUSHES = (-5.2, 8.0)
_SIDEWALKS = (-4.6, 7.4)
_ONCOMING_LANE = 3.2

# Median strength of a reflection point and its spread in dB; see `World`.
_STRENGTH = {
    "wall": (1.0, 5.0),
    "car": (1.0, 5.0),
    "pole": (2.0, 3.0),
    "vegetation": (0.3, 4.0),
    "walker": (0.5, 3.0),
}


@dataclass(frozen=True, eq=False)
class Movers:
    """Reflection points on rigid bodies that follow the path beside the vehicle's own lane."""

    start: Array  # (m,), m along the path, of the body's frame at time 0
    speed: Array  # (m,), m/s along the path, negative if opposite to the vehicle's direction
    offset: Array  # (m, 2), m, of the point in that frame: x along the path, y to its left
    strength: Array  # (m,), as of a `World`

    def at(self, times: Array) -> tuple[Array, Array]:
        """Positions and velocities (..., m, 2) in m and m/s at times (...) in s."""
        along = self.start + np.asarray(times)[..., np.newaxis] * self.speed
        frame = lap_poses(along)
        turn = rigid.rotation(frame[..., 2])
        arm = (turn @ self.offset[..., np.newaxis])[..., 0]
        spin = self.speed * lap_curvature(along)
        left = np.stack([-arm[..., 1], arm[..., 0]], axis=-1)
        velocity = self.speed[..., np.newaxis] * turn[..., 0] + spin[..., np.newaxis] * left
        return frame[..., :2] + arm, velocity


NO_MOVERS = Movers(np.empty(0), np.empty(0), np.empty((0, 2)), np.empty(0))


@dataclass(frozen=True, eq=False)
class World:
    """Reflection points, which stand still or move, and outlines that block the view of them."""

    buildings: Array  # (n, 4, 2), corners in m, counter-clockwise
    cars: Array  # parked, likewise
    points: Array  # (n, 2), m, which stand still
    strength: Array  # (n,), of 1 for a point that half the scans detect at the sensor's half_range
    kind: NDArray[np.str_]  # (n,), "wall", "car", "pole" or "vegetation"
    movers: Movers = NO_MOVERS

    @property
    def walls(self) -> Array:
        """Start and end (S, 2, 2) in m of all wall segments, which block the view."""
        return _edges(np.concatenate([self.buildings, self.cars]))


def _edges(outlines: Array) -> Array:
    """Start and end (4 n, 2, 2) of the edges of outlines (n, 4, 2)."""
    return np.stack([outlines, np.roll(outlines, -1, axis=1)], axis=2).reshape(-1, 2, 2)


def open_field(points: Array, strength: ArrayLike) -> World:
    """A world of reflection points (n, 2) only, which nothing hides."""
    none, kind = np.empty((0, 4, 2)), np.full(len(points), "pole")
    return World(none, none, points, np.full(len(points), strength), kind)


def visible(points: Array, walls: Array) -> NDArray[np.bool_]:
    """Whether each point (K, 2) is visible from the origin, not hidden by a wall (S, 2, 2)."""
    # only a wall that comes into the rectangle around the origin and all points can hide one
    low, high = points.min(axis=0, initial=0.0), points.max(axis=0, initial=0.0)
    near = (walls.max(axis=1) >= low) & (walls.min(axis=1) <= high)
    start, end = np.swapaxes(walls[near.all(axis=1)], 0, 1)
    edge = end - start
    x, y = points[:, :1], points[:, 1:]
    # a ray crosses a wall if the ends of each lie on different sides of the other
    ends = [x * each[:, 1] - y * each[:, 0] for each in (start, end)]
    origin = edge[:, 1] * start[:, 0] - edge[:, 0] * start[:, 1]
    beyond = origin + y * edge[:, 0] - x * edge[:, 1]
    crossed = (ends[0] * ends[1] < 0) & (origin * beyond < 0)
    return np.asarray(~crossed.any(axis=1))


# The street runs counter-clockwise around an L-shaped block: five quarter turns to the left and one
# to the right.  The curvature of a turn is a squared sine along its length, so that the yaw rate is
# smooth; heading, position and velocity are derived from it.

_TURNS = np.array([1.0, 1.0, -1.0, 1.0, 1.0, 1.0])
_BLOCK = (35.0, 48.0, 35.0)  # m: the block's sides between its first four corners
_HEIGHT = 70.0  # m, of the whole block; its width follows from the length of the lap


def lap_poses(along: Array) -> Array:
    """Pose (..., 3) [x, y, yaw] in m, m, rad after ``along`` (...) metres; yaw is continuous."""
    laps, rest = np.divmod(along, LAP)
    place, heading, _ = _lap()
    yaw = heading(rest) + 2.0 * np.pi * laps
    return np.concatenate([place(rest), yaw[..., np.newaxis]], axis=-1)


def lap_curvature(along: Array) -> Array:
    """Curvature (...) in 1/m after ``along`` (...) metres, positive to the left."""
    return np.asarray(_lap()[1](np.mod(along, LAP), 1))


def lap_motion(times: Array, start: float, speed: float, size: float = 1.0) -> Reference:
    """The motion at ``times`` (n,) in s of a vehicle that has driven for ``start`` s at time 0.

    Its mean ``speed`` is in m/s, and less in bends; the lap is ``size`` times the street's.
    """
    position = _lap()[2]
    laps, rest = np.divmod((times + start) * speed / size, LAP)
    along, forward = position(rest) + LAP * laps, speed * position(rest, 1)
    turned = forward * lap_curvature(along) / size
    theta = np.stack([forward, np.zeros_like(forward), turned], axis=-1)
    return Reference(times, theta, lap_poses(along) * [size, size, 1.0])


@cache
def _lap() -> "tuple[scipy.interpolate.CubicHermiteSpline, ...]":
    """Splines of position and heading over the distance (m), and of it over time times speed."""
    spline = scipy.interpolate.CubicHermiteSpline
    # a quarter turn moves the path as far sideways as ahead
    fine = np.linspace(0.0, _CORNER, 2001)
    extent = scipy.integrate.simpson(np.cos(_bends(fine, np.zeros(1))[1][:, 0]), x=fine)
    shortcut = 2.0 * extent - _CORNER  # saved by rounding a corner of the block
    width = 0.5 * (LAP + len(_TURNS) * shortcut) - _HEIGHT
    sides = np.array([*_BLOCK, width - _BLOCK[1], _HEIGHT])
    starts = 0.5 * width - extent + np.cumsum([0.0, *(sides - shortcut)])  # of the corners
    grid = np.linspace(0.0, LAP, round(LAP / _STEP) + 1)
    curvature, turned = _bends(grid, starts)
    heading = spline(grid, turned @ _TURNS, curvature @ _TURNS)
    # Simpson's rule over each step
    direction, middle = (
        np.column_stack([np.cos(yaw), np.sin(yaw)])
        for yaw in (heading(grid), heading(grid[1:] - 0.5 * _STEP))
    )
    steps = _STEP * (direction[:-1] + 4.0 * middle + direction[1:]) / 6.0
    place = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    # time per metre is 1 + |curvature| / tightest, relative to the straight
    tightest = np.pi / _CORNER
    time = grid + turned.sum(axis=1) / tightest
    pace = 1.0 / (1.0 + curvature.sum(axis=1) / tightest)
    stretch = LAP / time[-1]
    progress = spline(time * stretch, grid, pace / stretch)
    return spline(grid, place, direction), heading, progress


def _bends(along: Array, starts: Array) -> tuple[Array, Array]:
    """Unsigned curvature and angle turned (n, C) of each corner after ``along`` (n,) metres."""
    share = np.clip((along[:, None] - starts) / _CORNER, 0.0, 1.0)
    curvature = np.pi / _CORNER * np.sin(np.pi * share) ** 2
    return curvature, 0.5 * np.pi * (share - np.sin(2.0 * np.pi * share) / (2.0 * np.pi))


def build_world(rng: np.random.Generator, movers: int = 6) -> World:
    """Line the street with houses, parked cars, poles, bushes and ``movers``, cars and walkers."""
    check_instance("rng", rng, np.random.Generator)
    buildings, cars = _buildings(rng), _parked_cars(rng)
    places = {
        "wall": _along_outlines(rng, buildings, 0.7, (0.02, 0.25)),
        "car": _along_outlines(rng, cars, 1.2, (0.01, 0.03)),
        "pole": _beside(rng, 25.0, _POLES),
        "vegetation": _bushes(rng),
    }
    counts = {kind: len(at) for kind, at in places.items()}
    strength = np.concatenate([_strengths(rng, *each) for each in counts.items()])
    points, kinds = np.concatenate(list(places.values())), np.repeat([*counts], [*counts.values()])
    return World(buildings, cars, points, strength, kinds, _movers(rng, movers))


def _strengths(rng: np.random.Generator, kind: str, count: int) -> Array:
    median, spread = _STRENGTH[kind]
    return np.asarray(median * 10.0 ** (0.1 * spread * rng.standard_normal(count)))


def _outline(frames: Array, sizes: Array) -> Array:
    """Corners (n, 4, 2) of rectangles centred at frames (n, 3), of sizes (n, 2) along x and y."""
    unit = 0.5 * np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    return rigid.transform_means(frames, unit * sizes[:, None])


def _offset(along: Array, aside: Array) -> Array:
    """Frames (n, 3) parallel to the path, ``aside`` metres to its left."""
    return rigid.compose(lap_poses(along), np.stack([0.0 * along, aside, 0.0 * along], axis=-1))


def _buildings(rng: np.random.Generator) -> Array:
    """Rows of houses, 8 m deep, along both sides of the street, none too near to another part."""
    rows = []
    for side, setbacks in ((-1.0, (6.0, 9.0)), (1.0, (9.0, 11.0))):
        along = 0.0
        while along < LAP:
            length, gap = rng.uniform(10.0, 25.0), rng.uniform(2.0, 8.0)
            aside = side * (rng.uniform(*setbacks) + 4.0)
            rows.append((along + 0.5 * length, aside, length, 8.0))
            along += length + gap
    table = np.array(rows)
    frames, sizes = _offset(table[:, 0], table[:, 1]), table[:, 2:]
    street = lap_poses(np.arange(0.0, LAP, 0.5))[:, :2]
    beside = np.abs(rigid.transform_means(rigid.inverse(frames), street))
    gaps = np.linalg.norm(np.maximum(beside - 0.5 * sizes[:, None], 0.0), axis=-1).min(axis=1)
    return _outline(frames[gaps > _CLEARANCE], sizes[gaps > _CLEARANCE])


def _parked_cars(rng: np.random.Generator) -> Array:
    """Outlines of cars, 4.4 m by 1.8 m, parked along the straight parts of the street."""
    slots = np.arange(0.0, LAP, 6.0)
    slots = slots[np.abs(lap_curvature(slots)) < 1e-3]
    side, slot = np.nonzero(rng.random((len(_PARKED), len(slots))) < 0.35)
    frames = _offset(slots[slot], np.array(_PARKED)[side])
    return _outline(frames, np.tile([4.4, 1.8], (len(frames), 1)))


def _along_outlines(
    rng: np.random.Generator, outlines: Array, spacing: float, depth: tuple[float, float]
) -> Array:
    """Random points along outlines, such as sills and handles, ``depth`` (m) in front of them."""
    edges = _edges(outlines)
    along = edges[:, 1] - edges[:, 0]
    length = np.linalg.norm(along, axis=-1)
    which = np.repeat(np.arange(len(edges)), rng.poisson(length / spacing))
    share, out = rng.random(len(which)), rng.uniform(*depth, len(which))
    tangent = along[which] / length[which, None]
    outward = np.stack([tangent[:, 1], -tangent[:, 0]], axis=-1)
    return np.asarray(edges[which, 0] + share[:, None] * along[which] + out[:, None] * outward)


def _beside(rng: np.random.Generator, spacing: float, sides: tuple[float, float]) -> Array:
    """Random points (n, 2) on both sides of the path, ``spacing`` metres apart on average."""
    aside = np.repeat(sides, rng.poisson(LAP / spacing, 2))
    return _offset(rng.uniform(0.0, LAP, len(aside)), aside)[:, :2]


def _bushes(rng: np.random.Generator) -> Array:
    """Leaves (n, 2), about twelve to a bush, scattered by 0.35 m."""
    middles = _beside(rng, 10.0, _BUSHES)
    leaves = np.repeat(middles, rng.poisson(12.0, len(middles)), axis=0)
    return np.asarray(leaves + 0.35 * rng.standard_normal(leaves.shape))


def _movers(rng: np.random.Generator, count: int) -> Movers:
    """Cars with six reflection points each and walkers with two."""
    rows = []
    for k in range(count):
        start, direction = rng.uniform(0.0, LAP), rng.choice([-1.0, 1.0])
        if k % 2 == 0:
            kind, points, size = "car", 6, (2.1, 0.8)
            speed, middle = rng.uniform(5.0, 9.0), _ONCOMING_LANE
        else:
            kind, points, size = "walker", 2, (0.2, 0.2)
            speed, middle = rng.uniform(1.0, 2.0), rng.choice(_SIDEWALKS)
        offset = rng.uniform(-1.0, 1.0, (points, 2)) * size + [0.0, middle]
        strength = _strengths(rng, kind, points)
        rows += [(start, direction * speed, *q, s) for q, s in zip(offset, strength, strict=True)]
    table = np.array(rows).reshape(-1, 5)
    return Movers(table[:, 0], table[:, 1], table[:, 2:4], table[:, 4])
