"""Scans that several tests register."""

import numpy as np
import pytest

from d2d.study.point_sets.room_scans import room_pair


@pytest.fixture(scope="module")
def scans() -> tuple[np.ndarray, np.ndarray]:
    """The points of two scans of a room."""
    before, after = room_pair(np.random.default_rng(1))
    return before.points, after.points
