"""Error propagation: exact cross derivatives, and the covariance that Monte Carlo runs show."""

import tracemalloc
import warnings
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import d2d
from d2d import (
    LinearMeasurement,
    PointSet,
    RegistrationCost,
    propagate_covariance,
    register,
)
from tests.strategies import ROBUST, TRUTH, all_cases, case_id, overlapped_scene, random_problem

LIKELIHOOD = RegistrationCost()
SUMMING = RegistrationCost(fusion="summing")


def shifted(problem, which, by):
    """The problems (M) with the measured coordinates of one kind moved by ``by`` (M, n)."""
    if which in ("fixed", "moving"):
        points = getattr(problem, which)
        means = points.means + by.reshape(-1, *points.means.shape)
        rest = (np.stack([each] * len(by)) for each in (points.covariances, points.weights))
        return problem.with_(**{which: PointSet(means, *rest)})
    m = problem.measurement
    value, gain = m.value, m.gain
    if which == "measured":
        value = value + by
    else:  # the prediction moves by its slope, which is held with the variance
        gain = gain + by[..., None] * m.slope
    changed = LinearMeasurement(value, m.sigma, m.sigma_input, gain, m.slope, m.of_twist)
    return problem.with_(measurement=changed)


def cross_derivatives(problem):
    """The exact ones of a single problem: (N, P, D) or (K, P) of each kind."""
    p, d = len(problem.theta), problem.fixed.dimension
    bound = problem.cost.problem(problem.fixed, problem.moving, problem.measurement)
    blocks = bound.cross_derivatives(bound.bind(problem.theta))._asdict()
    shares = blocks.pop("share")
    assert_allclose(shares[0], bound.inlier_shares(bound.bind(problem.theta)), rtol=1e-12)
    return {
        name: block[0][:, :p, :d] if block.ndim == 4 else block[0][:, :p]
        for name, block in blocks.items()
    }


def numerical(problem, which, count):
    """Differences (count, P) of the gradient in the measured coordinates of one kind."""
    steps = 1e-4 * np.multiply.outer([1.0, -1.0, 2.0, -2.0], np.eye(count))
    gradients = shifted(problem, which, steps.reshape(-1, count)).derivatives()[1]
    ahead, back, far_ahead, far_back = gradients.reshape(4, count, -1)
    return (8.0 * (ahead - back) - (far_ahead - far_back)) / 12e-4


@pytest.mark.parametrize("case", all_cases(), ids=case_id)
def test_cross_derivatives_are_those_of_the_gradient(case):
    """Breaks if a term of d2f / d theta d z is missing or has the wrong sign, for any cost, or a
    pair is left out or counted twice: 101 components are more than two chunks."""
    problem = random_problem(np.random.default_rng(7), **case, sizes=(101, 9))
    cross = cross_derivatives(problem)
    for which in ("fixed", "moving"):
        block = cross[which].swapaxes(1, 2)
        expected = numerical(problem, which, block[..., 0].size).reshape(block.shape)
        assert_allclose(block, expected, rtol=1e-7, atol=1e-7 * np.abs(expected).max())
    if problem.measurement is None:
        assert_array_equal(cross["measured"], 0.0)
        assert_array_equal(cross["input"], 0.0)
        return
    for which in ("measured", "input"):
        expected = numerical(problem, which, problem.moving.size)
        assert_allclose(cross[which], expected, rtol=1e-7, atol=1e-6)


def test_memory_does_not_grow_with_the_pairs():
    """Breaks if an array of the 4 million pairs of two large sets is made: 32 MB and more."""
    rng = np.random.default_rng(14)
    means = rng.uniform(0.0, 150.0, (2000, 2))
    fixed = PointSet(means, 0.04 * np.eye(2))
    moving = PointSet(means + 0.2 * rng.standard_normal((2000, 2)), 0.04 * np.eye(2))
    estimate = register(fixed, moving, ROBUST)
    propagate_covariance(estimate, fixed, moving, ROBUST)
    tracemalloc.start()
    covariance = propagate_covariance(estimate, fixed, moving, ROBUST)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 4e6
    assert_allclose(np.diag(covariance) / np.diag(estimate.covariance), 1.0, atol=0.2)


@pytest.mark.parametrize(
    ("cost", "width"),
    [(LIKELIHOOD, 1.0), (LIKELIHOOD, 4.0), (ROBUST, 4.0), (SUMMING, 4.0)],
    ids=["likelihood as it is", "likelihood", "robust", "sum"],
)
def test_it_is_the_scatter_of_the_optimum_where_the_first_order_holds(cost, width):
    """Breaks if a part of the formula is wrong: 20000 draws, 5 % in every entry of the diagonal.

    The sum's terms are as wide as the noise, so that its optimum is no linear function of it
    (appendix C).  With a width of 4 the noise is a quarter of what the targets report.
    """
    rng = np.random.default_rng(0)
    fixed, moving = overlapped_scene(20_000, rng, 0.2 / width, 0.03 / width)
    fixed, moving = fixed.inflated(width), moving.inflated(width)
    estimate = register(fixed, moving, cost, TRUTH)
    assert estimate.converged.all()
    covariance = propagate_covariance(estimate, fixed, moving, cost) / width**2
    actual = np.cov((estimate.theta - TRUTH).T)
    assert_allclose(np.diag(covariance.mean(axis=0)) / np.diag(actual), 1.0, atol=0.05)


@pytest.mark.parametrize("of_twist", [False, True])
def test_a_measurement_joins_with_its_own_variance(of_twist):
    """Breaks if the measured values' noise, or that of their inputs, is left out."""
    rng = np.random.default_rng(5)
    runs = 4000
    fixed, moving = overlapped_scene(runs, rng)
    gain, slope = rng.standard_normal((2, 8, 3))
    xi = d2d.rigid.logarithm(TRUTH) if of_twist else TRUTH
    sigma = np.hypot(0.02, 0.02 * (slope @ xi))
    value = gain @ xi + sigma * rng.standard_normal((runs, 8))
    measured = LinearMeasurement(value, 0.02, 0.02, gain, slope, of_twist)
    estimate = register(fixed, moving, LIKELIHOOD, TRUTH, measurement=measured)
    covariance = propagate_covariance(estimate, fixed, moving, measurement=measured)
    actual = np.cov((estimate.theta - TRUTH).T)
    assert_allclose(np.diag(covariance.mean(axis=0)) / np.diag(actual), 1.0, atol=0.1)
    alone = register(fixed, moving, LIKELIHOOD, TRUTH)
    without = propagate_covariance(alone, fixed, moving)
    assert not np.allclose(without, covariance, rtol=0.1)


def test_batches_broadcast_and_come_out_one_by_one(monkeypatch):
    """Breaks if members of a batch, or the parts that it is cut into, change places."""
    fixed, moving = overlapped_scene(6, np.random.default_rng(6))
    many = register(fixed[0], moving, ROBUST, np.broadcast_to(TRUTH, (2, 6, 3)))
    singles = [register(fixed[0], moving[i], ROBUST, TRUTH) for i in range(6)]
    for at_once in (1, 80):  # targets of both sets: one problem at a time, or five
        monkeypatch.setattr("d2d.covariance._TARGETS_AT_ONCE", at_once)
        both = propagate_covariance(many, fixed[0], moving, ROBUST)
        assert both.shape == (2, 6, 3, 3)
        assert_array_equal(both, np.swapaxes(both, 2, 3))
        assert_allclose(both[0], both[1], rtol=1e-12)
        for i, one in enumerate(singles):
            single = propagate_covariance(one, fixed[0], moving[i], ROBUST)
            assert_allclose(both[0, i], single, rtol=1e-7)


@pytest.mark.parametrize("opinion", [propagate_covariance, d2d.sandwich_covariance])
def test_what_did_not_converge_has_no_covariance(opinion):
    """Breaks if a covariance is made up where there is no optimum."""
    fixed, moving = overlapped_scene(3, np.random.default_rng(7))
    estimate = register(fixed, moving, LIKELIHOOD, TRUTH)
    lost = np.arange(3)[:, None, None] == 1
    spoiled = replace(estimate, covariance=np.where(lost, np.nan, estimate.covariance))
    covariance = opinion(spoiled, fixed, moving)
    assert_array_equal(np.isnan(covariance).any(axis=(1, 2)), [False, True, False])


@pytest.mark.parametrize("opinion", [propagate_covariance, d2d.sandwich_covariance])
def test_an_estimate_of_other_arguments_is_refused(opinion):
    """Breaks if a cost that was forgotten gives a covariance 23 times too large, without a word."""
    fixed, moving = overlapped_scene(3, np.random.default_rng(12))
    theirs = r"^estimate must be of the same sets or scans, cost, measurement and options"
    for cost in (SUMMING, ROBUST):
        estimate = register(fixed, moving, cost, TRUTH)
        assert np.isfinite(opinion(estimate, fixed, moving, cost)).all()
        assert np.isfinite(opinion(estimate, fixed, moving[[0, 1, 2]], cost)).all()
        with pytest.raises(ValueError, match=theirs):
            opinion(estimate, fixed, moving)
        with pytest.raises(ValueError, match=theirs):
            opinion(estimate, moving, fixed, cost)
        with pytest.raises(ValueError, match=theirs):
            opinion(estimate, fixed, moving[[1, 2, 0]], cost)
        with pytest.raises(ValueError, match=theirs):
            opinion(estimate, fixed, moving.inflated(1.0001), cost)
        lost = replace(estimate, covariance=np.full((3, 3, 3), np.nan))
        assert np.isnan(opinion(lost, fixed, moving)).all()


def test_long_targets_are_warned_of():
    """Breaks if a rotation 25 times too certain is stated without a word, or others are doubted."""
    rng = np.random.default_rng(3)
    r, azimuth = rng.uniform(20.0, 80.0, 30), rng.uniform(-1.0, 1.0, 30)
    for sigma_range, warned in ((0.003, True), (0.1, False)):
        points = PointSet.from_polar(r, azimuth, sigma_range, np.deg2rad(2.0))
        estimate = register(points, points)
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            propagate_covariance(estimate, points, points)
        assert [each.category for each in said] == [RuntimeWarning] * warned
