"""Bags of ROS 1 and ROS 2, which the tests write: scans, mountings, references, results."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from d2d.radar import Mounting, Track, load_reference, simulate_drive, track
from d2d.radar.cli import main
from d2d.radar.readers.bag import load_bag, write_bag
from d2d.radar.readers.odometry import load_gyro

DRIVE = simulate_drive(np.random.default_rng(0), duration=2.0)
SIGMAS = {"sigma_range": 0.1, "sigma_azimuth": 0.01, "sigma_doppler": 0.06}
RETURN = (
    "float32 range\nfloat32 azimuth\nfloat32 elevation\nfloat32 doppler_velocity\nfloat32 amplitude"
)
SCAN = "std_msgs/Header header\nradar_msgs/RadarReturn[] returns"
MOVES = "geometry_msgs/TransformStamped[] transforms"
KINDS = ["ros1", "sqlite3", "mcap"]
YAW, PITCH = 0.3, 0.2  # of the sensor in its bracket, and of the bracket


class Bag:
    """A bag that is being written, of one of the kinds."""

    def __init__(self, folder, kind):
        self.first = kind == "ros1"
        self.path = folder / ("log.bag" if self.first else "log")
        self.store = get_typestore(Stores.ROS1_NOETIC if self.first else Stores.ROS2_HUMBLE)
        types = get_types_from_msg(RETURN, "radar_msgs/msg/RadarReturn")
        types |= get_types_from_msg(MOVES, "tf2_msgs/msg/TFMessage") if self.first else {}
        self.store.register(types | get_types_from_msg(SCAN, "radar_msgs/msg/RadarScan"))
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        self.writer = (
            Writer1(self.path)
            if self.first
            else Writer(self.path, version=8, storage_plugin=plugin)
        )
        self.topics = {}

    def make(self, name, *values):
        return self.store.types[name](*values)

    def header(self, time, frame):
        stamp = self.make("builtin_interfaces/msg/Time", int(time), round(time % 1 * 1e9))
        return self.make("std_msgs/msg/Header", *([0] if self.first else []), stamp, frame)

    def write(self, topic, time, message):
        kind = message.__msgtype__
        if topic not in self.topics:
            self.topics[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        raw = (self.store.serialize_ros1 if self.first else self.store.serialize_cdr)(message, kind)
        self.writer.write(self.topics[topic], round(time * 1e9), raw)

    def cloud(self, header, **columns):
        names, count = list(columns), len(next(iter(columns.values())))
        layout = np.dtype(
            {"names": names, "formats": ["<f4"] * len(names), "itemsize": 4 * len(names) + 4}
        )
        rows = np.zeros(count, layout)
        for name, column in columns.items():
            rows[name] = column
        fields = [
            self.make("sensor_msgs/msg/PointField", name, layout.fields[name][1], 7, 1)
            for name in names
        ]
        size, data = layout.itemsize, np.frombuffer(rows.tobytes(), np.uint8)
        shape = (1, count, fields, False, size, size * count, data, True)
        return self.make("sensor_msgs/msg/PointCloud2", header, *shape)

    def returns(self, header, *columns):
        rows = [
            self.make("radar_msgs/msg/RadarReturn", *map(float, row))
            for row in zip(*columns, strict=True)
        ]
        return self.make("radar_msgs/msg/RadarScan", header, rows)

    def transform(self, parent, child, place, quaternion):
        pose = self.make(
            "geometry_msgs/msg/Transform",
            self.make("geometry_msgs/msg/Vector3", *place),
            self.make("geometry_msgs/msg/Quaternion", *quaternion),
        )
        header = self.header(0.0, parent)
        return self.make("geometry_msgs/msg/TransformStamped", header, child, pose)


@pytest.fixture(params=KINDS)
def bag(tmp_path, request):
    """A drive seen by a front radar as a cloud, by a tilted one as a RadarScan, and an odometry."""
    bag = Bag(tmp_path, request.param)
    vector, quaternion = "geometry_msgs/msg/Vector3", "geometry_msgs/msg/Quaternion"
    truth = DRIVE.truth
    with bag.writer:
        half = np.sin([YAW / 2, PITCH / 2]), np.cos([YAW / 2, PITCH / 2])
        moves = [
            bag.transform("base_link", "front", (0.4, 0.0, 0.5), (0.0, 0.0, 0.0, 1.0)),
            bag.transform(
                "base_link", "bracket", (1.0, 0.5, 0.2), (0.0, 0.0, half[0][0], half[1][0])
            ),
            bag.transform("bracket", "side", (0.5, 0.0, 0.1), (0.0, half[0][1], 0.0, half[1][1])),
        ]
        bag.write("/tf_static", 0.1, bag.make("tf2_msgs/msg/TFMessage", moves))
        for scan, (v_x, v_y, omega), (x, y, yaw) in zip(
            DRIVE.scans, truth.theta, truth.poses, strict=True
        ):
            time = 1e9 + scan.time
            heard = time + 0.03
            cloud = {
                "x": np.append(scan.range * np.cos(scan.azimuth), np.nan),
                "y": np.append(scan.range * np.sin(scan.azimuth), 0.0),
                "V_Doppler (mps)": np.append(scan.doppler, 0.0),
                "snr_db": np.arange(len(scan) + 1.0),
            }
            bag.write("/front/points", heard, bag.cloud(bag.header(time, "front"), **cloud))
            up = 0.1 + 0.0 * scan.range
            columns = (scan.range, scan.azimuth, up, scan.doppler, up)
            del cloud["V_Doppler (mps)"]
            bag.write("/none", heard, bag.cloud(bag.header(time, "front"), **cloud))
            bag.write("/side/scan", heard, bag.returns(bag.header(0.0, "side"), *columns))
            turn = bag.make(vector, 0.0, 0.0, omega)
            twist = bag.make("geometry_msgs/msg/Twist", bag.make(vector, v_x, v_y, 0.0), turn)
            at = bag.make("geometry_msgs/msg/Point", x, y, 0.0)
            facing = bag.make(quaternion, 0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2))
            pose = bag.make("geometry_msgs/msg/Pose", at, facing)
            both = (
                bag.make(f"geometry_msgs/msg/{kind}WithCovariance", each, np.zeros(36))
                for kind, each in (("Pose", pose), ("Twist", twist))
            )
            odometry = bag.make(
                "nav_msgs/msg/Odometry", bag.header(time, "odom"), "base_link", *both
            )
            bag.write("/odom", heard, odometry)
            none, still = np.zeros(9), bag.make(vector, 0.0, 0.0, 0.0)
            moved = (facing, none, turn, none, still, none)
            bag.write(
                "/imu", heard, bag.make("sensor_msgs/msg/Imu", bag.header(time, "imu"), *moved)
            )
    return bag.path


@pytest.mark.filterwarnings("ignore:.*points are left out:UserWarning")
def test_scans_and_mountings_of_a_bag(bag):
    """Breaks if a field, a stamp or a transform is not found, or a chain is in the wrong order."""
    read = load_bag(bag, "/front/points", "/side/scan", **SIGMAS)
    (front, at_front), (side, at_side) = read.values()
    assert at_front == Mounting(0.4)
    assert_allclose(
        [at_side.x, at_side.y, at_side.yaw, at_side.pitch, at_side.roll],
        [1.0 + 0.5 * np.cos(YAW), 0.5 + 0.5 * np.sin(YAW), YAW, PITCH, 0.0],
        atol=1e-12,
    )
    for one, other, given in zip(front, side, DRIVE.scans, strict=True):
        assert one.time == pytest.approx(1e9 + given.time, abs=1e-6)
        assert other.time == pytest.approx(1e9 + given.time + 0.03, abs=1e-6)
        for name in ("range", "azimuth", "doppler"):
            assert_allclose(getattr(one, name), getattr(given, name), rtol=1e-5, atol=1e-5)
            assert_allclose(getattr(other, name), getattr(given, name), rtol=1e-5, atol=1e-5)
        assert_allclose(other.elevation, 0.1, rtol=1e-6)
    (strong, _) = load_bag(bag, "/front/points", min_snr=5.0, **SIGMAS)["/front/points"]
    assert [len(scan) for scan in strong] == [len(scan) - 5 for scan in DRIVE.scans]
    (turned, _) = load_bag(bag, "/front/points", columns={"y": "-y"}, **SIGMAS)["/front/points"]
    assert_allclose(turned[0].azimuth, -front[0].azimuth)
    (small, _) = load_bag(bag, "/side/scan", degrees=True, **SIGMAS)["/side/scan"]
    assert_allclose(np.rad2deg(small[0].azimuth), side[0].azimuth)
    (late, _) = load_bag(bag, "/front/points", bag_stamps=True, **SIGMAS)["/front/points"]
    assert late[0].time == pytest.approx(1e9 + 0.03, abs=1e-6)


def test_the_odometry_of_a_bag_is_a_reference_and_its_imu_a_gyro(bag):
    """Breaks if velocities or poses are those of another message or axis."""
    found = load_reference(bag)
    assert_allclose(found.times, 1e9 + DRIVE.truth.times, atol=1e-6)
    assert_allclose(found.theta, DRIVE.truth.theta, atol=1e-12)
    assert_allclose(found.poses, DRIVE.truth.poses, atol=1e-12)
    times, rates = load_gyro(bag)
    assert_allclose(times, found.times)
    assert_allclose(rates, DRIVE.truth.theta[:, 2], atol=1e-12)
    with pytest.raises(ValueError, match=r"reference must be one of /odom, but is /front/points"):
        load_reference(bag, "/front/points")


def test_a_bag_goes_in_and_out_on_the_command_line(bag, tmp_path, capsys):
    """Breaks if a sensor, a mounting or the bag that is written is lost on the way."""
    call = ["track", "--bag", str(bag), "--topic", "/front/points", "--no-picture"]
    out = str(tmp_path / "out.mcap")
    assert main([*call, "--output", f"{tmp_path}/drive", "--output-bag", out]) == 0
    said = capsys.readouterr()
    assert "left out" in said.err
    assert "usual values are taken" in said.err
    assert f"wrote {out}" in said.out
    driven = Track.load(tmp_path / "drive.npz")
    assert_allclose(driven.theta[:, 0], DRIVE.truth.theta[1:, 0], atol=0.3)
    assert main(["compare", f"{tmp_path}/drive.npz", str(bag)]) == 0
    assert_array_equal(load_reference(out, "/d2d/twist").theta, driven.theta[driven.converged])


@pytest.mark.parametrize("name", ["out.bag", "out"])
def test_a_track_becomes_messages_without_nan(tmp_path, name):
    """Breaks if the covariance is not 6 x 6 in row-major order, or a failure becomes a twist."""
    scans = [*DRIVE.scans[:8], DRIVE.scans[8][:0], *DRIVE.scans[9:]]
    driven = track((scans, DRIVE.mounting))
    assert not driven.converged.all()
    write_bag(tmp_path / name, driven)
    good = driven.converged
    twists = load_reference(tmp_path / name, "/d2d/twist")
    assert_allclose(twists.times, driven.times[good], atol=1e-6)
    assert_array_equal(twists.theta, driven.theta[good])
    odometry = load_reference(tmp_path / name, "/d2d/odometry")
    assert_allclose(odometry.poses, driven.poses()[1:], atol=1e-12)
    with AnyReader([tmp_path / name]) as reader:
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            assert np.isfinite(message.twist.covariance).all()
            if connection.topic == "/d2d/odometry":
                assert np.isfinite(message.pose.covariance).all()
        planar = np.reshape(message.twist.covariance, (6, 6))[np.ix_([0, 1, 5], [0, 1, 5])]
    assert_array_equal(planar, driven.covariance[-1])
    with pytest.raises(FileExistsError):
        write_bag(tmp_path / name, driven)


def test_what_a_bag_has_not_is_named(bag, tmp_path):
    """Breaks if another topic or frame is taken, or an error of rosbags gets through."""
    (tmp_path / "torn.bag").write_bytes(b"#ROSBAG V2.0\n")
    (tmp_path / "torn").mkdir()
    (tmp_path / "torn" / "metadata.yaml").write_text("rosbag2:\n  duration\n")
    (tmp_path / "torn.mcap").write_bytes(b"\x89MCAP0\r\n")
    for name, topic, options, said in (
        (bag.name, "/rear", {}, "must be one of /front/points, /none, /side/scan, but is /rear"),
        (bag.name, "/side/scan", {"base_frame": "car"}, "/tf_static must lead from car to side"),
        (bag.name, "/side/scan", {"sigma_range": -1.0}, "is not a bag with scans of a radar"),
        (bag.name, "/none", {"mountings": {"/non": Mounting()}}, "mountings must be one of /none"),
        (bag.name, "/none", {}, "its fields are x, y, snr_db: place or Doppler is missing"),
        ("torn.bag", "/rear", {}, "torn.bag is not a complete bag of ROS"),
        ("torn", "/rear", {}, "torn is not a complete bag of ROS"),
        ("torn.mcap", "/rear", {}, "torn.mcap is not a complete bag of ROS"),
    ):
        with pytest.raises(ValueError, match=said):
            load_bag(tmp_path / name, topic, **(SIGMAS | options))
    with pytest.raises(FileNotFoundError, match="it should be a bag"):
        load_bag(tmp_path / "none.bag", "/rear")
