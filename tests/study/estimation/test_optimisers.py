"""The textbook update rules: their signs, their limits and where they lead."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d import RegistrationCost, register
from d2d.study import scenarios
from d2d.study.estimation import descent, optimisers
from d2d.study.estimation.optimisers import (
    descend,
    gauss_newton,
    gradient_descent,
    levenberg_marquardt,
)
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
    assert_allclose(
        large * levenberg_marquardt(pairs, START, large),
        -optimisers.gradient(pairs, START),
        rtol=1e-5,
    )


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
