"""The node of the page runs, with stand-ins for ROS, and publishes what a tracker estimates."""

import re
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d.radar import Mounting, Tracker, simulate_drive

PAGE = Path(__file__).resolve().parents[2] / "chapters" / "ros2_node.md"
FRONT = simulate_drive(np.random.default_rng(0), 1.0, mounting=Mounting(3.6, 0.0, 0.0))
REAR = simulate_drive(np.random.default_rng(1), 1.0, mounting=Mounting(-0.9, 0.0, np.pi))


class Node:
    """A node that collects what it publishes and is told."""

    def __init__(self, name):
        self.name, self.published, self.warnings, self.callbacks = name, [], [], {}

    def create_publisher(self, _kind, _topic, _depth):
        return SimpleNamespace(publish=self.published.append)

    def create_subscription(self, _kind, topic, callback, _depth):
        self.callbacks[topic] = callback

    def get_logger(self):
        return SimpleNamespace(warning=self.warnings.append)


def twist():
    vector = SimpleNamespace
    inner = SimpleNamespace(linear=vector(x=0.0, y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=0.0))
    stamp = SimpleNamespace(sec=0, nanosec=0)
    header = SimpleNamespace(stamp=stamp, frame_id="")
    return SimpleNamespace(header=header, twist=SimpleNamespace(twist=inner, covariance=[0.0] * 36))


def cloud(scan, shift):
    """A message with the targets of a scan; its fields are read by the stand-in below."""
    points = {
        "x": scan.range * np.cos(scan.azimuth),
        "y": scan.range * np.sin(scan.azimuth),
        "z": np.zeros(len(scan)),
        "doppler": scan.doppler,
    }
    time = 1e9 + scan.time + shift
    stamp = SimpleNamespace(sec=int(time), nanosec=round(1e9 * (time % 1.0)))
    return SimpleNamespace(header=SimpleNamespace(stamp=stamp), points=points)


@pytest.fixture
def node(monkeypatch):
    """The namespace of the page's program, with its node."""
    contents = {
        "rclpy": {"init": None, "spin": None},
        "rclpy.node": {"Node": Node},
        "geometry_msgs": {},
        "geometry_msgs.msg": {"TwistWithCovarianceStamped": twist},
        "sensor_msgs": {},
        "sensor_msgs.msg": {"PointCloud2": object},
        "sensor_msgs_py": {},
        "sensor_msgs_py.point_cloud2": {"read_points": lambda m, _fields, skip_nans: m.points},
    }
    for name, members in contents.items():
        module = ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)
    (program,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)
    space = {"__name__": "node"}
    exec(compile(program, PAGE.name, "exec"), space)
    return SimpleNamespace(**space)


def test_the_node_publishes_the_estimates_of_a_tracker(node):
    """Breaks if a field has another name, a covariance another place, or nan is published."""
    made = node.RadarOdometry()
    tracker = Tracker(node.MOUNTINGS, budget=node.BUDGET, side_slip=0.05)
    expected = []
    for front, rear in zip(FRONT.scans, REAR.scans, strict=True):
        for name, scan, shift in (("front", front, 0.0), ("rear", rear, 0.02)):
            message = cloud(scan, shift)
            made.callbacks[f"/{name}/points"](message)
            time = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
            x, y, z, doppler = message.points.values()
            targets = node.RadarScan.from_cartesian(time, x, y, z, doppler=doppler, **node.SIGMAS)
            expected += tracker.add(name, targets)
    good = [estimate for estimate in expected if estimate.converged]
    assert len(made.published) == len(good) > 5
    for message, estimate in zip(made.published, good, strict=True):
        inner = message.twist.twist
        assert_array_equal([inner.linear.x, inner.linear.y, inner.angular.z], estimate.theta)
        covariance = np.reshape(message.twist.covariance, (6, 6))
        assert_array_equal(covariance[np.ix_([0, 1, 5], [0, 1, 5])], estimate.covariance)
        assert np.isfinite(covariance).all()
        stamp = message.header.stamp
        assert_allclose(stamp.sec + 1e-9 * stamp.nanosec, estimate.time, atol=1e-6)
    made.callbacks["/front/points"](cloud(FRONT.scans[-2], 0.05))
    assert "increasing" in made.warnings[0]
