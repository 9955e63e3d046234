"""Scans, mountings and references in bags of ROS 1 and ROS 2, also MCAP; needs rosbags."""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from d2d._checks import check_choice, check_path
from d2d._types import Array
from d2d.radar.files import brief, reading
from d2d.radar.readers.reader import Reader, Source, mountings_of, options_of
from d2d.radar.readers.shared import yaw_of
from d2d.radar.readers.table import TARGET, columns_among, plain_name, scan_of, select, valid
from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.scans.reference import Reference
from d2d.radar.scans.scan import ANGLES, MEASURED, Mounting, RadarScan
from d2d.radar.tracks.track import Track

_NANOSECOND = 1e-9  # s
_UNKNOWN, _PLANAR = 1e6, [0, 1, 5]  # variance; x, y and yaw among x, y, z, roll, pitch, yaw
_TYPES = {1: "i1", 2: "u1", 3: "<i2", 4: "<u2", 5: "<i4", 6: "<u4", 7: "<f4", 8: "<f8"}
_PACKAGES = {"PointCloud2": "sensor_msgs", "Imu": "sensor_msgs", "RadarScan": "radar_msgs"}
_PACKAGES |= {"Odometry": "nav_msgs", "Header": "std_msgs", "Time": "builtin_interfaces"}


def _kind(name: str) -> str:
    """The whole name of a type of messages."""
    return f"{_PACKAGES.get(name, 'geometry_msgs')}/msg/{name}"


_SCANS = (_kind("PointCloud2"), _kind("RadarScan"))
REFERENCES = tuple(map(_kind, ("Odometry", "TwistWithCovarianceStamped", "TwistStamped")))
GYROS = (_kind("Imu"),)


def is_bag(path: Path) -> bool:
    """Whether a path is a bag: a file .bag, .mcap or .db3, or a folder with a metadata.yaml."""
    return path.suffix in (".bag", ".mcap", ".db3") or (path / "metadata.yaml").exists()


def load_bag(
    path: str | os.PathLike[str],
    *topics: str,
    base_frame: str = "base_link",
    mountings: Mapping[str, Mounting] | None = None,
    columns: Mapping[str, str] | None = None,
    degrees: bool = False,
    bag_stamps: bool = False,
    min_snr: float | None = None,
    **sigmas: float | None,
) -> dict[str, tuple[list[RadarScan], Mounting]]:
    """Read the scans and the mounting of each topic, by its name, as `track` takes them.

    A topic has messages ``sensor_msgs/PointCloud2``, with fields that are named as the columns of a
    log may be, or ``radar_msgs/RadarScan``.  Points that are not finite or without a range are left
    out, with a warning that counts them.  The mounting is that of the messages' frame in
    ``base_frame``, from ``/tf_static``, unless it is among the ``mountings``.  Times are those of
    the headers; with ``bag_stamps``, or where a header has none, those at which the messages were
    written.  ``columns`` (of fields), ``degrees``, ``min_snr`` and sigmas are those of `load_csv`.

    Raises a ``ValueError`` if the bag cannot be read or a topic, field or mounting is missing, and
    a ``ModuleNotFoundError`` without rosbags.
    """
    source, stated, found = check_path("path", path), dict(mountings or {}), {}
    for name in stated:
        check_choice("mountings", name, topics)
    given = {name: sigma for name, sigma in sigmas.items() if sigma is not None}
    for name in topics:
        clouds, times, frame = [], [], ""
        with _opened(source) as bag:
            topic = _topic(source, bag, "a radar", _SCANS, name)
            with reading(source, f"a bag with scans of a radar on {topic}"):
                for message, time, kind in _messages(bag, topic, bag_stamps):
                    clouds.append(_cloud(message) if kind == _SCANS[0] else _returns(message))
                    times.append(time)
                    frame = message.header.frame_id
                values, where = _columns(clouds, columns or {}, degrees), f"{source}, {topic}"
                values, used = select(where, "points", values, valid(values), given, min_snr)
                ends = np.cumsum([len(next(iter(cloud.values()))) for cloud in clouds])
                parts = np.split(np.arange(len(used)), ends[:-1])
                scans = [
                    scan_of(time, {name: c[own[used[own]]] for name, c in values.items()})
                    for time, own in zip(times, parts, strict=True)
                ]
        found[topic] = scans, stated.get(topic) or _mounting(source, frame, base_frame)
    return found


def load_bag_reference(
    path: Path, topic: str | None = None, kinds: Sequence[str] = REFERENCES
) -> Reference:
    """The motion in messages Odometry, TwistWithCovarianceStamped or TwistStamped.

    Velocities are those of the messages' child frame.  Without a topic, it is the only one of the
    ``kinds``.
    """
    rows = []
    with _opened(path) as bag:
        topic = _topic(path, bag, "the reference", kinds, topic)
        for message, stamp, kind in _messages(bag, topic):
            row = np.full(7, np.nan)
            rows.append(row)
            if kind in GYROS:
                row[[0, 3]] = stamp, message.angular_velocity.z
                continue
            twist = getattr(message.twist, "twist", message.twist)
            row[:4] = stamp, twist.linear.x, twist.linear.y, twist.angular.z
            if kind == REFERENCES[0]:
                at, turn = message.pose.pose.position, message.pose.pose.orientation
                row[4:] = at.x, at.y, float(yaw_of(turn.w, turn.x, turn.y, turn.z))
    table = np.array(rows).reshape(-1, 7)
    if not np.isfinite(table[:, [0, 3]]).all():
        raise ValueError(f"{path}: the times and yaw rates of {topic} must be finite")
    return Reference(table[:, 0], table[:, 1:4], table[:, 4:])


def _rosbags() -> Any:
    try:
        import rosbags.highlevel
        import rosbags.rosbag1
        import rosbags.rosbag2
        import rosbags.typesys
    except ModuleNotFoundError:
        raise ModuleNotFoundError("bags need rosbags: pip install 'd2d[ros]'") from None
    return rosbags


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """A bag, whose faults become ValueErrors that name it."""
    ros = _rosbags()
    if not path.exists():
        raise FileNotFoundError(f"{path} does not exist; it should be a bag")
    with reading(path, "a complete bag of ROS"):
        store = ros.typesys.get_typestore(ros.typesys.Stores.LATEST)
        with ros.highlevel.AnyReader([path], default_typestore=store) as reader:
            yield reader


def _topic(path: Path, bag: Any, of: str, kinds: Sequence[str], topic: str | None) -> str:
    """The topic, which must have messages of these types; without one, the only one that has."""
    known: list[str] = sorted({c.topic for c in bag.connections if c.msgtype in kinds})
    chosen = known[0] if topic is None and len(known) == 1 else topic
    if chosen is None or chosen not in known:
        listed = ", ".join(known) or "none"
        raise ValueError(f"{path}: the topic of {of} must be one of {listed}, but is {topic}")
    return chosen


def _messages(bag: Any, topic: str, bag_stamps: bool = False) -> Iterator[tuple[Any, float, str]]:
    """The messages of a topic with their times in s and types."""
    chosen = [connection for connection in bag.connections if connection.topic == topic]
    for connection, written, raw in bag.messages(connections=chosen):
        message = bag.deserialize(raw, connection.msgtype)
        stamp = message.header.stamp
        time = stamp.sec + _NANOSECOND * stamp.nanosec
        if bag_stamps or not time:
            time = _NANOSECOND * written
        yield message, time, connection.msgtype


def _columns(
    clouds: Sequence[Mapping[str, Array]], named: Mapping[str, str], degrees: bool
) -> dict[str, Array]:
    """The quantities of all targets, one cloud after the other, of fields by their names."""
    if not clouds:
        raise ValueError("it has no message")
    stated = dict.fromkeys(ANGLES, "deg") if degrees else {}
    ways = columns_among(clouds[0].keys(), TARGET, named, stated)
    needed = ({"doppler", *named, *place} for place in (MEASURED[:2], ("x", "y")))
    if not any(each <= ways.keys() for each in needed):
        raise ValueError(
            f"its fields are {', '.join(clouds[0])}: place or Doppler is missing, or has another "
            "name, which columns may state (--columns doppler=FIELD)"
        )
    return {
        name: way.factor * np.concatenate([cloud[way.name] for cloud in clouds])
        for name, way in ways.items()
    }


def _cloud(message: Any) -> dict[str, Array]:
    """The fields of a PointCloud2, by their names."""
    layout = np.dtype(
        {
            "names": [field.name for field in message.fields],
            "formats": [_TYPES[field.datatype] for field in message.fields],
            "offsets": [field.offset for field in message.fields],
            "itemsize": message.point_step,
        }
    )
    layout = layout.newbyteorder(">") if message.is_bigendian else layout
    points = np.frombuffer(message.data, layout, message.height * message.width)
    return {plain_name(name): points[name].astype(np.float64) for name in layout.names or ()}


def _returns(message: Any) -> dict[str, Array]:
    """The returns of a RadarScan; one whose elevations are all zero is flat."""
    names = ("range", "azimuth", "elevation", "doppler_velocity", "amplitude")
    table = np.array([[getattr(r, name) for name in names] for r in message.returns], np.float64)
    return dict(zip(names, table.reshape(-1, len(names)).T, strict=True))


def _mounting(path: Path, frame: str, base: str) -> Mounting:
    """The pose of a frame in the base frame, from the static transforms of a bag."""
    parents: dict[str, tuple[str, Any]] = {}
    with _opened(path) as bag:
        static = [c for c in bag.connections if c.topic.endswith("tf_static")]
        for connection, _, raw in bag.messages(connections=static) if static else ():
            for each in bag.deserialize(raw, connection.msgtype).transforms:
                child, parent = (n.strip("/") for n in (each.child_frame_id, each.header.frame_id))
                parents[child] = parent, each.transform
    rotation = scipy.spatial.transform.Rotation
    place, turn, at, end = np.zeros(3), rotation.identity(), frame.strip("/"), base.strip("/")
    for _ in range(len(parents)):
        if at != end and at in parents:
            at, transform = parents[at]
            step = rotation.from_quat([getattr(transform.rotation, name) for name in "xyzw"])
            arm = [getattr(transform.translation, name) for name in "xyz"]
            place, turn = step.apply(place) + arm, step * turn
    if at != end:
        raise ValueError(
            f"{path}: /tf_static must lead from {base} to {frame}, but has "
            f"{brief(', '.join(f'{p} to {c}' for c, (p, _) in parents.items())) or 'nothing'}; "
            "state the mounting (--mounting TOPIC X Y YAW), or another base_frame (--base-frame)"
        )
    yaw, pitch, roll = turn.as_euler("ZYX")
    return Mounting(place[0], place[1], yaw, pitch, roll)


def write_bag(path: str | os.PathLike[str], driven: Track, frame: str = "base_link") -> None:
    """Write a track as messages Odometry and TwistWithCovarianceStamped.

    The topics are ``/d2d/odometry``, of a pose in the frame "odom", and ``/d2d/twist``.  A path
    that ends with .bag becomes a bag of ROS 1, another one a folder of ROS 2 with an MCAP file.
    Estimates that were not accepted have no twist, and an odometry of unknown velocity.
    Covariances are in m, rad and seconds; what is not known has the variance 1e6.  The track must
    be of one segment, and the path free.
    """
    target = check_path("path", path)
    if target.exists():
        raise FileExistsError(f"{target} exists; a bag is not written over another one")
    ros, first = _rosbags(), target.suffix == ".bag"
    known = ros.typesys.Stores
    store = ros.typesys.get_typestore(known.ROS1_NOETIC if first else known.LATEST)
    serialize = store.serialize_ros1 if first else store.serialize_cdr
    mcap = {"version": 8, "storage_plugin": ros.rosbag2.StoragePlugin.MCAP}
    writer = ros.rosbag1.Writer(target) if first else ros.rosbag2.Writer(target, **mcap)

    def make(name: str, *content: Any) -> Any:
        return store.types[_kind(name)](*content)

    def write(topic: Any, time: float, of: str, name: str, *content: Any) -> None:
        seconds = int(time // 1.0)
        stamp = make("Time", seconds, min(round((time - seconds) / _NANOSECOND), 999_999_999))
        header = make("Header", *[0] * first, stamp, of)  # ROS 1 numbers its messages
        raw = serialize(make(name, header, *content), _kind(name))
        writer.write(topic, round(time / _NANOSECOND), raw)

    poses, start = driven.poses()[1:], driven.times[:1] - driven.intervals[:1]
    moved = driven.displacement(np.repeat(start, len(driven)), driven.times).covariance
    with writer:
        odometry, twists = (
            writer.add_connection(f"/d2d/{topic}", _kind(name), typestore=store)
            for topic, name in (("odometry", "Odometry"), ("twist", "TwistWithCovarianceStamped"))
        )
        for time, (x, y, yaw), spread, (v_x, v_y, omega), covariance, good in zip(
            *(driven.times, poses, moved, driven.theta, driven.covariance, driven.converged),
            strict=True,
        ):
            turn = make("Quaternion", 0.0, 0.0, np.sin(0.5 * yaw), np.cos(0.5 * yaw))
            place = make("Pose", make("Point", x, y, 0.0), turn)
            along, about = make("Vector3", v_x, v_y, 0.0), make("Vector3", 0.0, 0.0, omega)
            pose = make("PoseWithCovariance", place, _spatial(spread))
            twist = make("TwistWithCovariance", make("Twist", along, about), _spatial(covariance))
            write(odometry, time, "odom", "Odometry", frame, pose, twist)
            if good:
                write(twists, time, frame, "TwistWithCovarianceStamped", twist)


def _spatial(covariance: Array) -> Array:
    """A covariance (36,) in space, row by row, of one (3, 3) in the plane."""
    spatial = _UNKNOWN * np.eye(6)
    if np.isfinite(covariance).all():
        spatial[np.ix_(_PLANAR, _PLANAR)] = covariance
    return spatial.ravel()


def _read(path: str, chosen: Mapping[str, Any]) -> Source:
    given = options_of(chosen, "columns", "degrees", "base_frame", "bag_stamps", "min_snr")
    sensors = load_bag(path, *chosen["topic"], mountings=mountings_of(chosen), **given)
    return sensors, ErrorBudget()


READER = Reader("bag", "a bag of ROS 1 or ROS 2, or an MCAP file", load_bag, ("topic",), _read)
