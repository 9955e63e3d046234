"""The covariance from scores: against its formula, the jackknife, and the errors themselves."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import d2d
from d2d import (
    PointSet,
    RegistrationCost,
    credibility,
    register,
    sandwich_covariance,
)
from d2d.sandwich import godambe, target_scores
from d2d.study.plane.scenarios import ALL
from tests.strategies import ROBUST, TRUTH, all_cases, case_id, overlapped_scene, random_problem


@pytest.mark.parametrize("case", all_cases(), ids=case_id)
def test_scores_add_up_to_the_gradient_and_the_hessian(case):
    """Breaks if a target's part of either is not its own, for any cost, also off the optimum."""
    problem = random_problem(np.random.default_rng(3), **case, sizes=(5, 11))
    bound = problem.cost.problem(problem.fixed, problem.moving, problem.measurement)
    scores, hessians = target_scores(bound, bound.bind(problem.theta))
    _, gradient, hessian = problem.derivatives()
    assert_allclose(scores[0].sum(axis=0), gradient, rtol=1e-9, atol=1e-9)
    assert_allclose(hessians[0].sum(axis=0), hessian, rtol=1e-9, atol=1e-9)


def scores_of(rng, targets=40, scale=1.0):
    """Scores that add up to zero, and Hessians of unlike sizes."""
    scores = scale * rng.standard_normal((targets, 3)) * [1.0, 1.0, 10.0]
    root = rng.standard_normal((targets, 3, 3)) * [[[1.0], [1.0], [10.0]]]
    return scores - scores.mean(axis=0), root @ np.swapaxes(root, 1, 2)


def test_many_clear_scores_give_the_jackknife():
    """Breaks if a step is not that of leaving a group out."""
    rng = np.random.default_rng(6)
    scores, hessians = scores_of(rng, scale=1e4)
    total, labels = hessians.sum(axis=0), rng.integers(0, 12, 40)
    together = 1.0 * (labels[:, None] == labels)
    around = np.einsum("kl,lij->kij", together, hessians)
    steps = np.linalg.solve(total - around, scores[..., None])[..., 0]
    found = godambe(scores, hessians, labels)
    assert_allclose(found / (steps.T @ together @ steps), 1.0, rtol=1e-3)


@pytest.mark.parametrize("scenario", ALL, ids=lambda scenario: scenario.name)
def test_independent_targets_are_judged_as_by_the_inverse_hessian(scenario):
    """Breaks if the scatter of so few scores makes the covariance worse: 1000 runs, within 2 %,
    where uncorrected scores give 2 to 3 times the inverse Hessian's ANEES."""
    fixed, moving = scenario.sample(1000, np.random.default_rng(0))
    estimate = register(fixed, moving, ROBUST, scenario.theta)
    good = estimate.converged
    errors = estimate.theta[good] - scenario.theta
    plain = credibility(errors, estimate.covariance[good])
    covariance = sandwich_covariance(estimate, fixed, moving, ROBUST)
    assert_allclose(credibility(errors, covariance[good]).anees, plain.anees, rtol=0.02)
    assert plain.bounds[0] - 0.01 < plain.anees < plain.bounds[1]


def extended_objects(runs, rng, extent):
    """Forty objects of four targets, whose places in the objects are drawn anew in each scan."""
    objects = rng.uniform(0.0, 80.0, (40, 2))
    theta = np.array([0.8, -0.3, 0.05])

    def seen(at):
        points = np.repeat(at, 4, axis=0) + rng.uniform(-extent, extent, (runs, 160, 2))
        noise = np.broadcast_to(0.01 * np.eye(2), (160, 2, 2))
        return PointSet(points + 0.1 * rng.standard_normal(points.shape), noise)

    moved = d2d.rigid.transform_means(d2d.rigid.inverse(theta), objects)
    return seen(objects), seen(moved), theta


def test_extended_objects_are_judged_better():
    """Breaks if the scores do not show that objects return other points of themselves."""
    fixed, moving, theta = extended_objects(200, np.random.default_rng(12), 0.3)
    estimate = register(fixed, moving, ROBUST, theta)
    assert estimate.converged.all()

    def anees(covariance):
        return credibility(estimate.theta - theta, covariance).anees

    assert anees(estimate.covariance) > 2.5
    objects = np.repeat(np.arange(40), 4)
    covariance = sandwich_covariance(estimate, fixed, moving, ROBUST, groups=objects)
    assert 0.8 < anees(covariance) < 1.5


def test_a_cost_that_knows_no_moving_noise_is_seen_through():
    """Breaks if P2D's inverse Hessian, which leaves the moving noise out, stands uncorrected."""
    rng, cost = np.random.default_rng(13), RegistrationCost("p2d")
    for means in (rng.uniform(-20.0, 20.0, (60, 2)), 3.0 * np.arange(60.0)[:, None]):
        fixed = PointSet(means, [0.01 * np.eye(means.shape[1])] * 60)
        noise = 0.3 * rng.standard_normal((200, *means.shape))
        moving = PointSet(means + noise, fixed.covariances)
        estimate = register(fixed, moving, cost)
        covariance = sandwich_covariance(estimate, fixed, moving, cost)
        assert credibility(estimate.theta, estimate.covariance).anees > 5.0
        assert 0.8 < credibility(estimate.theta, covariance).anees < 1.25


def test_batches_come_out_one_by_one():
    """Breaks if members of a batch, or their labels, are mixed up."""
    rng = np.random.default_rng(15)
    fixed, moving = overlapped_scene(7, rng)
    cost = RegistrationCost("p2d")  # far from its inverse Hessian
    estimate = register(fixed, moving, cost, TRUTH)
    labels = rng.integers(0, 5, (7, 8))
    for options in ({}, {"groups": labels}):
        batch = sandwich_covariance(estimate, fixed, moving, cost, **options)
        for i in (0, 3, 6):
            own = dict(options)
            if "groups" in own:
                own["groups"] = [f"object {label}" for label in labels[i]]
            one = register(fixed[i], moving[i], cost, TRUTH)
            single = sandwich_covariance(one, fixed[i], moving[i], cost, **own)
            assert_allclose(single, batch[i], rtol=1e-6)


def test_the_origin_does_not_matter():
    """Breaks if leaving a target out is a step in coordinates about wherever the origin is."""
    fixed, moving, theta = extended_objects(1, np.random.default_rng(19), 0.3)
    fixed, moving = fixed[0], moving[0]
    objects = np.repeat(np.arange(40), 4)

    def spread(sets, start):
        estimate = register(*sets, ROBUST, start)
        assert estimate.converged
        return sandwich_covariance(estimate, *sets, ROBUST, groups=objects)[2, 2] ** 0.5

    expected = spread((fixed, moving), theta)
    for distance in (3e2, 1e4, 1e7):
        origin = distance * np.array([1.0, -0.7])
        start = theta + np.append(origin - d2d.rigid.rotation(theta[2]) @ origin, 0.0)
        found = spread((fixed.shifted(origin), moving.shifted(origin)), start)
        assert_allclose(found, expected, rtol=1e-3)
