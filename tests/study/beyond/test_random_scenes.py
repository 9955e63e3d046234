"""Scenes that are drawn anew in every run."""

import numpy as np
import pytest

from d2d import rigid
from d2d.study.beyond.random_scenes import RandomScenes

NOISE_FREE = {"sigma_range": 1e-6, "sigma_azimuth": 1e-7}


def test_as_many_targets_are_shared_as_it_says() -> None:
    """Breaks if an outlier is seen in both scans, or a shared target in one only."""
    for size, outliers, overlap, shared in (
        (20, 0.2, 1.0, 16),
        (20, 0.0, 0.6, 12),
        (10, 0.3, 0.8, 5),
    ):
        scene = RandomScenes(size=size, outlier_share=outliers, overlap=overlap, **NOISE_FREE)
        fixed, moving = scene.sample(50, np.random.default_rng(0))
        back = rigid.transform_means(scene.theta, moving.means)
        apart = np.linalg.norm(back[:, :, None] - fixed.means[:, None], axis=-1)
        assert fixed.size == moving.size == size
        assert scene.shared == shared
        assert ((apart < 1e-3).sum(axis=(1, 2)) == shared).all()
        # no two different targets are nearer than the spacing
        assert apart[apart > 1e-3].min() > scene.spacing - 1e-3


def test_what_lies_outside_the_overlap_lies_at_the_sides() -> None:
    """Breaks if partial overlap is just another kind of clutter."""
    scene = RandomScenes(outlier_share=0.0, overlap=0.5, **NOISE_FREE)
    fixed, moving = scene.sample(50, np.random.default_rng(1))
    back = rigid.transform_means(scene.theta, moving.means)
    lone = np.linalg.norm(fixed.means[:, :, None] - back[:, None], axis=-1).min(axis=-1) > 1e-3
    azimuth = np.arctan2(fixed.means[..., 1], fixed.means[..., 0])
    rightmost = np.argsort(azimuth, axis=1)[:, :10]
    assert np.take_along_axis(lone, rightmost, axis=1).all()
    assert lone.sum() == 50 * 10


def test_a_crowded_scene_is_refused() -> None:
    """Breaks if drawing goes on for ever."""
    with pytest.raises(ValueError, match="spacing"):
        RandomScenes(spacing=15.0).sample(2, np.random.default_rng(0))
