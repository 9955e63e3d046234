"""What no vehicle does, and by how much an estimate may exceed it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d.radar import VehicleLimits
from d2d.radar.tracks.limits import State


def test_limits_count_beyond_three_standard_deviations():
    """Breaks if a limit is compared with another quantity, or without the uncertainty of both."""
    last = State(1.0, np.array([20.0, 0.0, 0.0]), 0.1**2 * np.eye(3))
    for theta, sigma, reason in (
        ([20.0, 0.0, 0.1], 0.1, ""),
        ([101.0, 0.0, 0.0], 0.1, "a speed of 101.0 m/s"),
        ([101.0, 0.0, 0.0], 0.39, "an acceleration of 810.0 m/s^2 along x"),
        ([20.0, 0.0, 0.0], 0.41, "a velocity with a sigma of 0.4 m/s"),
        ([20.0, 0.0, -3.5], 0.1, "a yaw rate of 200.5 deg/s"),
        ([26.0, 0.0, 0.0], 0.1, "an acceleration of 60.0 m/s^2 along x"),
        ([21.4, 0.0, 0.0], 0.1, ""),
        ([21.55, 0.0, 0.0], 0.1, ""),
        ([21.7, 0.0, 0.0], 0.1, "an acceleration of 17.0 m/s^2 along x"),
        ([20.0, 0.0, 1.2], 0.1, "a yaw acceleration of 12.0 rad/s^2"),
    ):
        state = State(1.1, np.array(theta), sigma**2 * np.eye(3))
        assert VehicleLimits(uncertainty=np.inf).exceeded(state, last) == reason


def test_time_does_not_make_everything_plausible():
    """Breaks if estimates that fail for a while make any jump possible, or lose the drive."""
    last = State(1.0, np.array([20.0, 0.0, 0.0]), 0.01**2 * np.eye(3))
    limits, possible = VehicleLimits(), []
    for passed in (0.1, 0.5, 2.0, 8.0):
        changes = np.arange(0.0, 60.0, 0.1)
        states = [
            State(1.0 + passed, [20.0 - c, 0.0, 0.0] * np.ones(3), last.covariance) for c in changes
        ]
        possible.append(changes[[limits.exceeded(state, last) == "" for state in states]].max())
    assert_allclose(possible, [1.2, 6.0, 12.0, 24.0], atol=0.11)


def test_a_side_slip_counts_where_it_may_be_a_yaw_rate():
    """Breaks if a slip that is measured is refused, or one that is not is accepted."""
    theta = np.array([20.0, 1.1, -0.3])
    apart = np.diag([0.1, 0.3, 0.1]) ** 2
    torn = apart.copy()
    torn[1, 2] = torn[2, 1] = -0.95 * 0.3 * 0.1
    assert VehicleLimits().exceeded(State(0.0, theta, apart), None) == ""
    assert VehicleLimits().exceeded(State(0.0, theta, torn), None) == "a side slip of 1.10 m/s"
    assert VehicleLimits(yaw_rate_of_slip=0.4).exceeded(State(0.0, theta, torn), None) == ""
    vague = State(0.0, np.array([20.0, 0.0, 0.0]), np.diag([0.1, 0.1, 0.2]) ** 2)
    assert VehicleLimits().exceeded(vague, None) == "a yaw rate with a sigma of 11.5 deg/s"


def test_a_limit_is_a_positive_number():
    """Breaks if a limit that is no limit accepts or refuses everything, or can be changed later."""
    for value in (0.0, -1.0, np.nan, "fast", np.ones(3)):
        with pytest.raises(ValueError, match=r"^speed must"):
            VehicleLimits(speed=value)
    assert VehicleLimits(speed=np.inf).speed == np.inf
    speed = np.array(30.0)
    limits = VehicleLimits(speed=speed)
    speed[...] = 1e9
    assert limits == VehicleLimits(speed=30.0)
