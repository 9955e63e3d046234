"""Rigid motions: group identities, and what they do to points and covariances."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.linalg import expm

from d2d import rigid
from tests.strategies import central_difference, motions, reals, seeds, spd

EITHER = st.sampled_from([1, 2])
few = settings(max_examples=50)
TURNS = (0.0, 1e-12, 1e-9, 1e-5, -9e-4, 1.1e-3, -0.04, 0.06, -0.29, 0.31, 1.0, -2.5, np.pi, 5.0)
"""On either side of where series end."""


def points(dimension: int) -> np.ndarray:
    return np.random.default_rng(1).uniform(-50.0, 50.0, (6, dimension))


@few
@given(st.data(), EITHER)
def test_composition_applies_the_second_motion_first(data, dimension):
    """Breaks if the order is swapped or the shift of the second is not turned by the first."""
    a, b = data.draw(motions(dimension)), data.draw(motions(dimension))
    once = rigid.transform_means(rigid.compose(a, b), points(dimension))
    twice = rigid.transform_means(a, rigid.transform_means(b, points(dimension)))
    assert_allclose(once, twice, rtol=0, atol=1e-9)


@few
@given(st.data(), EITHER)
def test_inverse_undoes_a_motion_from_both_sides(data, dimension):
    """Breaks if the inverse's shift is not turned back."""
    theta = data.draw(motions(dimension))
    back = rigid.inverse(theta)
    assert_allclose(rigid.compose(back, theta), 0.0, atol=1e-9)
    assert_allclose(rigid.compose(theta, back), 0.0, atol=1e-9)
    moved = rigid.transform_means(theta, points(dimension))
    assert_allclose(rigid.transform_means(back, moved), points(dimension), rtol=0, atol=1e-9)
    assert_allclose(rigid.inverse(back), theta, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("dimension", [1, 2])
def test_batch_axes_broadcast(dimension):
    """Breaks if theta's batch axes are matched with the targets' axis."""
    rng = np.random.default_rng(3)
    parameters = rigid.PARAMETERS[dimension]
    theta = rng.standard_normal((5, 1, parameters))
    means = rng.standard_normal((4, 6, dimension))
    covariances = spd(rng, 6, dimension)
    moved = rigid.transform_means(theta, means)
    turned = rigid.transform_covariances(theta, covariances)
    second = rng.standard_normal((4, parameters))
    pairs = rigid.compose(theta, second)
    for i, j in np.ndindex(5, 4):
        one = theta[i, 0]
        assert_allclose(moved[i, j], rigid.transform_means(one, means[j]), rtol=1e-14)
        assert_allclose(turned[i, 0], rigid.transform_covariances(one, covariances), rtol=1e-14)
        assert_allclose(pairs[i, j], rigid.compose(one, second[j]), rtol=1e-14)
    for function in (rigid.inverse, rigid.exponential, rigid.logarithm):
        if dimension == 2 or function is rigid.inverse:
            every = function(theta)
            for i in range(5):
                assert_allclose(every[i, 0], function(theta[i, 0]), rtol=1e-14)


def twists() -> st.SearchStrategy[np.ndarray]:
    return st.tuples(reals(-50.0, 50.0), reals(-50.0, 50.0), reals(-6.0, 6.0)).map(np.array)


@few
@given(twists())
def test_exponential_is_that_of_the_matrix_group(xi):
    """Breaks if the arc is taken for the chord, or bends to the wrong side."""
    generator = np.array([[0.0, -xi[2], xi[0]], [xi[2], 0.0, xi[1]], [0.0, 0.0, 0.0]])
    motion = expm(generator)
    theta = rigid.exponential(xi)
    assert_allclose(theta[:2], motion[:2, 2], rtol=1e-10, atol=1e-10)
    assert_allclose(rigid.rotation(theta[2]), motion[:2, :2], atol=1e-12)


@few
@given(seeds, st.sampled_from([(), (3,), (2, 1)]), reals(-6.0, 6.0), reals(-8.0, np.log10(6.2)))
def test_exponential_and_logarithm_undo_each_other(seed, batch, decade, angle):
    """Breaks at an angle where a series ends or a closed form cancels, on either side."""
    rng = np.random.default_rng(seed)
    shift = 10.0**decade * rng.standard_normal((*batch, 2))
    turn = 10.0**angle * rng.choice([-1.0, 0.0, 1.0], (*batch, 1))
    twist, size = np.concatenate([shift, turn], axis=-1), np.abs(shift).max()
    within = {"rtol": 1e-9, "atol": 1e-9 * size * (angle > 0) + 1e-12 * size}
    assert_allclose(rigid.logarithm(rigid.exponential(twist)), twist, **within)
    assert_allclose(rigid.exponential(rigid.logarithm(twist)), twist, **within)
    back = rigid.inverse(rigid.exponential(twist))
    assert_allclose(back, rigid.exponential(-twist), atol=1e-9 * size + 1e-15)


def test_derivatives_of_exponential_and_logarithm_by_differences():
    """Breaks on a wrong entry, or a series that is too short for a derivative."""
    functions = rigid.exponential_derivatives, rigid.logarithm_derivatives
    for function, turn in product(functions, TURNS):
        point, steps = np.array([2.0, -3.0, turn]), np.full(3, 1e-3)
        _, first, second = function(point)
        slopes = central_difference(lambda p, f=function: f(p)[0], point, steps)
        bends = central_difference(lambda p, f=function: f(p)[1], point, steps)
        assert_allclose(first, slopes, rtol=1e-8, atol=1e-9)
        assert_allclose(second, bends, rtol=1e-8, atol=1e-9)
