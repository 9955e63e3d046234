"""The cost's values and derivatives against the plain formulas: alone, in batches, in any unit."""

from itertools import product
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

import d2d
from d2d import CorruptedGaussian, RegistrationCost
from d2d.cost import OutlierModel
from tests.strategies import (
    FUSIONS,
    LAYOUTS,
    MEASURED,
    OUTLIERS,
    Problem,
    all_cases,
    case_id,
    dense_gradient,
    dense_hessian,
    dense_value,
    in_unit,
    naive_log_densities,
    outlier_model,
    random_problem,
    reals,
    seeds,
    steps_of,
)

CASES = pytest.mark.parametrize("case", all_cases(), ids=case_id)


def assert_is_the_cost(problem: Problem, curved: float = 1e-8) -> None:
    """Value, gradient and, within ``curved``, the Hessian are those of the formulas.

    The densities are those of a plain double loop, which knows normalisations, weights and turns.
    Derivatives are compared relative to each element and, where symmetry makes one vanish, to its
    natural size: that of one target at one standard deviation.
    """
    assert_allclose(problem.densities(), np.exp(naive_log_densities(problem)), rtol=1e-9)
    value, gradient, hessian = problem.derivatives()
    interpolated = problem.fixed.size >= 64 and isinstance(problem.cost.outlier, CorruptedGaussian)
    expected = dense_value(problem)
    assert_allclose(value, expected, rtol=1e-12, atol=1e-10 if interpolated else 0.0)
    assert_array_equal(problem.value(), value)
    inverse = 1e-3 / steps_of(problem)
    expected = dense_gradient(problem)
    assert (np.abs(gradient - expected) <= 1e-10 * np.abs(expected) + 1e-12 * inverse).all()
    expected = dense_hessian(problem)
    limit = curved * np.abs(expected) + 1e-9 * np.outer(inverse, inverse)
    assert (np.abs(hessian - expected) <= limit).all(), f"{hessian}\n!=\n{expected}"
    assert_array_equal(hessian, hessian.T)


@CASES
def test_derivatives_equal_those_of_the_formulas(case):
    """Breaks if gradient or Hessian leave out a term, such as the covariance's own rotation."""
    for layout in LAYOUTS:
        problem = random_problem(np.random.default_rng(4), layout=layout, **case)
        before = problem.theta.copy()
        # far away, the differences of the reference itself are rounded
        assert_is_the_cost(problem, 1e-5 if layout == "far" else 1e-8)
        assert_array_equal(problem.theta, before)


@pytest.mark.parametrize("outlier", OUTLIERS)
def test_any_number_of_targets_and_components(outlier):
    """Breaks if a lane without a target counts, or a component is lost between two chunks: the
    kernel takes eight targets at a time, and marks components in chunks of 48."""
    few, many = [(1, 1), (1, 6), (7, 1)], [(i, 4) for i in (47, 48, 49, 100)]
    each = few + [(5, k) for k in (7, 8, 9, 17)] + many
    for sizes, fusion, measured in product(each, FUSIONS, ("", "twist")):
        case = {"fusion": fusion, "outlier": outlier, "measured": measured, "sizes": sizes}
        rng = np.random.default_rng(sizes[1])
        assert_is_the_cost(random_problem(rng, **case, weighted=sizes[0] % 2 == 0), 1e-6)


def test_derivatives_at_any_angle():
    """Breaks if a small angle is assumed, or the logarithm's series and closed form part ways."""
    angles = [0.0, 1e-9, -1e-4, 0.03, -0.0499, 0.0501, 0.3, np.pi / 2, -np.pi, 3.0, 5.0, 100.0]
    for measured, angle in product(MEASURED, angles):
        problem = random_problem(np.random.default_rng(5), outlier="corrupted", measured=measured)
        problem = problem.with_(theta=np.array([0.4, -0.3, angle]))
        assert_is_the_cost(problem)


@pytest.mark.parametrize("outlier", OUTLIERS)
def test_inlier_probabilities_are_the_inliers_share(outlier):
    """Breaks if a share leaves [0, 1], is that of the outliers, or is not 1 without a model."""
    for dimension, layout, sizes in product((1, 2), LAYOUTS, ((5, 4), (30, 17))):
        case = {"outlier": outlier, "measured": "motion", "layout": layout, "sizes": sizes}
        problem = random_problem(np.random.default_rng(5), dimension, **case)
        share, densities = problem.inlier_probabilities(), problem.densities()
        assert ((share >= 0.0) & (share <= 1.0)).all()
        bare = problem.with_(cost=RegistrationCost()).densities()
        model = problem.cost.outlier
        kept = 1.0 - getattr(model, "fraction", 0.0)
        wrong = np.abs(share * densities - kept * bare)
        assert (wrong <= 1e-10 * kept * bare + 3e-16 * densities).all()
        if outlier == "none":
            assert_array_equal(share, 1.0)


def test_inlier_probabilities_at_the_ends_of_alpha():
    """Breaks if a weight of zero gives nan where the densities underflow."""
    problem = random_problem(np.random.default_rng(5), layout="far")
    for alpha, expected in ((0.0, 1.0), (1.0, 0.0)):
        ends = RegistrationCost(outlier=CorruptedGaussian(alpha, np.eye(2)))
        assert_array_equal(problem.with_(cost=ends).inlier_probabilities(), expected)


@given(
    seeds,
    st.sampled_from([case for case in all_cases() if not case["measured"]]),
    st.tuples(st.integers(1, 40), st.integers(1, 40)),
    reals(-6.0, 6.0),
)
def test_a_change_of_unit_shifts_the_cost_by_a_constant(seed, case, sizes, decade):
    """Breaks if any constant of the code is a length: a target adds D log(unit)."""
    rng, unit = np.random.default_rng(seed), 10.0**decade
    problem = random_problem(rng, sizes=sizes, **case)
    value, gradient, hessian = problem.derivatives()
    other, slope, bend = in_unit(problem, unit).derivatives()
    count = sizes[1] if case["fusion"] == "likelihood" else 1
    shift = count * case["dimension"] * np.log(unit)
    assert_allclose(other - shift, value, rtol=1e-10, atol=1e-8)
    per = np.array([unit] * case["dimension"] + [1.0] * (len(gradient) - case["dimension"]))
    natural = np.sqrt(np.abs(np.diagonal(hessian))) + np.abs(gradient)
    assert (np.abs(slope * per - gradient) <= 1e-9 * natural).all()
    outer = np.outer(natural, natural)
    assert (np.abs(bend * np.outer(per, per) - hessian) <= 1e-9 * (outer + np.abs(hessian))).all()


def test_the_tests_know_every_outlier_model():
    """Breaks if a model is added whose values, derivatives and propagation no test looks at."""
    known = {type(outlier_model(kind, 2)) for kind in OUTLIERS}
    assert known == {type(None), *get_args(OutlierModel)}
    assert {model.__name__ for model in get_args(OutlierModel)} <= set(d2d.__all__)
