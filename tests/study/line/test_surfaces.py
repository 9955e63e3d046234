"""Scenes on a line, their cost surfaces, peaks and basins of attraction."""

from itertools import product

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal
from scipy.signal import find_peaks
from scipy.stats import kstest

from d2d import RegistrationCost, UniformOutlier
from d2d.study.line import outlier_study
from d2d.study.line.scene import (
    CORRUPTED,
    FIXED_POSITIONS,
    TRUTH,
    cluster_positions,
    clustered,
    line_scene,
    with_outlier,
)
from d2d.study.line.surfaces import (
    basin_of_attraction,
    log_surface,
    peaks,
    survey,
    target_log_surfaces,
)
from tests.strategies import FUSIONS, METRICS


def test_line_scene_is_the_targets_with_their_noise():
    """Breaks if the sets move the wrong way, share their noise, or claim another sigma."""
    runs, sigma_fixed, sigma_moving = 2000, 0.1, 0.6
    fixed, moving = line_scene(
        np.random.default_rng(5), sigma_fixed=sigma_fixed, sigma_moving=sigma_moving, draws=(runs,)
    )
    assert fixed.means.shape == moving.means.shape == (runs, 3, 1)
    z_fixed = (fixed.means[..., 0] - FIXED_POSITIONS) / sigma_fixed
    z_moving = (moving.means[..., 0] + TRUTH - FIXED_POSITIONS) / sigma_moving
    for z in (z_fixed, z_moving):
        assert kstest(z.ravel(), "norm").pvalue > 0.01
    noise = np.corrcoef(np.hstack([z_fixed, z_moving]).T)
    assert np.abs(noise - np.eye(6)).max() < 4.0 / np.sqrt(runs)
    assert_allclose(fixed.covariances, sigma_fixed**2)
    assert_allclose(moving.covariances, sigma_moving**2)


def test_the_outlier_is_in_one_set_only_and_the_rest_is_the_scene():
    """Breaks if paired comparisons with and without an outlier have different noise."""
    plain = line_scene(np.random.default_rng(1), draws=(50,))
    for where, with_it in (("fixed", 0), ("moving", 1)):
        sets = with_outlier(np.random.default_rng(1), where, draws=(50,))
        assert [points.size for points in sets] == [3 + (with_it == 0), 3 + (with_it == 1)]
        for points, alone in zip(sets, plain, strict=True):
            assert_array_equal(points.means[:, :3], alone.means)


def test_a_cluster_grows_around_a():
    """Breaks if the spacing is not that of the neighbours, or the motion is not the same."""
    assert_allclose(cluster_positions(0.5), [*FIXED_POSITIONS, 7.5, 8.5])
    fixed, moving = clustered(np.random.default_rng(3), 0.5, (4000,))
    assert_allclose((fixed.means - moving.means).mean(axis=0), TRUTH, atol=0.02)


GRID = np.linspace(-4.0, 14.0, 181)
WIDE = np.linspace(-10.0, 10.0, 2001)
COSTS = [RegistrationCost(*pair) for pair in product(METRICS, FUSIONS)]
COSTS += [RegistrationCost(outlier=each) for each in (UniformOutlier(0.01), CORRUPTED)]


def test_log_surface_of_a_batch_is_that_of_each_scene_and_translation():
    """Breaks if the axis of the translations gets mixed up with those of the draws."""
    some = GRID[[0, 60, 61, 100, 180]]
    for cost, draws in product(COSTS, [(), (3,), (2, 3), (len(some),)]):
        fixed, moving = line_scene(np.random.default_rng(1), draws=draws)
        surface = log_surface(cost, some, fixed, moving)
        assert surface.shape == (*draws, len(some))
        for index in np.ndindex(draws):
            a, b = (fixed[index], moving[index]) if draws else (fixed, moving)
            alone = [-cost.value([t], a, b) for t in some]
            assert_allclose(surface[index], alone, rtol=1e-13)


def test_target_surfaces_are_those_of_each_target_alone():
    """Breaks if targets are fused, or change places."""
    fixed, moving = line_scene(np.random.default_rng(3))
    for cost in COSTS:
        densities = cost.target_densities(GRID[:, None], fixed, moving)
        surfaces = target_log_surfaces(cost, GRID, fixed, moving)
        assert_allclose(np.exp(surfaces), densities.T, rtol=1e-12)


def assert_peaks_of_each_row(found, grid, rows):
    """The peaks of every row are those that scipy finds in it, the highest first."""
    assert found.positions.shape == found.log_heights.shape
    for i, row in enumerate(rows):
        index, _ = find_peaks(row)
        index = index[np.argsort(-row[index], kind="stable")]
        assert found.number[i] == len(index)
        assert_array_equal(found.positions[i, : len(index)], grid[index])
        assert_array_equal(found.log_heights[i, : len(index)], row[index] - row[index[:1]])
        assert np.isnan(found.positions[i, len(index) :]).all()
        assert np.isneginf(found.log_heights[i, len(index) :]).all()


def test_peaks_of_a_batch_are_those_of_each_surface_plateaus_included():
    """Breaks if a plateau is lost, counted twice or placed elsewhere, or if rows are mixed up."""
    rng, grid = np.random.default_rng(10), np.linspace(0.0, 1.0, 30)
    for levels in (2, 3, 5):
        rows = rng.integers(levels, size=(400, 30)).astype(float)
        rows[:3] = np.outer([0.0, 1.0, -1.0], np.arange(30.0))  # without any peak
        assert_peaks_of_each_row(peaks(grid, rows), grid, rows)
    folded = peaks(grid, rows.reshape(20, 20, 30))
    assert_array_equal(folded.positions, peaks(grid, rows).positions.reshape(20, 20, -1))
    for cost in COSTS:  # real surfaces, level where only a uniform component is left
        rows = log_surface(cost, GRID, *line_scene(rng, draws=(50,)))
        assert_peaks_of_each_row(peaks(GRID, rows), GRID, rows)


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
    two = np.log(np.exp(-0.5 * WIDE**2) + 0.25 * np.exp(-0.5 * (WIDE - 6.0) ** 2))
    one = -0.5 * (WIDE - 3.0) ** 2
    found = survey(WIDE, np.stack([two, one]), 0.0)
    assert_array_equal(found.optima, [2, 1])
    assert_allclose(found.rival, [0.25, 0.0], rtol=1e-3)
    assert_allclose(found.ascent, [0.0, 3.0], atol=0.011)
    assert_array_equal(found.right(0.0, 1.0), [True, False])
    assert_allclose(found.basin_width[1], 20.0)


def test_an_optimum_is_right_up_to_half_way_to_the_next_meeting_of_targets():
    """Breaks if an alignment of other targets may count as the true one."""
    meetings = np.abs(FIXED_POSITIONS[:, None] - FIXED_POSITIONS)
    assert_allclose(outlier_study.RIGHT, 0.5 * meetings[meetings > 0.0].min())


def test_the_map_of_outlier_models_has_a_row_for_each_fraction(monkeypatch):
    """Breaks if a fraction is shown at a width, or one measure as another."""
    monkeypatch.setattr(outlier_study, "FRACTIONS", (0.2, 0.9))
    monkeypatch.setattr(outlier_study, "WIDTHS", (0.3, 3.0, 10.0))
    monkeypatch.setattr(outlier_study, "MAP_DRAWS", 20)
    right, comparable, basin = outlier_study.outlier_map.__wrapped__()
    found = outlier_study.survey_corrupted(0.9, 3.0, 20)
    assert right.shape == comparable.shape == basin.shape == (2, 3)
    assert right[1, 1] == np.mean(np.abs(found.highest - TRUTH) < outlier_study.RIGHT)
    assert comparable[1, 1] == np.mean(found.rival > outlier_study.COMPARABLE)
    assert basin[1, 1] == np.median(found.basin_width)
