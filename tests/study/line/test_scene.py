"""The scenes of the thesis on a line, with outliers and clusters."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import kstest

from d2d.study.line.scene import (
    FIXED_POSITIONS,
    TRUTH,
    cluster_positions,
    clustered,
    line_scene,
    with_outlier,
)


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
