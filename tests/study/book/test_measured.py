"""Intervals hold what they should as often as they say, and travel with their numbers."""

import numpy as np
import pytest

from d2d import credibility
from d2d.study.book.measured import (
    anees_of,
    geometric_mean_of,
    inclination_change,
    inclination_of,
    largest,
    mean_of,
    median_of,
    nci_of,
    quantile_of,
    rms_of,
    rms_ratio,
    share_difference,
    share_of,
    share_over,
    smallest,
)


@pytest.mark.parametrize(
    ("met", "cases", "low", "high"), [(81, 263, 0.2553, 0.3662), (0, 20, 0.0, 0.1611)]
)
def test_share_has_wilsons_interval(met, cases, low, high):
    """Breaks if it is the normal approximation: Newcombe (1998)."""
    share = share_of(np.arange(cases) < met)
    assert (share, share.low, share.high) == pytest.approx((met / cases, low, high), abs=1e-4)


def test_cases_of_a_group_count_less():
    """Breaks if starts in one room, or draws on one layout, count as independent."""
    alike = share_over([1.0, 1.0, 0.0, 1.0, 0.0, 1.0], 10)
    mixed = share_over([0.6, 0.7, 0.7, 0.6, 0.8, 0.6], 10)
    assert alike == pytest.approx(mixed)
    assert alike.high - alike.low > 2.0 * (mixed.high - mixed.low)
    assert share_over(np.ones(80), 5).low == pytest.approx(share_of(np.ones(80)).low)


@pytest.mark.parametrize(
    ("interval", "truth"),
    [
        (mean_of, 0.5),
        (lambda x: geometric_mean_of(np.exp(x)), np.exp(0.5)),
        (median_of, 0.5),
        (lambda x: median_of(x.reshape(-1, 1).repeat(3, axis=1)), 0.5),  # three of each draw
        (lambda x: quantile_of(x, 0.84134), 1.5),
        (lambda x: share_difference(x > 0.5, x > 0.5 + 0.6745), 0.25),
        (lambda x: rms_ratio(2.0 * (x[:75] - 0.5), x[75:] - 0.5), 2.0),
    ],
)
def test_interval_covers_as_often_as_it_says(interval, truth):
    """Breaks if bounds are one standard error or two intervals, or of the scatter of one value."""
    found = [
        interval(0.5 + np.random.default_rng(seed).standard_normal(150)) for seed in range(100)
    ]
    assert 0.87 <= np.mean([each.low < truth < each.high for each in found]) <= 0.99


def test_interval_of_a_root_mean_square_covers_as_often_as_it_says():
    """Breaks if it is that of the mean size: errors with a known root mean square."""
    rng = np.random.default_rng(1)
    found = [rms_of(rng.standard_normal(300)) for _ in range(200)]
    assert 0.89 < np.mean([each.low < 1.0 < each.high for each in found]) < 0.99


def test_difference_not_seen_may_still_be_there():
    """Breaks if cases that all agree, or all differ, give an interval of no width."""
    same = share_difference(np.ones(1000), np.ones(1000))
    assert same.low == pytest.approx(-same.high)
    assert 0.002 < same.high < 0.004
    few = share_difference(np.ones(10), np.ones(10))
    assert few.high == pytest.approx(1.96 * np.sqrt(2.0 / 12.0 / 12.0), abs=1e-4)
    lost = share_difference(np.zeros(1000), np.ones(1000))
    assert (lost, lost.low) == (-1.0, -1.0)
    assert -0.998 < lost.high < -0.99


def test_nci_has_the_interval_of_its_runs():
    """Breaks if it is that of another index: errors twice as large as claimed have 6 dB."""
    errors = 2.0 * np.random.default_rng(4).standard_normal((500, 2))
    covariances = np.tile(np.eye(2), (500, 1, 1))
    found = nci_of(errors, covariances)
    assert found == credibility(errors, covariances).nci
    assert 5.5 < found.low < 6.02 < found.high < 6.6


def test_interval_of_i2_allows_for_the_estimated_covariance():
    """Breaks if the actual covariance counts as known: I² of many repetitions scatters as said."""
    runs = (np.random.default_rng(seed).standard_normal((400, 3)) for seed in range(150))
    found = [inclination_of(credibility(errors, np.eye(3))) for errors in runs]
    half = np.mean([0.5 * (each.high - each.low) for each in found])
    assert half == pytest.approx(1.96 * np.std(found), rel=0.2)


def test_change_of_i2_pairs_the_runs():
    """Breaks if runs are not paired: covariances all 1.1 times as large are 0.41 dB."""
    errors = np.random.default_rng(1).standard_normal((300, 3))
    before, after = credibility(errors, np.eye(3)), credibility(errors, 1.1 * np.eye(3))
    change = inclination_change(after, before)
    assert change == pytest.approx(-10.0 * np.log10(1.1))
    assert change.high - change.low < 1e-6
    assert anees_of(before) == pytest.approx(before.anees)


def test_interval_of_the_largest_knows_of_the_picking():
    """Breaks if the largest of ten equal means is said to be larger than they are.

    The interval of the one that is picked misses it in a fifth of the cases, by chance alone.
    """
    rng = np.random.default_rng(4)
    missed = 0
    for _ in range(200):
        draws = rng.standard_normal((10, 50))
        high = largest(mean_of, *((each,) for each in draws))
        low = smallest(mean_of, *((-each,) for each in draws))
        assert high == max(map(mean_of, draws))
        assert (low, low.low, low.high) == pytest.approx((-high, -high.high, -high.low))
        missed += not high.low < 0.0 < high.high
    assert 0.0 < missed / 200 < 0.05
    once, among_four = rms_ratio(*draws[:2]), rms_ratio(*draws[:2], comparisons=4)
    assert among_four.low < once.low < once.high < among_four.high
