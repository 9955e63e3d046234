"""The textbook update rules, many descents at once, and the terms of the robust cost."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d import CorruptedGaussian, PointSet, RegistrationCost, register
from d2d.study import scenarios
from d2d.study.estimation import descent, optimisers
from d2d.study.estimation.optimisers import (
    descend,
    descend_damped,
    gauss_newton,
    gradient_descent,
    levenberg_marquardt,
)
from d2d.study.estimation.robust import kernels, line_terms
from d2d.study.line.scene import CORRUPTED, with_outlier
from d2d.study.plane.scenarios import OVERLAPPED
from tests.strategies import central_difference

START = np.array([4.0, -0.8, 0.2])


class Parabola:
    """f(x) = x, F = x^2 / 2."""

    def residuals(self, x):
        return x

    def jacobian(self, x):
        return np.eye(len(x))

    def curvature(self, x):
        return np.zeros((len(x), len(x)))


class Bend(Parabola):
    """f(x) = arctan x: a Gauss-Newton step from 3 overshoots."""

    def residuals(self, x):
        return np.arctan(x)

    def jacobian(self, x):
        return np.diag(1.0 / (1.0 + x**2))


@pytest.fixture(scope="module")
def pairs(sets):
    return descent.PairedTargets(*sets)


def test_the_derivatives_are_those_of_the_residuals(pairs):
    """Breaks if a rule is tested on a wrong Jacobian or curvature."""
    steps, j = np.full(3, 1e-4), pairs.jacobian(START)
    slopes = central_difference(pairs.residuals, START, steps)
    assert_allclose(j, slopes, rtol=1e-6, atol=1e-6)
    hessian = central_difference(lambda x: optimisers.gradient(pairs, x), START, steps)
    assert_allclose(j.T @ j + pairs.curvature(START), hessian, rtol=1e-5, atol=1e-3)
    slope = central_difference(lambda x: np.array(optimisers.cost(pairs, x)), START, steps)
    assert_allclose(optimisers.gradient(pairs, START), slope, rtol=1e-6)


def test_gradient_descent_from_six_is_a_geometric_series():
    """Breaks if the step climbs, as it does with the thesis's two signs: 6 (1 - 0.2)^i."""
    path = descend(Parabola(), [6.0], gradient_descent(0.2), tolerance=1e-9)
    assert path.converged
    assert_allclose(path.points[:, 0], 6.0 * 0.8 ** np.arange(len(path.points)), rtol=1e-12)
    assert_allclose(path.costs, 0.5 * path.points[:, 0] ** 2)
    climbing = descend(
        Parabola(), [6.0], lambda p, x: -gradient_descent(0.2)(p, x), max_iterations=20
    )
    assert_allclose(climbing.points[:, 0], 6.0 * 1.2 ** np.arange(21))


def test_levenberg_marquardt_lies_between_its_limits(pairs):
    """Breaks if the damping is on the wrong side: 0 is Gauss-Newton, large is short descent."""
    assert_allclose(levenberg_marquardt(pairs, START, 0.0), gauss_newton(pairs, START), rtol=1e-9)
    large = 1e12
    step = large * levenberg_marquardt(pairs, START, large)
    assert_allclose(step, -optimisers.gradient(pairs, START), rtol=1e-5)


def test_the_damping_rises_tenfold_until_a_step_lowers_the_cost_and_falls_to_a_tenth_after_it():
    """Breaks if it rises or falls by less: 0.001, 0.01 and then 0.01 again overshoot."""
    start = np.array([3.0])
    first = start + levenberg_marquardt(Bend(), start, 0.1)
    second = first + levenberg_marquardt(Bend(), first, 0.1)
    path = descend_damped(Bend(), start)
    assert path.converged
    assert_allclose(path.points[:3], [start, first, second], rtol=1e-9)


def test_all_four_arrive_where_register_does(pairs):
    """Breaks if a path leads elsewhere, or reports what it did not reach."""
    paths = descent.run_all(pairs, np.zeros(3))
    truth = scenarios.OVERLAPPED.theta
    expected = register(pairs.fixed, pairs.moving, RegistrationCost("p2d"), truth).theta
    for name, path in paths.items():
        assert path.converged, name
        assert len(path.points) == len(path.costs)
        assert_allclose(path.points[-1], expected, atol=2e-4, err_msg=name)
        assert_array_equal(path.points[0], 0.0)


def problems(count: int) -> list[descent.PairedTargets]:
    fixed, moving = OVERLAPPED.sample(count, np.random.default_rng(3))
    return [descent.PairedTargets(fixed[run], moving[run]) for run in range(count)]


def test_many_descents_are_those_of_one_at_a_time(monkeypatch):
    """Breaks if a descent goes on after it has converged, or one stops with another."""
    monkeypatch.setattr(descent, "MAX_DESCENTS", 6000)  # which not all of these keep to
    given = problems(4)
    starts = OVERLAPPED.theta + np.random.default_rng(1).uniform(-0.5, 0.5, (4, 3))
    together = descent.gradient_descents(given, starts)
    paths = [
        descent.run_all(*each)[descent.FIRST_ORDER] for each in zip(given, starts, strict=True)
    ]
    alone = descent.ends_of(paths)
    assert 0 < together.converged.sum() < 4
    assert_array_equal(together.converged, alone.converged)
    assert_allclose(together.iterations, alone.iterations, atol=1)
    assert_allclose(together.cost, alone.cost, rtol=1e-9)


TRANSLATIONS = np.linspace(-3.0, 8.0, 101)


def test_the_terms_add_up_to_the_cost_and_its_derivatives():
    """Breaks if a term is missing, has the wrong sign or is counted twice."""
    sets = with_outlier(np.random.default_rng(1), "moving", at=4.0)
    terms = line_terms(TRANSLATIONS, *sets, CORRUPTED)
    cost = RegistrationCost(outlier=CORRUPTED)
    value, gradient, hessian = cost.derivatives(TRANSLATIONS[:, None], *sets)
    np.testing.assert_allclose(terms.value, value)
    np.testing.assert_allclose(terms.inliers + terms.outliers, gradient[:, 0], atol=1e-9)
    np.testing.assert_allclose(terms.curvature - terms.spread, hessian[:, 0, 0], atol=1e-8)
    assert (terms.curvature > 0).all()
    assert (terms.spread >= 0).all()


def test_influence_and_weight_follow_from_the_loss():
    """Breaks if the panels of a kernel do not belong together."""
    r = np.linspace(-6.0, 6.0, 2001)[1::2]  # without zero
    for loss, influence, weight in kernels(r, 0.01).values():
        np.testing.assert_allclose(np.gradient(loss, r)[1:-1], influence[1:-1], atol=1e-3)
        np.testing.assert_allclose(weight * r, influence, atol=1e-12)


def test_the_robust_kernel_is_the_cost_of_one_pair():
    """Breaks if the ratio of the heights is not that of the outlier component."""
    sigma, alpha, width = 0.2, 0.2, 1e4
    one = PointSet([[0.0]], [[[sigma**2]]])
    s = np.sqrt(2.0) * sigma
    r = np.linspace(0.0, 6.0, 13)
    cost = RegistrationCost(outlier=CorruptedGaussian(alpha, [[width**2]]))
    values = cost.value(r[:, None] * s, one, one)
    kernel = kernels(r, alpha * s / ((1.0 - alpha) * width))["robust"]
    np.testing.assert_allclose(values - values[0], kernel.loss, atol=1e-6)
