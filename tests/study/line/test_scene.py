"""The one-dimensional scene of the thesis."""

import numpy as np
from numpy.testing import assert_allclose
from scipy.stats import kstest

from d2d.study.line.scene import FIXED_POSITIONS, TRUTH, line_scene


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
