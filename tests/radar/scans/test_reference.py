"""The reference motion from poses, against motions that are known."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d.radar import Reference

RNG = np.random.default_rng(0)
STAMPS = 5.0 + np.sort(RNG.uniform(0.0, 3.0, 150))
TIMES = np.linspace(5.5, 7.5, 9)


def straight(t: np.ndarray) -> np.ndarray:
    """Accelerating along a fixed direction: each pose is a parabola of time."""
    s = 4e5 + 3.0 * (t - 5.0) + 0.7 * (t - 5.0) ** 2
    return np.column_stack([s * np.cos(2.0), s * np.sin(2.0), np.full_like(t, 2.0)])


def test_parabolas_are_differentiated_exactly():
    """Breaks if the fit is of lower order, sees the stamps as even, or forgets the heading."""
    reference = Reference.from_poses(STAMPS, straight(STAMPS), TIMES)
    speed = 3.0 + 1.4 * (TIMES - 5.0)
    assert_allclose(reference.theta[:, 0], speed, rtol=0, atol=1e-6)
    assert_allclose(reference.theta[:, 1:], 0.0, rtol=0, atol=1e-6)
    assert_allclose(reference.poses, straight(TIMES), rtol=1e-12)
    assert_array_equal(reference.times, TIMES)


def test_a_lateral_velocity_and_a_yaw_that_wraps():
    """Breaks if v_y has the other sign, or the yaw rate jumps at pi."""
    yaw = 3.0 + 0.5 * (STAMPS - 5.0)
    poses = np.column_stack([np.cos(2 * STAMPS), np.sin(2 * STAMPS), yaw])
    poses[:, 2] = (yaw + np.pi) % (2 * np.pi) - np.pi
    reference = Reference.from_poses(STAMPS, poses, TIMES, half_width=0.1)
    along = 2 * TIMES + np.pi / 2 - (3.0 + 0.5 * (TIMES - 5.0))  # of the velocity in the vehicle
    assert_allclose(reference.theta[:, 0], 2 * np.cos(along), rtol=0, atol=0.02)
    assert_allclose(reference.theta[:, 1], 2 * np.sin(along), rtol=0, atol=0.02)
    assert_allclose(reference.theta[:, 2], 0.5, rtol=0, atol=1e-9)


def test_it_is_nan_where_poses_are_missing():
    """Breaks if a motion is made up beyond the poses, or within a gap."""
    stamps = np.r_[np.arange(0.0, 1.0, 0.02), np.arange(2.0, 3.0, 0.02)]
    times = np.array([-0.01, 0.0, 0.5, 1.1, 1.5, 2.5, 2.98, 2.99])
    reference = Reference.from_poses(stamps, straight(stamps + 5.0), times)
    known = [False, True, True, False, False, True, True, False]
    assert_array_equal(np.isfinite(reference.theta).all(axis=1), known)
    assert_array_equal(np.isfinite(reference.poses).all(axis=1), known)
    few = Reference.from_poses(stamps[::8], straight(stamps[::8]), times)
    assert np.isnan(few.theta).all()


def test_rounding_does_not_decide_on_the_poses_in_reach():
    """Breaks if of poses at 10 Hz, five within 0.2 s, one is lost where times are rounded."""
    for origin in (0.0, 0.3, 1.6e9 + 0.7):
        stamps = origin + 0.1 * np.arange(200)
        found = Reference.from_poses(stamps, straight(stamps - origin), stamps)
        assert np.isfinite(found.theta[2:-2]).all()


def test_bad_input_is_refused_by_name():
    """Breaks if NumPy's words get through, or rows of one time are taken for those of another."""
    good = {"stamps": STAMPS, "poses": straight(STAMPS), "times": TIMES}
    for change, says in (
        ({"stamps": STAMPS[::-1]}, "stamps must be strictly increasing"),
        ({"stamps": STAMPS[:9]}, "poses must have the shape"),
        ({"stamps": np.nan * STAMPS}, "stamps must be finite"),
        ({"poses": np.zeros((150, 2))}, "poses must have the shape"),
        ({"half_width": 0.0}, "half_width must be positive"),
        ({"half_width": 200.0}, "half_width must be in seconds .* 60, but is 200; are these mill"),
    ):
        with pytest.raises(ValueError, match=says):
            Reference.from_poses(**(good | change))
    three = np.zeros((2, 3))
    for times, theta, poses, says in (
        ([np.nan], three[:1], three[:1], r"^times must be finite"),
        ([0.0, 1.0], three[:1], three, r"^theta must have the shape \(2, 3\)"),
        ([0.0, 1.0], three, three[:, :2], r"^poses must have the shape \(2, 3\)"),
    ):
        with pytest.raises(ValueError, match=says):
            Reference(times, theta, poses)
    reference = Reference([0.0, 1.0], three, three)
    for times in (1.0, [[1.0, 1.1]], [np.nan]):
        with pytest.raises(ValueError, match=r"^times must"):
            reference.at(times)
    for times in ([0.0, 2.0, 1.0], []):
        without_order = Reference(times, *np.zeros((2, len(times), 3)))
        with pytest.raises(ValueError, match=r"^the reference must have times, in order"):
            without_order.at([0.5])


def test_a_yaw_that_wraps_is_interpolated_the_short_way():
    """Breaks if a vehicle that drives west faces east half way between two poses."""
    yaw = np.array([3.1, -3.1, np.nan, -3.0, 3.12])
    poses = np.column_stack([np.zeros((5, 2)), yaw])
    found = Reference(np.arange(5.0), np.zeros((5, 3)), poses).at([0.5, 3.0, 3.5]).poses[:, 2]
    assert_allclose(found, [np.pi, 2.0 * np.pi - 3.0, 0.5 * (2.0 * np.pi + 0.12)], rtol=1e-12)
    assert_array_equal(np.isnan(poses[:, 2]), [False, False, True, False, False])


def test_at_other_times_it_is_interpolated():
    """Breaks if columns change places, or what lies outside is held instead of unknown."""
    rows = np.column_stack([TIMES, 2.0 * TIMES, -TIMES])
    wanted = np.array([5.4, 5.6, 6.9, 7.6])
    found = Reference(TIMES, rows, 3.0 * rows).at(wanted)
    expected = np.column_stack([wanted, 2.0 * wanted, -wanted])
    expected[[0, 3]] = np.nan
    assert_array_equal(found.times, wanted)
    assert_allclose(found.theta, expected, rtol=1e-12)
    assert_allclose(found.poses[:, :2], 3.0 * expected[:, :2], rtol=1e-12)


def test_a_hole_is_not_bridged():
    """Breaks if a line through a tunnel passes for a reference."""
    times = np.array([0.0, 0.5, 10.0, 10.5])
    reference = Reference(times, np.tile(times[:, None], 3), np.zeros((4, 3)))
    wanted = [0.25, 0.5, 3.0, 10.0, 10.25]
    found = reference.at(wanted)
    assert_allclose(found.theta[:, 0], [0.25, 0.5, np.nan, 10.0, 10.25])
    assert np.isnan(found.poses[2]).all()
    assert_allclose(reference.at(wanted, max_gap=9.5).theta[:, 0], wanted)
