"""The cost as its formulas read, against the compiled kernel and the tests' own loop."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d import PointSet, dense
from tests.strategies import all_cases, case_id, dense_value, random_problem


def batched(points: PointSet) -> PointSet:
    """The set as a batch of one."""
    return PointSet(points.means[None], points.covariances[None], points.weights[None])


@pytest.mark.parametrize("case", all_cases(), ids=case_id)
def test_the_formulas_are_those_of_the_kernel(case):
    """Breaks if a reader is shown another cost than the one that is minimised."""
    problem = random_problem(np.random.default_rng(8), **case)
    sets = batched(problem.fixed), batched(problem.moving)
    theta = problem.theta[None]
    value = dense.value(theta, *sets, problem.cost, problem.measurement)
    assert_allclose(value, problem.value(), rtol=1e-11)
    assert_allclose(value, dense_value(problem, problem.theta), rtol=1e-11)
    factor = None if problem.measurement is None else dense.factor_of(problem.measurement, theta)
    parts = dense.components(theta, *sets, problem.cost, factor)
    logs = dense.target_log_densities(parts, problem.cost)
    assert_allclose(np.exp(logs[0]), problem.densities(), rtol=1e-10)


def test_inverses_of_small_matrices_in_closed_form():
    """Breaks if an entry has the wrong sign or place."""
    rng = np.random.default_rng(0)
    for dimension in (1, 2):
        root = rng.standard_normal((5, 4, dimension, dimension))
        matrices = root @ np.swapaxes(root, -1, -2) + np.eye(dimension)
        inverse, determinant = dense.inverse_of(matrices)
        assert_allclose(inverse, np.linalg.inv(matrices), rtol=1e-10)
        assert_allclose(determinant, np.linalg.det(matrices), rtol=1e-10)
