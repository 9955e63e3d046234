"""The benchmark's own functions: a wrong yardstick would make every number on its page wrong."""

import numpy as np
import pytest
from scipy.optimize import approx_fprime, least_squares

from benchmarks.methods import Effort, initial_motion, one_per_call
from benchmarks.numpy_cost import NumpyCost
from benchmarks.scenes import accuracy, draw, known_correspondences, scene
from d2d import CorruptedGaussian, RegistrationCost, register, rigid
from d2d.study.plane.scenarios import OVERLAPPED

OUTLIERS = {"likelihood": None, "robust": CorruptedGaussian(0.2, 100.0 * np.eye(2))}
OFFSET = np.array([0.4, -0.3, 0.05])


@pytest.mark.parametrize("outlier", OUTLIERS.values(), ids=OUTLIERS)
@pytest.mark.parametrize("offset", [0.0 * OFFSET, OFFSET, 100.0 * OFFSET])
def test_numpy_cost_is_the_registration_cost(outlier, offset):
    draws = draw(scene(20), 1, seed=0)
    fixed, moving, theta = draws.fixed[0], draws.moving[0], draws.theta + offset
    value, gradient, _ = RegistrationCost(outlier=outlier).derivatives(theta, fixed, moving)
    ours = NumpyCost(fixed, moving, outlier)
    assert ours.value(theta) == pytest.approx(float(value), rel=1e-12)
    assert ours.value_and_gradient(theta)[0] == ours.value(theta)
    np.testing.assert_allclose(ours.value_and_gradient(theta)[1], gradient, rtol=1e-9, atol=1e-9)


def test_floor_solves_the_weighted_least_squares_of_the_true_pairs():
    draws = draw(OVERLAPPED, 3, seed=2)
    floor = known_correspondences(draws)
    for run, theta in enumerate(floor):
        moved = draws.moving[run].transformed(theta)
        roots = np.linalg.cholesky(np.linalg.inv(moved.covariances + draws.fixed[run].covariances))

        def residuals(motion, run=run, roots=roots):
            means = rigid.transform_means(motion, draws.moving[run].means)
            d = means - draws.fixed[run].means
            return np.einsum("kji,kj->ki", roots, d).ravel()

        best = least_squares(residuals, draws.theta, xtol=1e-14, ftol=1e-14, gtol=1e-14).x
        np.testing.assert_allclose(theta, best, atol=1e-7)
        slope = approx_fprime(theta, lambda x: (residuals(x) ** 2).sum(), 1e-6)
        assert np.abs(slope).max() < 0.05


def test_accuracy_counts_who_ends_at_the_truth():
    theta = np.array([5.0, 0.0, 3.1])
    floor = theta + np.array([[0.1, 0.0, 0.01], [-0.1, 0.0, -0.01]])
    near, far, around = theta + np.array(
        [[0.2, 0.0, -0.02], [4.0, 0.0, 0.0], [0.0, 0.2, 2.0 * np.pi]]
    )
    judged = accuracy(np.array([near, far]), floor, theta, only_at_truth=True)
    assert judged.at_truth == 0.5
    assert judged.translation == pytest.approx(0.2)
    assert judged.over_floor == pytest.approx(2.0)
    assert judged.rotation == pytest.approx(0.02)
    judged = accuracy(np.array([near, far]), floor, theta, only_at_truth=False)
    assert judged.translation == pytest.approx(np.sqrt((0.2**2 + 4.0**2) / 2.0))
    assert accuracy(around[None], floor, theta, only_at_truth=False).rotation < 1e-9


@pytest.mark.parametrize("start", ["truth", "off", "zero"])
def test_every_way_of_one_call_finds_the_motion_of_its_own_run(start):
    draws = draw(scene(20), 3, seed=4)
    initial = initial_motion(draws.theta, start)
    methods = list(one_per_call(draws, draws, start, Effort(3, 2, 1, 1, 1), chosen=()))
    assert len(methods) == (4 if start == "zero" else 6)
    for method in methods:
        cost = RegistrationCost(outlier=OUTLIERS[method.cost])
        found = method.motions(method.solve(method.runs))
        for run, theta in enumerate(found):
            expected = register(draws.fixed[run], draws.moving[run], cost, initial).theta
            np.testing.assert_allclose(theta, expected, atol=1e-12)
