"""Six reasons for a covariance that is too small: each is as large as it is by construction."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d import PointSet, register
from d2d.study.guides import small_covariance as small
from d2d.study.plane.evaluation import LIKELIHOOD
from d2d.study.plane.scenarios import OVERLAPPED

THETA = OVERLAPPED.theta
FIXED, MOVING = OVERLAPPED.sample(400, np.random.default_rng(3))


def anees(fixed: PointSet, moving: PointSet) -> float:
    return small.judged(register(fixed, moving, LIKELIHOOD, THETA), THETA).anees


def test_repeated_targets_divide_the_covariance_and_nothing_else():
    """Breaks if a copy has an error of its own, or moves the optimum."""
    one = register(FIXED[:5], MOVING[:5], LIKELIHOOD, THETA)
    three = register(small.repeated(FIXED[:5], 3), small.repeated(MOVING[:5], 3), LIKELIHOOD, THETA)
    assert_allclose(three.theta, one.theta, atol=1e-6)
    assert_allclose(three.covariance, one.covariance / 3.0, rtol=1e-4)


def test_unit_weights_are_repaired_by_the_residuals():
    """Breaks if the variance of the residuals is not that of two points."""
    plain = small.unit_weights(FIXED)
    assert_allclose(plain.covariances[0], np.broadcast_to(np.eye(2), (8, 2, 2)))
    assert_allclose(plain.means, FIXED.means)
    rng = np.random.default_rng(0)
    noisy = [
        PointSet(
            0.3 * rng.standard_normal((4000, 8, 2)) + true, np.eye(2) + np.zeros((4000, 8, 2, 2))
        )
        for true in OVERLAPPED.true_sets
    ]
    found = register(*noisy, LIKELIHOOD, THETA)
    variance = small.residual_variance(found.theta, *noisy) / 2.0
    assert variance.mean() == pytest.approx(0.09, rel=0.05)
    scaled = small.judged(found, THETA, found.covariance * variance[:, None, None])
    # with 13 degrees of freedom the variance itself is known roughly: E(1 / chi^2) = 1 / 11
    assert scaled.anees == pytest.approx(13.0 / 11.0, rel=0.05)
    assert small.judged(found, THETA).anees < 0.15


def test_halves_see_all_reasons_but_the_shared_bias():
    """Breaks if the table of the page says something else than its text."""
    found = {each.name: each for each in small.halves_of_each_reason(runs=400)}
    for name in ("nothing wrong", "4 turned by 5 deg", "3 repeated, by point"):
        assert found[name].halves < 1.15, name
    for name in ("4 turned by 5 deg", "3 repeated, by point"):
        assert found[name].truth > 4.0, name
    assert found["nothing wrong"].truth == pytest.approx(1.0, abs=0.1)
    assert found["1 sigmas half as large"].halves == pytest.approx(4.0, rel=0.1)
    assert found["3 repeated, by target"].halves == pytest.approx(small.COPIES, rel=0.1)
    assert found["5 P2D"].halves == pytest.approx(2.0, rel=0.15)
    assert found["5 sum"].halves < 0.5
    assert found["2 start at zero"].halves > 20.0
    assert found["6 no partner"].halves > 1.5


def test_halves_are_of_different_targets():
    """Breaks if both halves hold the same targets, or the first half always the same ones."""
    each = small.halves(FIXED, MOVING, LIKELIHOOD, THETA, np.arange(8))
    assert each.anees == pytest.approx(1.0, abs=0.15)
    pairs = small.halves(FIXED, MOVING, LIKELIHOOD, THETA, np.arange(8) // 2)
    assert pairs.anees == pytest.approx(1.0, abs=0.15)
    assert abs(pairs.nees - each.nees).max() > 0.1
    two = small.repeated(FIXED, 2), small.repeated(MOVING, 2)
    together = small.halves(*two, LIKELIHOOD, THETA, np.repeat(np.arange(8), 2))
    assert_allclose(together.nees, 2.0 * each.nees, rtol=0.05)


def test_stated_noise_counts_squared():
    """Breaks if standard deviations are scaled where variances are meant."""
    factor = 0.5
    wrong = anees(FIXED.inflated(factor), MOVING.inflated(factor))
    assert wrong == pytest.approx(anees(FIXED, MOVING) / factor**2, rel=0.02)


def test_a_bias_does_not_average_out():
    """Breaks if the error falls with the number of targets as the inverse Hessian does."""
    rows = small.bias_against_targets()
    first, last = rows[0], rows[-1]
    assert last.targets > 4.0 * first.targets
    assert last.stated < 0.5 * first.stated
    assert last.rmse > 2.0 * last.stated
    for each in rows:
        assert 0.7 < each.budgeted / each.rmse < 1.1
    _, ax = plt.subplots()
    small.draw_bias(ax, rows)
    assert len(ax.lines) == 3


def test_each_test_sees_what_it_can_see():
    """Breaks if the page recommends a test that is blind, or calls one blind that is not."""
    found = small.without_truth()
    right = found["nothing wrong"]
    assert all(0.8 < each < 1.6 for each in right)
    wrong = found["all sigmas half as large"]
    assert all(each > 3.0 for each in wrong)
    objects = found["objects with a common error"]
    assert objects.by_object > 1.5 * objects.by_target
    turned, alike = found["each sensor turned"], found["both sensors turned alike"]
    assert turned.truth > 3.0
    assert turned.two_sensors > 3.0
    assert max(turned.by_target, turned.by_object) < 1.6
    for blind in (alike, found["a clock 50 ms late"]):
        assert blind.truth > 3.0
        assert max(blind.by_target, blind.by_object, blind.two_sensors) < 1.8
