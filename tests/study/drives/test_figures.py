"""The camera's view of the simulated street: upright faces in the right place and order."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d.radar.simulation.world import Reflectors, build_world
from d2d.study.drives import figures


def test_a_face_is_seen_where_its_ends_are():
    """Breaks if left and right or up and down are exchanged."""
    ((distance, corners, *_),) = figures._face(
        np.array([10.0, 2.0]), np.array([10.0, -2.0]), 3.0, "0.5", "none"
    )
    assert distance == pytest.approx(10.0)
    left, right = corners[[0, 3]], corners[[1, 2]]
    assert_allclose(left[:, 0], -0.2)  # what lies to the left of the sensor is drawn left
    assert_allclose(right[:, 0], 0.2)
    assert left[0, 1] < 0.0 < left[1, 1], "from the ground to above the eye"


def test_a_face_that_reaches_behind_the_camera_is_cut_off():
    """Breaks if what lies behind is projected to the front, upside down."""
    start, end = np.array([-4.0, 2.0]), np.array([6.0, 2.0])
    for ends in ((start, end), (end, start)):
        ((_, corners, *_),) = figures._face(*ends, 3.0, "0.5", "none")
        assert_allclose(np.sort(corners[:, 0]), [-4.0, -4.0, -1.0 / 3.0, -1.0 / 3.0])
    assert figures._face(-end, -end + [0.0, 1.0], 3.0, "0.5", "none") == []


def test_the_farthest_is_drawn_first():
    """Breaks if a far house covers a near one."""
    unit = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    world = build_world(np.random.default_rng(0), movers=0)
    still = world.reflectors
    empty = Reflectors(still.positions[:0], still.strength[:0], still.kind[:0])
    places = np.array([[10.0, 0.0], [30.0, 3.0], [20.0, -2.0]])
    houses = unit + places[:, None]
    alone = replace(world, buildings=houses, cars=houses[:0], reflectors=empty)
    _, ax = plt.subplots()
    figures.camera_view(ax, alone, np.zeros(3), 0.0, np.deg2rad(42.0))
    (faces,) = ax.collections
    height = [np.ptp(path.vertices[:, 1]) for path in faces.get_paths()]
    assert len(height) == 12
    assert max(height[:4]) < min(height[4:8]) < max(height[4:8]) < min(height[8:])
