"""A room with walls and corners, seen by a range scanner."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from d2d import rigid
from d2d._types import Array
from d2d.point_set import PointSet

Walls = Sequence[Array]
"""Closed loops of corners (C, 2) in m."""

# An L-shaped room of 10 m x 7 m with a pillar; the scanner starts at the origin. No wall lies on a
# multiple of half a metre, where the borders of NDT cells are.
ROOM: Walls = (
    np.array([[-4.2, -2.7], [5.8, -2.7], [5.8, 1.7], [2.3, 1.7], [2.3, 4.3], [-4.2, 4.3]]),
    np.array([[-2.4, 1.1], [-2.4, 1.9], [-1.6, 1.9], [-1.6, 1.1]]),
)
MOTION = np.array([0.5, 0.3, np.deg2rad(10.0)])  # m, m, rad: from the first scan to the second
RAYS = 180
SIGMA_RANGE = 0.03  # m
NEAREST = 0.3  # m: no point of a scan is nearer


def random_room(rng: np.random.Generator) -> Walls:
    """Another L-shaped room with a pillar, 7 to 11 m long and 6 to 8 m deep, around the origin."""
    left, right = -rng.uniform(3.0, 4.5), rng.uniform(4.0, 6.5)
    low, high = -rng.uniform(2.5, 3.5), rng.uniform(3.5, 4.5)
    notch = np.array([rng.uniform(2.0, right - 1.0), rng.uniform(1.0, high - 1.0)])
    corner = np.array([rng.uniform(left + 0.5, -1.8), rng.uniform(0.5, high - 1.8)])
    outline = [[left, low], [right, low], [right, notch[1]], notch, [notch[0], high], [left, high]]
    size = rng.uniform(0.4, 0.8, 2)
    pillar = corner + size * np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]])
    return np.array(outline), pillar


def segments(walls: Walls = ROOM) -> Array:
    """Start and end points (S, 2, 2) of all wall segments, in m."""
    return np.concatenate([np.stack([loop, np.roll(loop, -1, axis=0)], axis=1) for loop in walls])


def ray_ranges(pose: ArrayLike, azimuth: ArrayLike, walls: Walls = ROOM) -> Array:
    """Distance (A,) in m to the nearest wall along each azimuth (A,) in rad, seen from a pose (3,).

    Solves ``p + r u = a + s (b - a)``.  Raises a ``ValueError`` if a ray meets no wall.
    """
    scanner = rigid.motion("pose", pose, 2)
    direction = rigid.rotation(scanner[2] + np.asarray(azimuth))[:, :, 0]
    lines = segments(walls)
    along, offset = lines[:, 1] - lines[:, 0], lines[:, 0] - scanner[:2]
    cross = direction[:, None, 0] * along[:, 1] - direction[:, None, 1] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (offset[:, 0] * along[:, 1] - offset[:, 1] * along[:, 0]) / cross
        fraction = (
            offset[:, 0] * direction[:, None, 1] - offset[:, 1] * direction[:, None, 0]
        ) / cross
    # rounding must not let a ray slip through a corner, where two segments meet
    hit = (distance > 0) & (fraction >= -1e-9) & (fraction <= 1.0 + 1e-9)
    ranges = np.asarray(np.where(hit, distance, np.inf).min(axis=1))
    if not np.isfinite(ranges).all():
        raise ValueError(f"pose must lie inside the room, but is {scanner.tolist()}")
    return ranges


@dataclass(frozen=True, eq=False)
class RoomScan:
    """One scan of the room, in the scanner's own frame."""

    range: Array  # (N,) m
    azimuth: Array  # (N,) rad
    spacing: float  # rad, between neighbouring rays

    @property
    def points(self) -> Array:
        """Positions (N, 2) in m."""
        return self.range[:, None] * rigid.rotation(self.azimuth)[:, :, 0]

    def targets(self) -> PointSet:
        """Every point as a Gaussian target, as wide across as half the gap to the next ray."""
        return PointSet.from_polar(self.range, self.azimuth, SIGMA_RANGE, 0.5 * self.spacing)


def room_scan(
    rng: np.random.Generator,
    pose: ArrayLike = (0.0, 0.0, 0.0),
    *,
    walls: Walls = ROOM,
    field_of_view: float = 2.0 * np.pi,
    outliers: float = 0.0,
) -> RoomScan:
    """Cast equally spaced rays over the field of view, with Gaussian noise on the range.

    ``pose`` (3,), in m, m, rad, is that of the scanner, about whose x axis the ``field_of_view``
    (rad) lies.  A share ``outliers`` of the points lies uniformly in front of the wall.
    """
    spacing = field_of_view / RAYS
    azimuth = spacing * np.arange(RAYS, dtype=np.float64) - 0.5 * field_of_view
    wall = ray_ranges(pose, azimuth, walls)
    measured = np.maximum(wall + SIGMA_RANGE * rng.standard_normal(RAYS), NEAREST)
    outlier = np.zeros(RAYS, dtype=np.bool_)
    outlier[rng.permutation(RAYS)[: round(outliers * RAYS)]] = True
    stray = NEAREST + (np.maximum(wall, NEAREST) - NEAREST) * rng.random(RAYS)
    return RoomScan(np.where(outlier, stray, measured), azimuth, spacing)


def room_pair(
    rng: np.random.Generator, *, motion: ArrayLike = MOTION, **options: Any
) -> tuple[RoomScan, RoomScan]:
    """Scans before and after a motion (3,) in m, m, rad, which maps the second onto the first.

    The ``options`` are those of `room_scan`.
    """
    return room_scan(rng, **options), room_scan(rng, motion, **options)
