"""The experiments on what makes errors on the road too large, on errors that are made here."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d.radar import Comparison, Track
from d2d.study.road.suspects import (
    beside_changed_reference,
    parts,
    without_slow_part,
)

SIGMA = np.array([0.02, 0.1, 0.02])


def comparison(slow: float = 0.0, count: int = 2000) -> Comparison:
    """Independent errors of the stated size, ten a second, and a slow one in v_x beside them."""
    times = 0.1 * np.arange(count)
    errors = SIGMA * np.random.default_rng(0).standard_normal((count, 3))
    errors[:, 0] += slow * np.sin(2.0 * np.pi * times / 30.0)
    return Comparison(times, errors, np.tile(np.diag(SIGMA**2), (count, 1, 1)), 1.0, 1.0)


def test_a_slow_error_is_taken_off_and_noise_is_left():
    """Breaks if the window is not centred, or of another length: noise loses 1 part in 11."""
    drifting = comparison(slow=0.1)
    assert parts(drifting)["whitened"][0] > 10.0
    left = parts(without_slow_part(drifting, 1.0))["whitened"]
    assert_allclose(left, 10.0 / 11.0, atol=0.12)


def test_a_changed_reference_is_later_and_faster():
    """Breaks if the lag has the other sign or the factor is that of another component."""
    times = 0.1 * np.arange(50)
    theta = np.column_stack([10.0 + 2.0 * times, 0.1 * times, 0.3 * times])
    covariance = np.tile(np.diag(SIGMA**2), (50, 1, 1))
    driven = Track(times, np.full(50, 0.1), theta, covariance, np.ones(50, dtype=bool))
    errors = np.zeros((50, 3))
    errors[:3] = np.nan
    found = beside_changed_reference(driven, errors, lag=0.05, speed=0.01)
    assert found.times[0] == pytest.approx(0.4)
    earlier = theta[4:] - 0.05 * np.array([2.0, 0.1, 0.3])
    assert_allclose(found.errors, theta[4:] - earlier * [1.01, 1.0, 1.0])
    same = beside_changed_reference(driven, errors)
    assert_allclose(same.errors, 0.0, atol=1e-12)
