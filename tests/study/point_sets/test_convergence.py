"""The room that appendix B scans, and the plane of wrong initial guesses."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d import rigid
from d2d.baselines import ndt_p2d
from d2d.study.point_sets import room_scans
from d2d.study.point_sets.convergence import (
    CELL_SIZES,
    is_registered,
    motion_errors,
    ndt_coarse_to_fine,
)
from d2d.study.point_sets.room_scans import MOTION, ROOM, ray_ranges, room_pair, room_scan, segments


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


def test_success_is_judged_in_the_frame_of_the_motion_and_modulo_full_turns():
    truth = np.array([3.0, -1.0, 2.0])
    near = rigid.compose(truth, [0.1, 0.1, 0.02])
    far, turned = rigid.compose(truth, [0.3, 0.0, 0.0]), rigid.compose(truth, [0.0, 0.0, 0.1])
    full_turn = truth + np.array([0.0, 0.0, 2.0 * np.pi])
    judged = is_registered(np.stack([truth, near, far, turned, full_turn]), truth)
    np.testing.assert_array_equal(judged, [True, True, False, False, True])
    assert is_registered(far, truth, tolerance=2.0)


def test_coarse_to_fine_starts_each_size_where_the_last_ended():
    """Breaks if a size is left out, or every size starts from the guess."""
    before, after = room_pair(np.random.default_rng(5))
    start = MOTION + np.array([0.8, -0.6, np.deg2rad(15.0)])
    by_hand = start
    for size in (4.0, 2.0, 1.0):
        by_hand = ndt_p2d(before.points, after.points, by_hand, size=size).theta
    reached = ndt_coarse_to_fine(ndt_p2d, *CELL_SIZES)(before, after, start)
    np.testing.assert_array_equal(reached, by_hand)
    assert not np.allclose(reached, ndt_p2d(before.points, after.points, start).theta, atol=1e-3)
    assert is_registered(reached, MOTION)


def test_motion_errors_are_millimetres_and_signed_degrees() -> None:
    """Breaks if units change, the sign of a rotation is lost, or a full turn counts as an error."""
    truth = np.array([1.0, 2.0, 0.3])
    off = rigid.compose(truth, [0.003, 0.004, np.deg2rad(-2.0)])
    full_turn = np.array([0.0, 0.0, 2.0 * np.pi])
    millimetres, degrees = motion_errors(np.stack([off, off + full_turn]), truth)
    np.testing.assert_allclose(millimetres, 5.0)
    np.testing.assert_allclose(degrees, -2.0)
