"""The motion that another sensor measured, from a file: a TUM trajectory, or an odometry."""

import os
from pathlib import Path

import numpy as np

from d2d._checks import FINITE, check_path
from d2d._types import Array
from d2d.radar.readers.bag import GYROS, is_bag, load_bag_reference
from d2d.radar.readers.shared import yaw_of
from d2d.radar.readers.table import decoded, number, read_table
from d2d.radar.scans.reference import Reference

_POSES = 8  # numbers in a line of a TUM trajectory
_REACH, _INTERVALS = 0.2, 2.5  # s, and intervals, to each side of a pose that give its velocity
_LONGEST = 20.0  # s, between two poses that still show a velocity


def load_reference(path: str | os.PathLike[str], topic: str | None = None) -> Reference:
    """Read the motion that something else than the radars measured, for `compare`, `calibrate`.

    A *TUM trajectory* has lines "t x y z qx qy qz qw" (s, m, quaternion) of the vehicle frame, in
    any world; its velocities are slopes of the poses, see `Reference.from_poses`.  An *odometry* is
    a CSV file with the columns ``time`` (s) and ``speed`` (m/s, negative backwards), ``yaw_rate``
    (rad/s, counter-clockwise; or ``yaw_rate_deg``) or both: what is missing is nan, as its poses
    are.  With a speed, v_y is taken to be zero, as it nearly is in the middle of a rear axle.
    A *bag* has a ``topic`` of Odometry, TwistWithCovarianceStamped or TwistStamped.

    Raises a ``ValueError`` that names file and line if it is neither, or not in time order.
    """
    source = check_path("path", path)
    if is_bag(source):
        found = load_bag_reference(source, topic)
    elif topic is not None:
        raise ValueError(f"{source} is no bag, and has no topic {topic}")
    else:
        text = decoded(source)
        first = next((line for line in text.splitlines() if line.strip() and line[0] != "#"), "")
        if first[:1].isdigit() and first.count(",") == _POSES - 1:
            raise ValueError(f"{source}: poses must be separated by spaces: t x y z qx qy qz qw")
        found = _poses(source, text) if len(first.split()) == _POSES else _odometry(source)
    if len(found.times) < 2 or not (np.diff(found.times) > 0.0).all():
        raise ValueError(
            f"{source} must have two lines or more, poses six, in strictly increasing time"
        )
    return found


def load_gyro(path: str | os.PathLike[str], topic: str | None = None) -> tuple[Array, Array]:
    """Times (n,) in s and yaw rates (n,) in rad/s of a gyro, for `Gyro`.

    The file is one that `load_reference` reads, or a bag with messages sensor_msgs/Imu.
    """
    source = check_path("path", path)
    bag = is_bag(source)
    found = load_bag_reference(source, topic, GYROS) if bag else load_reference(source, topic)
    if np.isnan(found.theta[:, 2]).all():
        raise ValueError(f"{source} has no yaw rate")
    return found.times, found.theta[:, 2]


def _odometry(source: Path) -> Reference:
    """The times of a table, with the speeds or yaw rates that it has."""
    either = [("time", "speed"), ("time", "yaw_rate")]
    table = read_table(source, either, ("time", "speed", "yaw_rate"))
    found = table.numbers(table.columns)
    table.check(found)
    for row in 1 + np.flatnonzero(np.diff(found["time"]) <= 0.0)[:1]:
        raise ValueError(f"{table.where(row)}: times must increase, but do not")
    unknown = np.full_like(found["time"], np.nan)
    speed, omega = (found.get(name, unknown) for name in ("speed", "yaw_rate"))
    theta = np.column_stack([speed, 0.0 * speed, omega])
    return Reference(found["time"], theta, np.full_like(theta, np.nan))


def _poses(source: Path, text: str) -> Reference:
    rows: list[list[float]] = []
    for line, words in enumerate(map(str.split, text.splitlines()), start=1):
        if not words or words[0].startswith("#"):
            continue
        try:
            rows.append([FINITE.number("pose", number("pose", word)) for word in words])
            if len(words) != _POSES or not any(rows[-1][4:]):
                raise ValueError("there must be t x y z qx qy qz qw, a quaternion that is not zero")
            if len(rows) > 1 and rows[-1][0] <= rows[-2][0]:
                raise ValueError(f"times must increase, but {words[0]} follows {rows[-2][0]!r}")
        except ValueError as error:
            raise ValueError(f"{source}, line {line}: {error}") from None
    time, *place, _, x, y, z, w = np.array(rows).T
    poses = np.column_stack([*place, yaw_of(w, x, y, z)])
    reach = max(_REACH, _INTERVALS * float(np.median(np.diff(time)))) if len(time) > 1 else _REACH
    if reach > _INTERVALS * _LONGEST:
        raise ValueError(f"{source}: times must be in s, but are {reach / _INTERVALS:g} apart")
    found = Reference.from_poses(time, poses, time, half_width=reach)
    known = np.isfinite(found.theta).all(axis=1)  # where the poses show velocities
    return Reference(time[known], found.theta[known], found.poses[known])
