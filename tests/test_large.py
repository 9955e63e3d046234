"""Large sets: neighbours and tiles give what the plain sums give, wherever the targets lie."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d import (
    CorruptedGaussian,
    PointSet,
    RegistrationCost,
    UniformOutlier,
    propagate_covariance,
    register,
    rigid,
)
from tests.strategies import FUSIONS, METRICS, Problem, dense_gradient, dense_value, steps_of

THETA = np.array([0.4, -0.3, 0.02])
START = THETA + np.array([0.2, 0.1, 0.005])
WIDE = CorruptedGaussian(0.2, [[100.0, 20.0], [20.0, 60.0]])


def spreads(rng: np.random.Generator, count: int, thin: float, wide: float) -> np.ndarray:
    """Covariances (N, 2, 2) with standard deviations between two sizes, turned at random."""
    sigma = np.exp(rng.uniform(np.log(thin), np.log(wide), (count, 2)))
    turned = rigid.rotation(rng.uniform(-np.pi, np.pi, count))
    return np.einsum("kij,kj,klj->kil", turned, sigma**2, turned)


def uniform(rng: np.random.Generator, count: int) -> np.ndarray:
    """Positions (N, 2) in a field of 60 m by 80 m."""
    return rng.uniform(-1.0, 1.0, (count, 2)) * [30.0, 40.0]


def one_cell(rng: np.random.Generator, count: int) -> np.ndarray:
    """All within a metre."""
    return rng.uniform(-0.5, 0.5, (count, 2))


def lonely(rng: np.random.Generator, count: int) -> np.ndarray:
    """None within the reach of another."""
    side = int(np.ceil(np.sqrt(count)))
    grid = np.stack(np.meshgrid(*2 * [np.arange(side)]), axis=-1).reshape(-1, 2)[:count]
    return 50.0 * grid + rng.uniform(-1.0, 1.0, (count, 2))


def two_towns(rng: np.random.Generator, count: int) -> np.ndarray:
    """Most of them together, and every tenth a kilometre off."""
    places = uniform(rng, count)
    places[::10] += [1000.0, -300.0]
    return places


def on_a_line(rng: np.random.Generator, count: int) -> np.ndarray:
    """A crash barrier: a hundred metres long, without width."""
    return np.stack([rng.uniform(0.0, 100.0, count), np.zeros(count)], axis=-1)


NAMES = ("means", "covariances", "weights")
LAYOUTS = (uniform, one_cell, lonely, two_towns, on_a_line)
OUTLIERS = {
    "none": None,
    "uniform": UniformOutlier(1e-4),
    "wide": WIDE,
    "round": CorruptedGaussian(0.2, 100.0 * np.eye(2)),
    "small": CorruptedGaussian(0.2, 0.3 * np.eye(2)),
    "huge": CorruptedGaussian(0.2, 1e6 * np.eye(2)),
    "only": CorruptedGaussian(1.0, 100.0 * np.eye(2)),
}


def scene(layout, count: int, seed: int = 0) -> tuple[PointSet, PointSet]:
    """Two noisy views of a layout, a few targets of the second somewhere else."""
    rng = np.random.default_rng([seed, count])
    places = layout(rng, count)
    covariances = spreads(rng, count, 0.1, 2.0)
    noisy = places + np.einsum(
        "kij,kj->ki", np.linalg.cholesky(covariances), rng.standard_normal((count, 2))
    )
    weights = 10.0 ** rng.uniform(-4.0, 0.0, count)  # so that bounds on them are far from tight
    moving = PointSet(noisy, covariances).transformed(rigid.inverse(THETA))
    strays = moving.means.copy()
    strays[3::17] += rng.uniform(-30.0, 30.0, strays[3::17].shape)
    return PointSet(places, covariances, weights), PointSet(strays, moving.covariances)


@pytest.mark.parametrize("outlier", OUTLIERS.values(), ids=OUTLIERS)
@pytest.mark.parametrize("layout", LAYOUTS)
def test_value_and_gradient_are_those_of_the_plain_sums(layout, outlier):
    """Breaks if a neighbour is missed, or a tile is used where it errs."""
    fixed, moving = scene(layout, 150)
    starts = THETA + np.array([[0.0, 0.0, 0.0], [5.0, -3.0, 0.2], [300.0, 0.0, 3.0]])
    for metric, fusion in zip(METRICS, FUSIONS, strict=True):
        cost = RegistrationCost(metric, fusion, outlier)
        for theta in starts:
            problem = Problem(cost, theta, fixed, moving)
            value, gradient, _ = problem.derivatives()
            assert_allclose(value, dense_value(problem), rtol=1e-9, atol=1e-9)
            expected, natural = dense_gradient(problem), 1e-3 / steps_of(problem)
            assert (np.abs(gradient - expected) <= 1e-9 * (np.abs(expected) + natural)).all()


def test_a_tile_that_errs_is_not_used():
    """Breaks if tiles are used where their error is more than a billionth of the density: between
    two groups, seven standard deviations from both, an interpolated density errs by a millionth."""
    outlier = CorruptedGaussian(1.0, 100.0 * np.eye(2))
    rng = np.random.default_rng(0)
    cost, second = RegistrationCost(outlier=outlier), np.arange(130)[:, None] % 2
    for apart in (140.0, 1200.0):  # so far that exponentials vanish
        places = rng.uniform(-3.0, 3.0, (130, 2)) + np.array([apart, 0.0]) * second
        fixed = PointSet(places, np.tile(np.eye(2), (130, 1, 1)))
        for x in np.linspace(0.0, apart, 57):
            moving = PointSet([[x, 0.0]], [np.eye(2)])
            problem = Problem(cost, np.zeros(3), fixed, moving)
            assert_allclose(problem.derivatives()[0], dense_value(problem), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("outlier", OUTLIERS.values(), ids=OUTLIERS)
@pytest.mark.parametrize("layout", LAYOUTS)
def test_estimates_are_those_of_the_plain_sums(layout, outlier, monkeypatch):
    """Breaks if lists are kept too long, or fields miss a term: of optimum and both covariances."""
    for fusion in FUSIONS:
        cost = RegistrationCost("d2d", fusion, outlier)
        fixed, moving = scene(layout, 150, 1)
        found = register(fixed, moving, cost, START)
        stated = propagate_covariance(found, fixed, moving, cost)
        with monkeypatch.context() as patch:
            patch.setattr("d2d.point_set._TILED", 10**9)
            fixed, moving = scene(layout, 150, 1)
            plain = register(fixed, moving, cost, START)
            assert_array_equal(found.converged, plain.converged)
            if not found.converged or plain.covariance[2, 2] > 1.0:  # hardly determined
                continue
            away = found.theta - plain.theta
            assert away @ np.linalg.solve(plain.covariance, away) <= 1e-12
            size = np.sqrt(np.diag(plain.covariance))
            each = np.outer(size, size)
            assert (np.abs(found.covariance - plain.covariance) <= 1e-6 * each).all()
            expected = propagate_covariance(plain, fixed, moving, cost)
            size = np.sqrt(np.diag(expected))
            assert (np.abs(stated - expected) <= 1e-6 * np.outer(size, size)).all()


def test_lists_that_are_kept_miss_nothing():
    """Breaks if the margin of a list is too small for the steps or the rotation of a descent."""
    for seed in range(20):
        fixed, moving = scene(uniform, 100, seed)
        rng = np.random.default_rng(seed)
        for cost in (RegistrationCost(), RegistrationCost(outlier=WIDE)):
            start = THETA + rng.uniform(-1.0, 1.0, 3) * [1.0, 1.0, 0.05]
            found = register(fixed, moving, cost, start)
            value, _, hessian = cost.derivatives(found.theta, fixed, moving)
            assert_allclose(found.value, value, rtol=1e-13)
            assert_allclose(found.hessian, hessian, rtol=1e-9, atol=1e-10 * np.abs(hessian).max())


def test_a_batch_has_tiles_for_each_set():
    """Breaks if a problem reads the tiles of another set, in a batch or among several pairs."""
    scenes = [scene(layout, 90, seed) for seed, layout in enumerate((uniform, one_cell, lonely))]
    cost = RegistrationCost(outlier=WIDE)
    fixed, moving = (
        PointSet(*(np.stack([getattr(pair[side], name) for pair in scenes]) for name in NAMES))
        for side in range(2)
    )
    together = cost.derivatives(THETA, fixed, moving)
    for i, pair in enumerate(scenes):
        for all_of, one in zip(together, cost.derivatives(THETA, *pair), strict=True):
            assert_array_equal(all_of[i], one)
