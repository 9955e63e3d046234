"""The one-dimensional scene, its cost surfaces and their peaks."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.signal import find_peaks
from scipy.stats import kstest

from d2d import PointSet, RegistrationCost, UniformOutlier
from d2d.study.line.scene import FIXED_POSITIONS, SIGMA, TRUTH, line_scene
from d2d.study.line.surfaces import log_surface, peaks, target_log_surfaces
from tests.strategies import FUSIONS, METRICS

GRID = np.linspace(-4.0, 14.0, 181)
COSTS = [RegistrationCost(*pair) for pair in product(METRICS, FUSIONS)]
COSTS.append(RegistrationCost(outlier=UniformOutlier(0.01)))


def name(cost: RegistrationCost) -> str:
    """For pytest."""
    return f"{cost.metric}-{cost.fusion}{'-uniform' if cost.outlier else ''}"


@pytest.mark.parametrize("cost", COSTS, ids=name)
@pytest.mark.parametrize("draws", [(), (3,), (2, 3)], ids=str)
def test_log_surface_of_a_batch_is_that_of_each_scene_and_translation(cost, draws):
    """Breaks if the axis of the translations gets mixed up with those of the draws."""
    fixed, moving = line_scene(np.random.default_rng(1), draws=draws)
    surface = log_surface(cost, GRID, fixed, moving)
    assert surface.shape == (*draws, len(GRID))
    for index in np.ndindex(draws):
        a, b = (fixed[index], moving[index]) if draws else (fixed, moving)
        for t in (0, 60, 61, 180):
            alone = -cost.value([GRID[t]], a, b)
            assert surface[(*index, t)] == pytest.approx(alone, rel=1e-13)


def test_log_surface_has_a_batch_axis_as_long_as_the_grid():
    """Breaks if equal lengths let the two axes broadcast against each other."""
    fixed, moving = line_scene(np.random.default_rng(2), draws=(5,))
    surface = log_surface(RegistrationCost(), GRID[:5], fixed, moving)
    one_by_one = [log_surface(RegistrationCost(), GRID[i : i + 1], fixed, moving) for i in range(5)]
    assert_allclose(surface, np.concatenate(one_by_one, axis=1), rtol=1e-13)


@pytest.mark.parametrize("cost", COSTS, ids=name)
def test_target_surfaces_are_those_of_each_target_alone(cost):
    """Breaks if targets are fused, or change places."""
    fixed, moving = line_scene(np.random.default_rng(3))
    surfaces = target_log_surfaces(cost, GRID, fixed, moving)
    assert surfaces.shape == (3, len(GRID))
    densities = cost.target_densities(GRID[:, None], fixed, moving)
    assert_allclose(np.exp(surfaces), densities.T, rtol=1e-12)
    for k in range(3):
        alone = PointSet(moving.means[k : k + 1], moving.covariances[k : k + 1])
        assert surfaces[k, 70] == pytest.approx(float(-cost.value([GRID[70]], fixed, alone)))


@pytest.mark.parametrize("fusion", FUSIONS)
def test_target_surfaces_fuse_to_the_whole(fusion):
    """Breaks if a target's surface is not the factor, or the term, that the fusion takes."""
    cost = RegistrationCost(fusion=fusion)
    fixed, moving = line_scene(np.random.default_rng(4))
    parts = target_log_surfaces(cost, GRID, fixed, moving)
    fused = parts.sum(axis=0) if fusion == "likelihood" else np.logaddexp.reduce(parts, axis=0)
    assert_allclose(log_surface(cost, GRID, fixed, moving), fused, rtol=1e-12, atol=1e-12)


def test_peaks_of_a_known_function():
    """Breaks if peaks are not sorted by height, or heights not relative to the highest."""
    x = np.linspace(0.0, 10.0, 2001)
    centers, heights = [2.0, 5.0, 8.5], [1.0, 4.0, 2.0]
    surface = sum(
        h * np.exp(-0.5 * ((x - c) / 0.3) ** 2) for c, h in zip(centers, heights, strict=True)
    )
    found = peaks(x, np.log(surface))
    assert_allclose(found.positions, [5.0, 8.5, 2.0], atol=0.005)
    assert_allclose(np.exp(found.log_heights), [1.0, 0.5, 0.25], rtol=1e-3)


def test_peaks_of_a_surface_without_any():
    """Breaks if an edge counts for a peak, or no peak is an error."""
    found = peaks(np.arange(5.0), np.arange(5.0))
    assert found.positions.shape == found.log_heights.shape == (0,)


def test_the_highest_peak_is_kept_on_a_plateau():
    """Breaks if a flat top, two equal samples either side of the maximum, is no peak."""
    found = peaks(np.arange(6.0), np.array([0.0, 3.0, 3.0, 0.0, 1.0, 0.0]))
    assert found.positions[0] in (1.0, 2.0)
    assert_array_equal(found.log_heights, [0.0, -2.0])


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


@pytest.mark.parametrize("levels", [2, 3, 5])
def test_peaks_of_a_batch_are_those_of_each_surface_plateaus_included(levels):
    """Breaks if a plateau is lost, counted twice or placed elsewhere, or if rows are mixed up."""
    rng = np.random.default_rng(10 + levels)
    grid, rows = np.linspace(0.0, 1.0, 30), rng.integers(levels, size=(400, 30)).astype(float)
    rows[:3] = np.outer([0.0, 1.0, -1.0], np.arange(30.0))  # without any peak
    assert_peaks_of_each_row(peaks(grid, rows), grid, rows)
    folded = peaks(grid, rows.reshape(20, 20, 30))
    assert_array_equal(folded.positions, peaks(grid, rows).positions.reshape(20, 20, -1))


@pytest.mark.parametrize("cost", COSTS, ids=name)
def test_peaks_of_a_batch_of_cost_surfaces(cost):
    """Breaks if the real surfaces, level where only a uniform component is left, are special."""
    rows = log_surface(cost, GRID, *line_scene(np.random.default_rng(14), draws=(50,)))
    assert_peaks_of_each_row(peaks(GRID, rows), GRID, rows)


def test_the_second_peak_of_a_batch():
    """Breaks if a surface with fewer peaks than others shows the padding."""
    rows = np.array([[0.0, 5.0, 0.0, 3.0, 0.0], [0.0, 0.0, 2.0, 0.0, 0.0], [0.0] * 5])
    found = peaks(np.arange(5.0), rows)
    assert_array_equal(found.number, [2, 1, 0])
    assert_array_equal(found.second_log_height, [-2.0, -np.inf, -np.inf])
    assert peaks(np.arange(5.0), rows[1]).second_log_height == -np.inf
    assert peaks(np.arange(5.0), rows[:0]).number.shape == (0,)


@pytest.mark.parametrize(("sigma_fixed", "sigma_moving"), [(SIGMA, SIGMA), (0.1, 0.6)])
def test_line_scene_is_the_targets_with_their_noise(sigma_fixed, sigma_moving):
    """Breaks if the sets move the wrong way, share their noise, or claim another sigma."""
    runs = 2000
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


def test_line_scene_is_that_of_the_thesis():
    """Breaks if B no longer meets the components of F at 2, 10 and 12.2 m."""
    fixed, moving = line_scene(np.random.default_rng(6), sigma_fixed=1e-9, sigma_moving=1e-9)
    expected = [2.0, 10.0, 12.2]
    assert_allclose(fixed.means[:, 0] - moving.means[0, 0], expected, atol=1e-7)
    assert (TRUTH, SIGMA, fixed.size, fixed.dimension) == (2.0, 0.15, 3, 1)


def test_line_scene_takes_other_positions_and_repeats_with_the_seed():
    """Breaks if the layout is not a parameter, or noise is not the generator's."""
    again = [line_scene(np.random.default_rng(7), positions=[0.0, 3.0])[1] for _ in range(2)]
    assert again[0].size == 2
    assert_array_equal(again[0].means, again[1].means)
    assert fixed_means(8) != fixed_means(9)


def fixed_means(seed: int) -> list[float]:
    """Of one draw."""
    return line_scene(np.random.default_rng(seed))[0].means.ravel().tolist()
