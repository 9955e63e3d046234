"""The block bootstrap, against independent draws of whole series."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal
from scipy.signal import lfilter

from d2d import block_bootstrap, block_length
from d2d.bootstrap import block_sums


def autoregression(rng: np.random.Generator, coefficient: float, shape) -> np.ndarray:
    """Stationary first-order autoregressions along the last axis, with variance 1."""
    noise = rng.standard_normal(shape) * np.sqrt(1.0 - coefficient**2)
    noise[..., 0] /= np.sqrt(1.0 - coefficient**2)
    return lfilter([1.0], [1.0, -coefficient], noise, axis=-1)


def covered(block: int | None, series: np.ndarray, rng: np.random.Generator) -> float:
    """Share of the series whose interval for the mean contains the true mean, zero."""
    inside = []
    for one in series:
        length = block_length(one) if block is None else block
        low, high = block_bootstrap(np.mean, [one], length, rng, resamples=300, vectorized=True)
        inside.append(low <= 0.0 <= high)
    return float(np.mean(inside))


def test_intervals_of_a_correlated_mean_contain_it_as_often_as_they_should():
    """Breaks if blocks are torn apart: with single rows, the same share is below two thirds."""
    rng = np.random.default_rng(0)
    series = autoregression(rng, 0.8, (300, 600))
    # the percentiles of some twenty blocks are a little too narrow
    assert 0.87 <= covered(None, series, rng) <= 0.98
    assert covered(1, series, rng) < 0.65


def test_intervals_of_independent_rows_are_those_of_the_normal_distribution():
    """Breaks if the confidence is of one tail, or the lengths do not add up to N."""
    rng = np.random.default_rng(1)
    series = rng.standard_normal(2000)
    for block in (1, 7):
        for confidence, quantile in ((0.95, 1.96), (0.5, 0.674)):
            low, high = block_bootstrap(
                np.mean, [series], block, rng, confidence=confidence, resamples=2000
            )
            assert_allclose(high - low, 2.0 * quantile / np.sqrt(2000), rtol=0.15)
            assert low < series.mean() < high


def test_the_same_rows_are_drawn_from_all_arrays_in_whole_blocks_on_a_ring():
    """Breaks if arrays are drawn apart, or the first and last rows are drawn less often."""
    rows = np.arange(10)
    drawn = []

    def statistic(one, two):
        assert_array_equal(one, two[:, 0])
        drawn.append(one)
        return two.mean(axis=0)

    rng = np.random.default_rng(2)
    bounds = block_bootstrap(
        statistic, (rows, np.stack([rows, -rows], axis=1)), 5, rng, resamples=4000
    )
    assert bounds.shape == (2, 2)
    assert_array_equal(bounds[0], -bounds[1, ::-1])
    whole = np.array(drawn).reshape(-1, 5)
    assert ((np.diff(whole, axis=1) % 10) == 1).all()
    often = np.bincount(whole.ravel(), minlength=10)
    assert_allclose(often / often.mean(), 1.0, atol=0.05)


def test_many_data_sets_in_one_call_give_the_interval_of_each_alone():
    """Breaks if others are drawn, the last ones are forgotten, or the draw is not the seed's."""
    rng = np.random.default_rng(3)
    arrays = rng.standard_normal((5000, 3)), rng.standard_normal(5000)

    def statistic(a, b, axis=0):
        return a.mean(axis).sum(axis=-1) - np.median(b, axis)

    for block in (1, 4):
        given = statistic, arrays, block
        alone, at_once = (
            block_bootstrap(*given, np.random.default_rng(5), resamples=101, vectorized=by)
            for by in (False, True)
        )
        assert_allclose(at_once, alone, rtol=1e-12)


def test_block_sums_have_the_variance_of_the_drawn_sums():
    """Breaks if the last rows are not joined to the first, or a sum is of one row too many."""
    rng = np.random.default_rng(8)
    series = autoregression(rng, 0.7, 60)
    series -= series.mean()
    for block in (1, 4, 7, 12):
        ring = np.tile(series, 2)
        sums = block_sums(series, block)
        assert_allclose(sums, [ring[i : i + block].sum() for i in range(60)], atol=1e-12)
        drawn: list[np.ndarray] = []

        def kept(one, drawn=drawn):
            drawn.append(one)
            return 0.0

        block_bootstrap(kept, [series], block, rng, resamples=4000)
        assert {len(one) for one in drawn} == {60}  # blocks that do not fill the series are cut
        spread = np.var([one.sum() for one in drawn])
        assert_allclose(spread, (sums**2).sum() / block, rtol=0.1)
    both = np.column_stack([series, -series])
    assert_array_equal(block_sums(both, 5)[:, 0], block_sums(series, 5))


def test_block_length_of_an_autoregression():
    """Breaks if a factor of the rule, or its corrected constant, is off."""
    for coefficient in (0.5, 0.8, 0.95, -0.5):
        series = autoregression(np.random.default_rng(5), coefficient, 200_000)
        ideal = (1.5 * 200_000) ** (1 / 3) * abs(2 * coefficient / (1 - coefficient**2)) ** (2 / 3)
        assert_allclose(block_length(series), ideal, rtol=0.2)


def test_block_length_without_correlation_is_short():
    """Breaks if chance correlations of white noise are taken for real."""
    rng = np.random.default_rng(6)
    lengths = [block_length(rng.standard_normal(500)) for _ in range(50)]
    assert np.median(lengths) == 1


def test_block_length_sees_a_slow_part_behind_noise():
    """Breaks if correlations of 0.14 count as chance in 2000 rows: they sum up to a long block."""
    lengths = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        slow = autoregression(rng, 0.95, 2000)
        lengths.append(block_length(0.4 * slow / slow.std() + rng.standard_normal(2000)))
    assert np.median(lengths) > 20


def test_the_slowest_column_counts_and_a_trend_is_bounded():
    """Breaks if columns are averaged, or one block holds the whole series."""
    rng = np.random.default_rng(7)
    slow = autoregression(rng, 0.9, 2000)
    both = np.column_stack([rng.standard_normal(2000), slow])
    assert block_length(both) == block_length(slow) > 10
    assert block_length(np.arange(400.0)) <= 60
    assert block_length(np.arange(30.0)) <= 10
    for constant in ([1.0], [1.0, 1.0], np.ones(50)):
        assert block_length(constant) == 1
