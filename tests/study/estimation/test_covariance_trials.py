"""What the covariances claim, against what is known of it."""

from __future__ import annotations

import pytest

from d2d.study.estimation import covariance_trials


def test_sums_of_many_equal_targets_approach_the_limits_of_chapter_5():
    """Breaks if the simulated sum is not at its optimum, or a covariance is another one."""
    sums = covariance_trials.equal_targets(128, runs=3000)
    assert sums.actual == pytest.approx(16 / 9, rel=0.06)  # a variance of 6000 values: 2 %
    assert sums.fisher == pytest.approx(2 * 128, rel=0.02)
    assert sums.propagated == pytest.approx(112 / 27, rel=0.03)
