"""Mixtures as least squares, against loops over targets and components and against the kernel."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d import CorruptedGaussian, PointSet, RegistrationCost, register
from d2d.study.beyond.mixtures import Mixture, mixture_residuals, register_mixture
from d2d.study.plane.scenarios import OVERLAPPED

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
    covariances = np.array([[[0.5, 0.2], [0.2, 0.3]]] * 3)
    fixed, moving = (
        PointSet(means, covariances),
        PointSet(means + np.array([0.3, -0.1]), covariances),
    )
    expected = register(fixed, moving)
    for mixture in ("max", "max-sum"):
        found = register_mixture(fixed, moving, mixture)
        assert_allclose(found.theta, expected.theta, atol=1e-6)
        assert_allclose(found.covariance, expected.covariance, rtol=1e-3)
