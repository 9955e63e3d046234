"""The compiled kernel: its elementary functions, cut-off, outlier models and trust region."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from numba import njit
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import brentq

from d2d import CorruptedGaussian, PointSet, RegistrationCost, UniformOutlier, rigid
from d2d._kernel import compile as compiling
from d2d._kernel import elementary, layout, newton
from tests.strategies import (
    FUSIONS,
    METRICS,
    OUTLIERS,
    Problem,
    dense_gradient,
    dense_hessian,
    dense_value,
    doppler_like,
    outlier_model,
)

# ---- exp and log ------------------------------------------------------------------------------

FLAGS = {"strict": False, "kernel": compiling.FAST, "all": True}  # of a caller's fastmath


def through_calls_and_loops(function, flags, x):
    """Values of a compiled function: call by call, in a loop, and in a loop as the kernel has it.

    The last is of a difference times a weight, and its results are summed up.
    """

    def loop(x, out):
        for i in range(len(x)):
            out[i] = function(x[i])

    def weighted_loop(x, out):
        total = 0.0
        for i in range(len(x)):
            out[i] = function(2.0 * (x[i] * 0.5))
            total += out[i]
        return total

    one = njit(lambda value: function(value), fastmath=flags, error_model="numpy")
    yield np.array([one(value) for value in x[:5000]])
    for each in (loop, weighted_loop):
        out = np.empty_like(x)
        njit(each, fastmath=flags, error_model="numpy")(x, out)
        yield out


@pytest.mark.parametrize("flags", FLAGS.values(), ids=FLAGS)
def test_exp_is_within_four_ulp(flags):
    """Breaks if a caller's fastmath cancels the rounding constant, or a digit of ln 2 is off."""
    rng = np.random.default_rng(1)
    far = [0.0, -0.0, -701.0, -745.0, -1e5, -1e300, -np.inf]
    x = np.concatenate(
        [
            far,
            [-5e-324, -700.0],
            -math.log(2.0) * np.arange(0.0, 1009.5, 0.5),  # where the exponent steps
            -np.exp(rng.uniform(-40.0, 0.0, 5_000)),
            -rng.uniform(0.0, 1.0, 20_000),
            -rng.uniform(0.0, 700.0, 40_000),
        ]
    )
    x[len(far) :] = np.maximum(x[len(far) :], -700.0)
    for actual in through_calls_and_loops(elementary.exp, flags, x):
        assert_array_equal(actual[:2], 1.0)
        assert ((actual[2 : len(far)] >= 0.0) & (actual[2 : len(far)] <= 1.0000001e-304)).all()
        expected = np.exp(x[len(far) : len(actual)])
        assert (np.abs(actual[len(far) :] - expected) <= 4.0 * np.spacing(expected)).all()


@pytest.mark.parametrize("flags", FLAGS.values(), ids=FLAGS)
def test_log_is_within_three_ulp(flags):
    """Breaks if the exponent is taken from the wrong bits, or a coefficient is off."""
    rng = np.random.default_rng(1)
    x = np.concatenate(
        [
            [1.0, 1e-300],
            math.sqrt(2.0) * np.array([1.0 - 1e-15, 1.0, 1.0 + 1e-15]),
            2.0 ** np.arange(-1000.0, 1000.0),
            1.0 + np.exp(rng.uniform(-40.0, 0.0, 5_000)),
            rng.uniform(0.5, 2.0, 20_000),
            np.exp(rng.uniform(-690.0, 690.0, 40_000)),
        ]
    )
    expected = np.log(x)
    tolerance = 3.0 * np.maximum(np.spacing(np.abs(expected)), 1e-16)
    for actual in through_calls_and_loops(elementary.log, flags, x):
        assert (np.abs(actual - expected[: len(actual)]) <= tolerance[: len(actual)]).all()
        assert actual[0] == 0.0


# ---- The cut-off ------------------------------------------------------------------------------


def wide_scene(metric: str, outlier: str, measured: str, fusion: str = "likelihood") -> Problem:
    """200 targets over two kilometres, in clusters, standard deviations from 1 cm to 100 m.

    Weights span four orders of magnitude, so that the cut-off's bound on them is far from tight.
    """
    rng = np.random.default_rng(2)
    count = 200
    centres = rng.uniform(-1000.0, 1000.0, (20, 2))

    def point_set(weights):
        means = centres[rng.integers(0, 20, count)] + 5.0 * rng.standard_normal((count, 2))
        sizes = 10.0 ** rng.uniform(-2.0, 2.0, (count, 2))
        angle = rng.uniform(0.0, np.pi, count)
        axes = np.stack([np.cos(angle), np.sin(angle), -np.sin(angle), np.cos(angle)], -1)
        axes = axes.reshape(count, 2, 2)
        # not more than 30 times as long as wide: else rounding, not the cut-off, is compared
        sizes[:, 1] = np.clip(sizes[:, 1], sizes[:, 0] / 30.0, sizes[:, 0] * 30.0)
        covariances = np.einsum("nia,na,nja->nij", axes, sizes**2, axes)
        return PointSet(means, 0.5 * (covariances + np.swapaxes(covariances, 1, 2)), weights)

    theta = np.array([1.0, -2.0, 0.02])
    fixed, moving = point_set(10.0 ** rng.uniform(-4.0, 0.0, count)), point_set(None)
    measurement = doppler_like(rng, theta, count, measured == "twist") if measured else None
    model = outlier_model(outlier, 2)
    return Problem(RegistrationCost(metric, fusion, model), theta, fixed, moving, measurement)


@pytest.mark.parametrize("outlier", OUTLIERS)
def test_the_cut_off_changes_nothing(outlier):
    """Breaks if a pair that matters is skipped: the bound must hold for any size and weight."""
    for metric, fusion, measured in product(METRICS, FUSIONS, ("", "twist")):
        problem = wide_scene(metric, outlier, measured, fusion)
        value, gradient, hessian = problem.derivatives()
        assert_allclose(value, dense_value(problem), rtol=1e-12)
        expected = dense_gradient(problem)
        assert_allclose(gradient, expected, rtol=1e-10, atol=1e-12 * abs(value))
        if fusion == "likelihood" and not measured:
            expected = dense_hessian(problem)
            assert_allclose(hessian, expected, rtol=1e-6, atol=1e-10 * np.abs(expected).max())


# ---- Outlier models ---------------------------------------------------------------------------


def test_an_outlier_component_that_is_not_known_is_refused():
    """Breaks if a new density that one pass does not know counts as none there.

    The estimate is then right, but its propagated covariance is that of another cost.
    """
    theta = np.array([0.1, -0.1, 0.01])
    points = PointSet([[8.0, 1.0], [5.0, -3.0]], [0.04 * np.eye(2)] * 2)
    problem = RegistrationCost(outlier=UniformOutlier(0.1)).problem(points, points)
    outlier = problem.form.outlier.copy()
    outlier[layout.KIND] = 17
    unknown = replace(problem, form=problem.form._replace(outlier=outlier))
    bound = unknown.bind(theta)
    for use in (
        unknown.derivatives,
        unknown.log_densities,
        lambda b: unknown.cross_derivatives(b, 0, 1),
    ):
        with pytest.raises(ValueError, match="does not know this kind of outlier"):
            use(bound)


# ---- The trust region -------------------------------------------------------------------------


def best_decrease(h: np.ndarray, g: np.ndarray, scale: np.ndarray, radius: float) -> float:
    """Of the quadratic model within the radius, by the eigenvectors of the scaled Hessian."""
    root = np.sqrt(scale)
    values, vectors = np.linalg.eigh(h / np.outer(root, root))
    slope = vectors.T @ (g / root)

    def length(shift):
        return np.linalg.norm(slope / (values + shift))

    shift = 0.0
    if values[0] <= 0.0 or length(0.0) > radius:
        low = max(0.0, -values[0]) + 1e-14 * np.abs(values).max()
        high = low + np.linalg.norm(slope) / radius + np.abs(values).max()
        shift = brentq(lambda s: 1.0 / radius - 1.0 / length(s), low, high, rtol=1e-14)
    y = -slope / (values + shift)
    return float(-(slope @ y + 0.5 * y @ (values * y)))


def test_trust_region_step_is_nearly_the_best_within_the_radius():
    """Breaks if the shift's search ends at a step too long, or one that lowers the model little."""
    rng = np.random.default_rng(0)
    direct = 0
    for _ in range(1200):
        h = rng.standard_normal((3, 3)) * 10.0 ** rng.uniform(-3.0, 3.0)
        h = h + h.T + rng.choice([0.0, 1.0, 10.0]) * np.abs(h).max() * np.eye(3)
        scale = np.array([1.0, 1.0, 10.0 ** rng.uniform(-1.0, 3.0)])
        h *= np.sqrt(np.outer(scale, scale))
        g = rng.standard_normal(3) * 10.0 ** rng.uniform(-3.0, 3.0) * np.sqrt(scale)
        radius = 10.0 ** rng.uniform(-3.0, 3.0)
        step = np.full(3, np.nan)
        decrease = newton.trust_region_step(h, g, scale, radius, 1.0, np.empty((5, 3)), step)
        assert np.sqrt((scale * step**2).sum()) <= 1.1 * radius * (1.0 + 1e-9)
        assert_allclose(decrease, -(g @ step + 0.5 * step @ h @ step), rtol=1e-9)
        assert decrease >= 0.75 * best_decrease(h, g, scale, radius)
        newton_step = np.linalg.solve(h, -g)
        within = np.sqrt((scale * newton_step**2).sum()) <= radius
        if within and np.linalg.eigvalsh(h)[0] > 0.0:
            direct += 1
            assert_allclose(step, newton_step, rtol=1e-7, atol=1e-9 * np.abs(newton_step).max())
    assert direct > 100


def test_trust_region_step_on_a_plateau_is_zero():
    """Breaks if the step stays what the memory held before: with g = 0 and H = 0 no shift helps."""
    step = np.array([20.0, 3.0, 0.1])
    decrease = newton.trust_region_step(
        np.zeros((3, 3)), np.zeros(3), np.ones(3), 1.0, 1.0, np.empty((5, 3)), step
    )
    assert_array_equal(step, 0.0)
    assert decrease == 0.0


# ---- Far away ---------------------------------------------------------------------------------


def test_an_elongated_component_far_away_still_pulls():
    """Breaks if two passes take a pair's distance by formulas that round differently."""
    for angle in np.linspace(0.0, 3.0, 31):
        turn = rigid.rotation(angle)
        covariance = turn @ np.diag([10.0, 1e-3]) @ turn.T
        fixed = PointSet(np.zeros((1, 2)), [0.5 * (covariance + covariance.T)])
        moving = PointSet(np.zeros((1, 2)), [np.eye(2)])
        theta = np.array([*(1e9 * turn[:, 0]), 0.0])
        value, gradient, _ = RegistrationCost(metric="p2d").derivatives(theta, fixed, moving)
        assert_allclose(value, 0.5 * 1e18 / 10.0, rtol=1e-2)
        assert_allclose(gradient[:2] @ turn[:, 0], 1e9 / 10.0, rtol=1e-2)


def test_a_component_beyond_the_cut_off_leaves_other_targets_alone():
    """Breaks if a target without further components meets one so far away that it overflows."""
    moving = PointSet([[0.0, 0.0], [8.0, 1.0]], np.tile([[0.1, 0.02], [0.02, 0.2]], (2, 1, 1)))
    near = np.array([[0.0, 0.0], [0.5, 0.0]])
    far = PointSet(np.vstack([near, [[1e30, 0.0]]]), np.tile(np.eye(2), (3, 1, 1)))
    some = RegistrationCost().derivatives([0.0, 0.0, 0.1], far, moving)
    third = PointSet(np.vstack([near, [[1e6, 0.0]]]), far.covariances)
    for actual, expected in zip(
        some, RegistrationCost().derivatives([0.0, 0.0, 0.1], third, moving), strict=True
    ):
        assert_allclose(actual, expected, rtol=1e-12, atol=1e-9)


def test_many_heavy_components_far_away_are_no_plateau():
    """Breaks if what exp() is cut off at, times all weights, passes for a density."""
    count = 20_000
    fixed = PointSet(np.zeros((count, 2)), np.tile(np.eye(2), (count, 1, 1)), np.full(count, 1e100))
    moving = PointSet(np.zeros((1, 2)), [np.eye(2)])
    cost = RegistrationCost(outlier=CorruptedGaussian(0.2, 100.0 * np.eye(2)))
    expected = 0.5 * 1e12 / 100.0  # half the squared distance in the outlier component's sigmas
    assert_allclose(cost.value([1e6, 0.0, 0.0], fixed, moving), expected, rtol=1e-6)
