"""The cost as its formulas read, against a plain loop over the pairs and against differences."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d import dense
from tests.strategies import (
    all_cases,
    batch_of_one,
    case_id,
    central_difference,
    dense_gradient,
    dense_value,
    naive_log_densities,
    naive_value,
    random_problem,
    steps_of,
)


@pytest.mark.parametrize("case", all_cases(), ids=case_id)
def test_the_formulas_are_a_loop_over_the_pairs(case):
    """Breaks if a reader is shown another cost than the one that is meant."""
    for layout in ("far", "coincident", "near"):
        problem = random_problem(np.random.default_rng(8), layout=layout, **case)
        assert_allclose(dense_value(problem), naive_value(problem), rtol=1e-10)
    theta, fixed, moving, cost, measurement = batch_of_one(problem)
    factor = None if measurement is None else dense.factor_of(measurement, theta)
    logs = dense.target_log_densities(dense.components(theta, fixed, moving, cost, factor), cost)
    assert_allclose(logs[0], naive_log_densities(problem), rtol=1e-10)
    slopes = central_difference(lambda x: dense_value(problem, x), problem.theta, steps_of(problem))
    assert_allclose(dense_gradient(problem), slopes, rtol=1e-7, atol=1e-8)
