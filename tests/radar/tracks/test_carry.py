"""Accelerations, by which the velocities of a track are carried to their times."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from d2d.radar.tracks.carry import accelerations


def test_accelerations_are_slopes_of_half_a_second_to_either_side():
    """Breaks if the window or the least squares differ from a fit at each time."""
    rng = np.random.default_rng(0)
    times = 1.6e9 + np.sort(rng.uniform(0.0, 6.0, 60))
    theta = rng.standard_normal((60, 3))
    found = accelerations(times, theta)
    for i, t in enumerate(times):
        near = np.abs(times - t) <= 0.5
        expected = np.polyfit(times[near] - t, theta[near], 1)[0] if near.sum() > 1 else 0.0
        assert_allclose(found[i], expected, rtol=1e-4, atol=1e-4)
    assert_array_equal(accelerations(np.array([1.0, 9.0]), np.ones((2, 3))), 0.0)
    assert accelerations(np.empty(0), np.empty((0, 3))).shape == (0, 3)


def test_the_origin_of_the_clock_does_not_decide_on_accelerations():
    """Breaks if rounding decides whether estimates exactly half a second away count."""
    times = np.arange(40) * 0.1
    theta = np.random.default_rng(1).standard_normal((40, 3))
    expected = accelerations(times, theta)
    for origin in (0.3, 1.6e9 + 0.7):
        assert_allclose(accelerations(origin + times, theta), expected, rtol=1e-4, atol=1e-5)


def test_a_long_drive_at_constant_velocity_shows_no_acceleration():
    """Breaks if sums along the drive lose the digits that the slope of a few estimates needs."""
    rng = np.random.default_rng(1)
    times = np.cumsum(rng.uniform(0.2, 0.8, 40000))  # five and a half hours, many alone
    velocity = np.tile([30.0, 0.1, 0.02], (len(times), 1))
    assert_array_equal(accelerations(times, velocity), 0.0)
