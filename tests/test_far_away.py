"""Registration in map coordinates: far from the origin all is as near it, in the user's frame."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d import PointSet, RegistrationCost, propagate_covariance, register, rigid
from tests.strategies import ROBUST

COSTS = (
    RegistrationCost(),
    RegistrationCost("p2d", "summing"),
    ROBUST,
)
TRUTH = np.array([0.5, -0.2, 0.05])


def scene(seed=0, batch=()):
    """Two sets of twelve targets within 40 m of the origin."""
    rng = np.random.default_rng(seed)
    means = rng.uniform(-40.0, 40.0, (*batch, 12, 2))
    root = rng.standard_normal((*batch, 12, 2, 2))
    covariances = 0.09 * (root @ np.swapaxes(root, -1, -2) + 0.3 * np.eye(2))
    moved = rigid.transform_means(rigid.inverse(TRUTH), means)
    moving = PointSet(moved + 0.2 * rng.standard_normal(moved.shape), covariances)
    return PointSet(means, covariances), moving


def seen_from(origins, theta):
    """The motion (3,) with the fixed and the moving set moved to these origins, and its slope."""
    fixed, moving = origins
    turned = rigid.rotation(theta[2]) @ moving
    slope = np.eye(3)
    slope[:2, 2] = turned[1], -turned[0]
    return np.append(theta[:2] + fixed - turned, theta[2]), slope


def at(origins, sets):
    return [points.shifted(origin) for points, origin in zip(sets, origins, strict=True)]


PLACES = [
    distance * np.array([[1.0, -0.7], moving])
    for distance in (2e5, 1e6, 1e7)
    for moving in ([1.0, -0.7], [-0.3, 0.4])  # the sets lie about one place, or two
]


@pytest.mark.parametrize("origins", PLACES, ids=lambda origins: str(origins[:, 0]))
@pytest.mark.parametrize("cost", COSTS, ids=["likelihood", "sum", "outliers"])
def test_far_from_the_origin_is_as_near_it(cost, origins):
    """Breaks if the rotation's lever is the distance to the map's origin: nothing converges."""
    near = scene()
    far = at(origins, near)
    expected = register(*near, cost, TRUTH)
    estimate = register(*far, cost, seen_from(origins, TRUTH)[0])
    assert estimate.converged
    theta, slope = seen_from(origins, expected.theta)
    assert_allclose(estimate.theta[2], theta[2], rtol=0.0, atol=1e-8)
    moved = rigid.transform_means(estimate.theta, far[1].means) - origins[0]
    expected_means = rigid.transform_means(expected.theta, near[1].means)
    assert_allclose(moved[:, 0], expected_means[:, 0], rtol=0.0, atol=1e-6)
    assert_allclose(estimate.value, expected.value, atol=1e-7)
    assert_allclose(estimate.covariance, slope @ expected.covariance @ slope.T, rtol=1e-5)
    propagated = slope @ propagate_covariance(expected, *near, cost) @ slope.T
    assert_allclose(propagate_covariance(estimate, *far, cost), propagated, rtol=1e-5)
    again = cost.derivatives(estimate.theta, *far)
    assert_allclose(again[0], estimate.value, atol=1e-7)
    assert_allclose(again[2], estimate.hessian, rtol=1e-6)


def test_a_batch_near_and_far_is_its_problems_one_by_one():
    """Breaks if one far set moves the origin of all, or batch axes meet the wrong origins."""
    fixed, moving = scene(batch=(3,))
    shift = np.array([[0.0, 0.0], [4e5, 1e5], [1e7, 1e7]])[:, None]
    far = [PointSet(each.means + shift, each.covariances) for each in (fixed, moving)]
    starts = np.array([[[0.0, 0.0, 0.0]], [[0.2, 0.1, 0.0]]])
    before = starts.copy()
    together = register(*far, COSTS[2], starts, threads=2)
    assert_array_equal(starts, before)
    for i, j in np.ndindex(2, 3):
        one = register(far[0][j], far[1][j], COSTS[2], starts[i, 0])
        assert_array_equal(one.theta, together.theta[i, j])
        assert_array_equal(one.covariance, together.covariance[i, j])
        assert_array_equal(one.hessian, together.hessian[i, j])
    assert together.converged.all()


def test_sets_on_a_line_far_away():
    """Breaks if the origin is taken off only in the plane."""
    rng = np.random.default_rng(1)
    means, unit = rng.uniform(-9.0, 9.0, (7, 1)), np.full((7, 1, 1), 0.04)
    noise = 0.1 * rng.standard_normal((7, 1))
    near_sets = PointSet(means, unit), PointSet(means + noise, unit)
    far_sets = PointSet(means + 1e7, unit), PointSet(means + noise - 2e7, unit)
    near, far = register(*near_sets), register(*far_sets, initial=[3e7])
    assert far.converged
    assert_allclose(far.theta - 3e7, near.theta, atol=1e-7)
    assert_allclose(far.covariance, near.covariance, rtol=1e-6)
    expected = propagate_covariance(near, *near_sets)
    assert_allclose(propagate_covariance(far, *far_sets), expected, rtol=1e-6)
