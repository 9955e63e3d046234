"""The plane of wrong initial guesses, and what counts as a success."""

import numpy as np

from d2d import rigid
from d2d.baselines import ndt_p2d
from d2d.study.point_sets.convergence import (
    CELL_SIZES,
    is_registered,
    motion_errors,
    ndt_coarse_to_fine,
)
from d2d.study.point_sets.room_scans import MOTION, room_pair


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
