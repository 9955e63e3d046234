"""The compiled kernel: what it leaves out as too far away, and what lies far away."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d import PointSet, RegistrationCost, UniformOutlier, rigid
from d2d._kernel import layout
from tests.strategies import ROBUST


def test_an_outlier_component_that_is_not_known_is_refused():
    """Breaks if a new density that one pass does not know counts as none there: the estimate is
    right, but its propagated covariance is that of another cost."""
    theta = np.array([0.1, -0.1, 0.01])
    points = PointSet([[8.0, 1.0], [5.0, -3.0]], [0.04 * np.eye(2)] * 2)
    problem = RegistrationCost(outlier=UniformOutlier(0.1)).problem(points, points)
    outlier = problem.form.outlier.copy()
    outlier[layout.KIND] = 17
    unknown = replace(problem, form=problem.form._replace(outlier=outlier))
    bound = unknown.bind(theta)
    for use in (unknown.derivatives, unknown.inlier_shares, unknown.cross_derivatives):
        with pytest.raises(ValueError, match="does not know this kind of outlier"):
            use(bound)


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
    third = PointSet(np.vstack([near, [[1e6, 0.0]]]), far.covariances)
    some, others = (
        RegistrationCost().derivatives([0.0, 0.0, 0.1], each, moving) for each in (far, third)
    )
    for actual, expected in zip(some, others, strict=True):
        assert_allclose(actual, expected, rtol=1e-12, atol=1e-9)


def test_many_heavy_components_far_away_are_no_plateau():
    """Breaks if what exp() is cut off at, times all weights, passes for a density."""
    count = 20_000
    fixed = PointSet(np.zeros((count, 2)), np.tile(np.eye(2), (count, 1, 1)), np.full(count, 1e100))
    moving = PointSet(np.zeros((1, 2)), [np.eye(2)])
    expected = 0.5 * 1e12 / 100.0  # half the squared distance in the outlier component's sigmas
    assert_allclose(ROBUST.value([1e6, 0.0, 0.0], fixed, moving), expected, rtol=1e-6)
