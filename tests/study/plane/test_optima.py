"""The optima of a cost in the plane, and the surfaces that they are read off."""

import numpy as np

from d2d import register
from d2d.study import scenarios
from d2d.study.plane.evaluation import LIKELIHOOD, SUMMING
from d2d.study.plane.optima import (
    DISTANCES,
    TURNS,
    Minima,
    arrival_shares,
    local_minima,
    rotation_profile,
    translation_surface,
)


def test_minima_are_minima_and_the_truth_is_among_them() -> None:
    fixed, moving = scenarios.OVERLAPPED.sample(5, np.random.default_rng(5))
    found = local_minima(scenarios.OVERLAPPED, LIKELIHOOD)
    for draw, (errors, heights) in enumerate(zip(found.errors, found.log_heights, strict=True)):
        assert heights[0] == 0.0
        assert (np.diff(heights) <= 0.0).all()
        theta = errors + scenarios.OVERLAPPED.theta
        _, gradient, hessian = LIKELIHOOD.derivatives(theta, fixed[draw], moving[draw])
        np.testing.assert_allclose(gradient, 0.0, atol=1e-3)
        assert (np.linalg.eigvalsh(hessian)[:, 0] > 0.0).all()
        best = register(fixed[draw], moving[draw], LIKELIHOOD, scenarios.OVERLAPPED.theta).theta
        np.testing.assert_allclose(theta[0], best, atol=1e-6)
        apart = np.abs(theta[:, None] - theta).max(axis=-1) + np.eye(len(theta))
        assert apart.min() > 0.005


def test_minima_are_counted_where_they_are_and_as_high_as_they_are() -> None:
    """Breaks if a peak that nobody sees counts, or one that lies outside the search."""
    near, far, turned = (9.9, 0.0, 0.0), (0.0, 10.1, 0.0), (0.0, 0.0, np.deg2rad(46.0))
    heights = np.log([1.0, 0.0101, 0.0099])
    found = Minima((np.array([near, far, turned]),), (heights,), np.zeros(1))
    assert (found.near.tolist(), found.visible.tolist()) == ([1], [2])
    assert found.right.tolist() == [False]
    at_truth = Minima((np.array([np.zeros(3), near]),), (heights[1:],), np.zeros(1))
    np.testing.assert_allclose(at_truth.rivals, 0.0099 / 0.0101)


def test_a_start_at_the_truth_arrives_and_one_far_off_does_not() -> None:
    shares = arrival_shares(scenarios.OVERLAPPED, LIKELIHOOD)
    assert shares.shape == (len(TURNS), len(DISTANCES))
    assert shares[np.abs(TURNS).argmin(), 0] == 1.0
    assert shares[-1, -1] < 0.5


def test_surfaces_are_the_cost() -> None:
    sets = scenarios.OVERLAPPED.sample(1, np.random.default_rng(0))
    fixed, moving = (each[0] for each in sets)
    theta, offsets = scenarios.OVERLAPPED.theta, np.array([-1.0, 0.5])
    surface = translation_surface(SUMMING, fixed, moving, theta, offsets)
    assert surface[1, 0] == -SUMMING.value(theta + np.array([-1.0, 0.5, 0.0]), fixed, moving)
    profile = rotation_profile(SUMMING, fixed, moving, theta, offsets)
    assert profile[1] == -SUMMING.value(theta + np.array([0.0, 0.0, 0.5]), fixed, moving)
