"""Scans that several tests register."""

import numpy as np
import pytest

from d2d import PointSet
from d2d.study.plane.scenarios import OVERLAPPED
from d2d.study.point_sets.room_scans import room_pair


@pytest.fixture(scope="module")
def scans() -> tuple[np.ndarray, np.ndarray]:
    """The points of two scans of a room."""
    before, after = room_pair(np.random.default_rng(1))
    return before.points, after.points


@pytest.fixture(scope="module")
def sets() -> tuple[PointSet, PointSet]:
    """One draw of the overlapped scene."""
    fixed, moving = OVERLAPPED.sample(1, np.random.default_rng(3))
    return fixed[0], moving[0]
