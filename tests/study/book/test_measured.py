"""Intervals hold what they should as often as they say, and travel with their numbers."""

import copy
import pickle

import numpy as np
import pytest

from d2d import credibility
from d2d.study.book.measured import (
    Measured,
    anees_of,
    bootstrapped,
    geometric_mean_of,
    inclination_change,
    inclination_of,
    mean_of,
    quantile_of,
    rms_ratio,
    share_in_series,
    share_of,
    share_over,
)


def test_a_measured_number_counts_as_a_number_and_keeps_its_bounds() -> None:
    """Breaks if formatting, comparison or a copy loses the value or the interval."""
    ratio = Measured(1.234, 1.1, 1.4)
    assert f"{ratio:.1f}" == "1.2"
    assert ratio == 1.234
    assert ratio.between(".2f") == "1.10 to 1.40"
    shifted = ratio.plus(-1.0)
    assert (shifted.low, shifted.high) == pytest.approx((0.1, 0.4))
    for again in (copy.deepcopy(ratio), pickle.loads(pickle.dumps(ratio))):
        assert (again, again.low, again.high) == (1.234, 1.1, 1.4)


def test_wilsons_interval_is_the_published_one() -> None:
    """Breaks if it is the normal approximation: Newcombe (1998), 81 of 263 and 0 of 20."""
    share = share_of(np.arange(263) < 81)
    assert (share.low, share.high) == pytest.approx((0.2553, 0.3662), abs=1e-4)
    none = share_of(np.zeros(20))
    assert (none, none.low, none.high) == pytest.approx((0.0, 0.0, 0.1611), abs=1e-4)


def test_cases_of_a_group_that_go_together_count_less() -> None:
    """Breaks if starts in one room, or draws on one layout, count as independent."""
    alike = share_over([1.0, 1.0, 0.0, 1.0, 0.0, 1.0], 10)
    mixed = share_over([0.6, 0.7, 0.7, 0.6, 0.8, 0.6], 10)
    assert alike == pytest.approx(mixed)
    assert alike.high - alike.low > 2.0 * (mixed.high - mixed.low)
    assert share_over(np.ones(80), 5).low == pytest.approx(share_of(np.ones(80)).low)
    series = np.repeat(np.arange(100) % 2, 10)
    assert share_in_series(series, 10).low == pytest.approx(share_of(np.arange(100) % 2).low)


@pytest.mark.parametrize(
    ("interval", "truth"),
    [
        (mean_of, 0.5),
        (lambda x: geometric_mean_of(np.exp(x)), np.exp(0.5)),
        (lambda x: bootstrapped(np.median, x), 0.5),
        (lambda x: quantile_of(x, 0.5), 0.5),
        (lambda x: rms_ratio(2.0 * (x[:75] - 0.5), x[75:] - 0.5), 2.0),
    ],
)
def test_an_interval_holds_the_truth_about_as_often_as_it_says(interval, truth) -> None:
    """Breaks if bounds are one standard error, or of the scatter instead of the mean."""
    held = []
    for seed in range(100):
        x = 0.5 + np.random.default_rng(seed).standard_normal(150)
        found = interval(x)
        held.append(found.low < truth < found.high)
    assert 0.87 <= np.mean(held) <= 1.0


def test_the_interval_of_i2_allows_for_the_covariance_estimated_from_the_same_runs() -> None:
    """Breaks if the actual covariance counts as known: I2 of many repetitions scatters as said."""
    found, half = [], []
    for seed in range(150):
        errors = np.random.default_rng(seed).standard_normal((400, 3))
        each = inclination_of(credibility(errors, np.eye(3)))
        found.append(each)
        half.append(0.5 * (each.high - each.low))
    assert np.mean(half) == pytest.approx(1.96 * np.std(found), rel=0.2)


def test_a_change_of_i2_of_the_same_runs_is_known_better_than_either() -> None:
    """Breaks if runs are not paired: covariances all 1.1 times as large are 0.41 dB."""
    errors = np.random.default_rng(1).standard_normal((300, 3))
    before, after = credibility(errors, np.eye(3)), credibility(errors, 1.1 * np.eye(3))
    change = inclination_change(after, before)
    assert change == pytest.approx(-10.0 * np.log10(1.1))
    assert change.high - change.low < 1e-6
    assert anees_of(before) == pytest.approx(before.anees)
