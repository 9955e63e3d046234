"""Scenes that are drawn anew, other solvers and schedules, mixtures as least squares."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d import CorruptedGaussian, PointSet, RegistrationCost, register, rigid
from d2d.study import scenarios
from d2d.study.beyond.mixtures import Mixture, mixture_residuals, register_mixture
from d2d.study.beyond.random_scenes import RandomScenes
from d2d.study.beyond.solvers import SOLVERS, solved
from d2d.study.plane.evaluation import ROBUST, evaluated
from d2d.study.plane.scenarios import OVERLAPPED

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


def test_solvers_start_where_they_are_told() -> None:
    """Breaks if ``off`` is measured from zero, or the batch differs from the loop."""
    expected = evaluated(scenarios.OVERLAPPED, ROBUST, "zero").errors[:20]
    assert_allclose(solved(scenarios.OVERLAPPED, "likelihood", 1.0, 20).result.errors, expected)
    for name in SOLVERS:
        found = solved(scenarios.OVERLAPPED, name, 0.0, 20).result
        assert np.hypot(*found.errors[:, :2].T).max() < 1.0, name


OUTLIER = CorruptedGaussian(0.2, np.array([[90.0, 35.0], [35.0, 50.0]]))
MIXTURES: tuple[Mixture, ...] = ("max", "sum", "max-sum")


def densities(
    theta: np.ndarray, fixed: PointSet, moving: PointSet, outlier: CorruptedGaussian | None
) -> np.ndarray:
    """Weighted density (K, components) of every target, each component registered to alone."""
    kinds = [(1.0, None)]
    if outlier is not None:
        kinds = [(1.0 - outlier.fraction, None), (outlier.fraction, replace(outlier, fraction=1.0))]
    found = []
    for i, (share, model) in product(range(fixed.size), kinds):
        alone = PointSet(fixed.means[[i]], fixed.covariances[[i]], fixed.weights[[i]])
        cost = RegistrationCost(outlier=model)
        found.append(share * cost.target_densities(theta, alone, moving))
    return np.stack(found, axis=-1)


@pytest.mark.parametrize("outlier", [None, OUTLIER], ids=["plain", "robust"])
@pytest.mark.parametrize("mixture", MIXTURES)
def test_half_the_squares_are_the_negative_log_likelihood(
    sets: tuple[PointSet, PointSet], mixture: Mixture, outlier: CorruptedGaussian | None
) -> None:
    """Breaks if a weight, a determinant or a normalisation is lost: they shift or bend the cost."""
    fixed, moving = sets
    residuals, constant = mixture_residuals(fixed, moving, mixture, outlier)
    for offset in ([0.0, 0.0, 0.0], [0.4, -0.7, 0.05], [-2.0, 1.0, 0.1]):
        theta = OVERLAPPED.theta + offset
        r = residuals(theta)
        fuse = np.max if mixture == "max" else np.sum
        expected = -np.log(fuse(densities(theta, fixed, moving, outlier), axis=-1)).sum()
        assert_allclose(0.5 * r @ r - constant.sum(), expected, rtol=1e-9)
        if mixture != "max":
            kernel = RegistrationCost(outlier=outlier).value(theta, fixed, moving)
            assert_allclose(0.5 * r @ r - constant.sum(), kernel, rtol=1e-9)


@pytest.mark.parametrize("mixture", ["sum", "max-sum"])
def test_the_exact_mixtures_end_where_register_does(
    sets: tuple[PointSet, PointSet], mixture: Mixture
) -> None:
    expected = register(*sets, RegistrationCost(outlier=OUTLIER), OVERLAPPED.theta)
    found = register_mixture(*sets, mixture, OUTLIER, OVERLAPPED.theta)
    assert_allclose(found.theta, expected.theta, atol=1e-3)
    assert_allclose(found.value, expected.value, rtol=1e-7)


def test_one_component_is_ordinary_least_squares() -> None:
    """With one pair per target far from all others, max and max-sum know the exact information."""
    means = np.array([[0.0, 1000.0], [3000.0, 0.0], [-5000.0, 100.0]])
    covariances = np.array([[0.5, 0.2], [0.2, 0.3]])
    fixed = PointSet(means, covariances)
    moving = fixed.shifted([0.3, -0.1])
    expected = register(fixed, moving)
    for mixture in ("max", "max-sum"):
        found = register_mixture(fixed, moving, mixture)
        assert_allclose(found.theta, expected.theta, atol=1e-6)
        assert_allclose(found.covariance, expected.covariance, rtol=1e-3)
