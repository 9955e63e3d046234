"""The room that appendix B scans: rays end on its walls, and two scans agree about it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d import rigid
from d2d.study.point_sets import room_scans
from d2d.study.point_sets.room_scans import (
    MOTION,
    ROOM,
    ray_ranges,
    room_pair,
    room_scan,
    segments,
)


def test_rays_end_on_the_walls():
    azimuth = np.linspace(-np.pi, np.pi, 90)
    pose = np.array([0.5, 0.3, 0.4])
    ends = pose[:2] + ray_ranges(pose, azimuth)[:, None] * np.stack(
        [np.cos(pose[2] + azimuth), np.sin(pose[2] + azimuth)], axis=-1
    )
    start, along = segments(ROOM)[:, 0], np.diff(segments(ROOM), axis=1)[:, 0]
    share = np.einsum("nsi,si->ns", ends[:, None] - start, along) / (along**2).sum(axis=-1)
    foot = start + np.clip(share, 0, 1)[..., None] * along
    assert np.linalg.norm(ends[:, None] - foot, axis=-1).min(axis=1).max() < 1e-9


def test_scans_without_noise_agree_on_the_room(monkeypatch):
    """The second scan, moved by the motion, lies on the walls that the first scanner sees."""
    _, after = room_pair(np.random.default_rng(0))
    monkeypatch.setattr(room_scans, "SIGMA_RANGE", 1e-12)
    noise_free = room_scan(np.random.default_rng(0), MOTION)
    moved = rigid.transform_means(MOTION, noise_free.points)
    seen = ray_ranges(np.zeros(3), np.arctan2(moved[:, 1], moved[:, 0]))
    visible = np.hypot(*moved.T) <= seen + 1e-6
    assert_allclose(np.hypot(*moved.T)[visible], seen[visible], atol=1e-6)
    assert visible.mean() > 0.9
    assert len(after.points) == len(noise_free.points)


def test_a_scanner_outside_the_room_is_refused():
    with pytest.raises(ValueError, match="pose must lie inside the room"):
        room_scan(np.random.default_rng(), [50.0, 0.0, 0.0])
