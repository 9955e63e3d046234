"""The line scenes with outliers and clusters, and the measures of their surfaces."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d import RegistrationCost
from d2d.study.line.disturbed_scenes import cluster_positions, clustered, with_outlier
from d2d.study.line.scene import FIXED_POSITIONS, TRUTH, line_scene
from d2d.study.line.surfaces import basin_of_attraction, log_surface, peaks, survey

GRID = np.linspace(-10.0, 10.0, 2001)


def test_the_outlier_is_in_one_set_only_and_the_rest_is_the_scene():
    """Breaks if paired comparisons with and without an outlier have different noise."""
    plain = line_scene(np.random.default_rng(1), draws=(50,))
    for where, with_it in (("fixed", 0), ("moving", 1)):
        sets = with_outlier(np.random.default_rng(1), where, draws=(50,))
        assert [points.size for points in sets] == [3 + (with_it == 0), 3 + (with_it == 1)]
        for points, alone in zip(sets, plain, strict=True):
            assert_array_equal(points.means[:, :3], alone.means)


def test_the_outlier_stands_where_it_is_put():
    """Breaks if a position counts in the other set's frame."""
    for where, with_it in (("fixed", 0), ("moving", 1)):
        sets = with_outlier(np.random.default_rng(2), where, at=4.0, draws=(4000,))
        assert_allclose(sets[with_it].means[:, 3].mean(), 4.0, atol=0.01)
        assert_allclose(sets[with_it].means[:, 3].std(), 0.15, rtol=0.05)


def test_a_cluster_grows_around_a():
    """Breaks if the spacing is not that of the neighbours, or the motion is not the same."""
    assert_allclose(cluster_positions(0.5), [*FIXED_POSITIONS, 7.5, 8.5])
    fixed, moving = clustered(np.random.default_rng(3), 0.5, (4000,))
    assert_allclose((fixed.means - moving.means).mean(axis=0), TRUTH, atol=0.02)


def test_a_basin_reaches_from_valley_to_valley():
    """Breaks if an edge is missed: cos has maxima at 0 and 2 pi, and minima half way."""
    top, left, right = basin_of_attraction(GRID, np.cos(GRID), 1.0)
    assert_allclose([top, left, right], [0.0, -np.pi, np.pi], atol=0.011)
    top, left, right = basin_of_attraction(GRID, np.cos(GRID), 4.0)
    assert_allclose([top, left, right], [2 * np.pi, np.pi, 3 * np.pi], atol=0.011)


def test_a_basin_without_a_valley_is_the_whole_axis():
    """Breaks at the ends of the grid."""
    assert basin_of_attraction(GRID, -(GRID**2), 7.0) == (pytest.approx(0.0, abs=1e-9), -10.0, 10.0)
    assert basin_of_attraction(GRID, GRID, 0.0) == (10.0, -10.0, 10.0)
    assert basin_of_attraction(GRID, -GRID, 0.0) == (-10.0, -10.0, 10.0)


def walked_basin(values, start):
    """Sample by sample: up from a start to the top, and from there down on either side."""
    top = start
    while top + 1 < len(values) and values[top + 1] > values[top]:
        top += 1
    while top > 0 and values[top - 1] >= values[top]:
        top -= 1
    left = right = top
    while left > 0 and values[left - 1] < values[left]:
        left -= 1
    while right + 1 < len(values) and values[right + 1] <= values[right]:
        right += 1
    return top, left, right


def test_basins_of_a_batch_are_those_of_each_surface():
    """Breaks if a level stretch, or one row's basin, leads elsewhere in a batch."""
    rows = np.random.default_rng(5).integers(4, size=(500, 15)).astype(float)
    grid = np.arange(15.0)
    for start in (0, 6, 14):
        found = np.stack(basin_of_attraction(grid, rows, float(start)), axis=-1)
        assert_array_equal(found, [walked_basin(row, start) for row in rows])


def test_a_survey_counts_what_one_sees():
    """Breaks if the rival is taken from the wrong peak, or the share from the wrong place."""
    two = np.log(np.exp(-0.5 * GRID**2) + 0.25 * np.exp(-0.5 * (GRID - 6.0) ** 2))
    one = -0.5 * (GRID - 3.0) ** 2
    found = survey(GRID, np.stack([two, one]), 0.0)
    assert_array_equal(found.optima, [2, 1])
    assert_allclose(found.rival, [0.25, 0.0], rtol=1e-3)
    assert_allclose(found.ascent, [0.0, 3.0], atol=0.011)
    assert found.right(0.0, 1.0) == 0.5
    assert_allclose(found.basin_width[1], 20.0)


def test_without_noise_neighbours_part_at_two_root_two_sigma():
    """Breaks if the sum's bumps do not part where two equal Gaussians do."""
    sigma, cost = 0.15, RegistrationCost(fusion="summing")
    window = np.arange(-1.0, 1.0, 0.001)
    for spacing, expected in ((2.7, 1), (2.95, 2)):
        fixed, moving = line_scene(np.random.default_rng(4), positions=[0.0, spacing * sigma])
        fixed = type(fixed)([[0.0], [spacing * sigma]], fixed.covariances)
        moving = type(moving)([[0.0]], moving.covariances[:1])
        found = peaks(window, log_surface(cost, window, fixed, moving))
        assert len(found.positions) == expected
