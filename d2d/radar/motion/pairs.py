"""Pairs of scans of one sensor, and the cost of the velocity that they share."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from d2d import rigid
from d2d._checks import check_instance, check_members
from d2d._types import Array
from d2d.point_set import PointSet
from d2d.problem import Pair, Problem
from d2d.radar.motion.model import EgoMotionModel
from d2d.radar.scans.scan import Mounting, RadarScan, level

_FIELDS: dict[str, type] = {"previous": RadarScan, "current": RadarScan, "mounting": Mounting}


class ScanPair(NamedTuple):
    """An earlier and a later scan of one sensor, with its mounting."""

    previous: RadarScan
    current: RadarScan
    mounting: Mounting

    @property
    def interval(self) -> float:
        """The time from the earlier scan to the later one, in s."""
        return self.current.time - self.previous.time

    @property
    def middle(self) -> float:
        """The time in the middle between the two, in s."""
        return self.current.time - 0.5 * self.interval


def scan_pairs(
    previous: RadarScan | Iterable[RadarScan],
    current: RadarScan | Iterable[RadarScan],
    mounting: Mounting | Iterable[Mounting],
) -> list[ScanPair]:
    """The pairs of scans that a caller gives, checked: one, or several as three sequences.

    Raises a ``ValueError`` if an argument has the wrong type, the sequences are empty or differ in
    length, a pair is out of time order or a scan has no targets, also once it is levelled.
    """
    given: dict[str, Any] = {"previous": previous, "current": current, "mounting": mounting}
    alone = isinstance(previous, RadarScan) or isinstance(current, RadarScan)
    if alone:
        for name, value in given.items():
            check_instance(name, value, _FIELDS[name])
        given = {name: [value] for name, value in given.items()}
    columns = [check_members(name, value, _FIELDS[name]) for name, value in given.items()]
    lengths = [len(column) for column in columns]
    if len(set(lengths)) > 1:
        raise ValueError(
            "previous, current and mounting must have the same length, but have "
            f"{lengths[0]}, {lengths[1]} and {lengths[2]}"
        )
    if not lengths[0]:
        raise ValueError("previous must hold at least one scan, but is empty")
    pairs = []
    for number, (earlier, later, at) in enumerate(zip(*columns, strict=True)):
        place = "" if alone else f"[{number}]"
        if not later.time > earlier.time:
            raise ValueError(
                f"current{place} must be later than previous{place}, but is at "
                f"{later.time:.6f} s after {earlier.time:.6f} s"
            )
        (earlier, flat), (later, _) = level(earlier, at), level(later, at)
        for name, scan in (("previous", earlier), ("current", later)):
            if not scan.size:
                raise ValueError(f"{name}{place} holds no targets")
        pairs.append(ScanPair(earlier, later, flat))
    return pairs


def middle_of(pairs: Sequence[ScanPair]) -> float:
    """The mean of the middles of all pairs' intervals, in s."""
    return sum(pair.middle for pair in pairs) / len(pairs)


def problem_of(
    pairs: Sequence[ScanPair],
    model: EgoMotionModel,
    acceleration: Array | None = None,
    velocity: Array | None = None,
) -> Problem:
    """The cost of the velocity that pairs of scans share.

    The earlier scan of each is the fixed set, the later one the moving set, with its Doppler
    velocities.  With an acceleration (3,) and a rough velocity (3,) of the vehicle, it is the
    velocity at the time `middle_of` the pairs: what the vehicle has gained from then to the middle
    of a pair's interval, whose mean velocity the positions show, and to the later scan, is taken
    off positions and Doppler velocities.
    """
    time, found = middle_of(pairs), []
    for pair in pairs:
        previous, current, mounting = pair
        interval, moving = pair.interval, current.point_set(mounting)
        ahead = measurement = None
        if acceleration is not None and velocity is not None:
            ahead = (current.time - time) * acceleration
            if pair.middle != time and acceleration.any():
                # a small motion that follows the pair's own
                gained = (pair.middle - time) * (right_jacobian(interval * velocity) @ acceleration)
                v_x, v_y, turn = (interval * gained).tolist()
                shift = np.array([v_x - 0.5 * turn * v_y, v_y + 0.5 * turn * v_x])
                means = moving.means @ rigid.rotation(-turn) + shift
                moving = PointSet._of(means, moving.covariances, moving.weights)
        if model.doppler:
            measurement = current.doppler_measurement(
                mounting, interval, of_twist=not model.first_order, ahead=ahead
            )
        found.append(Pair(previous.point_set(mounting), moving, measurement, interval))
    return model.problem(found)


def right_jacobian(motion: Array) -> Array:
    """The right Jacobian (3, 3) of SE(2) to second order, I - b / 2 + b² / 6 with b = [motion, .].

    It gives the small motion that follows exp(motion) if a small twist is added to the motion.
    """
    x, y, turn = motion.tolist()
    along, across = turn * x / 6.0 - 0.5 * y, turn * y / 6.0 + 0.5 * x
    both = 1.0 - turn * turn / 6.0
    return np.array([[both, 0.5 * turn, along], [-0.5 * turn, both, across], [0.0, 0.0, 1.0]])
