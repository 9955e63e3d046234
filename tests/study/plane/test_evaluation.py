"""The measures of chapter 6 against naive ones, its bounds on credibility, and its verdicts."""

import numpy as np
import pytest

from d2d import CorruptedGaussian, RegistrationCost, credibility, register
from d2d.study import scenarios
from d2d.study.plane.evaluation import (
    LIKELIHOOD,
    ROBUST,
    SUMMING,
    at_truth,
    distance_and_rotation,
    evaluated,
    over_layouts,
    rms,
    same_draws,
)
from d2d.study.plane.optima import (
    arrival_shares,
    local_minima,
    nearest,
    rotation_profile,
    translation_surface,
)
from d2d.study.plane.thesis_readings import (
    bfgs_errors,
    plain_sum_credibility,
    unweighted_outlier,
)


def test_likelihood_is_credible_in_the_overlapped_scene() -> None:
    found = evaluated(scenarios.OVERLAPPED, LIKELIHOOD).credibility
    assert found.consistent
    assert abs(found.inclination) < 0.3


@pytest.mark.parametrize("scenario", scenarios.ALL, ids=lambda s: s.name)
def test_sum_is_pessimistic_in_every_scene(scenario: scenarios.Scenario) -> None:
    assert evaluated(scenario, SUMMING).credibility.inclination < -3.0


def test_robust_error_under_outliers_is_that_of_the_overlapped_scene() -> None:
    lone, _ = distance_and_rotation(evaluated(scenarios.OUTLIERS, ROBUST).errors)
    clean, _ = distance_and_rotation(evaluated(scenarios.OVERLAPPED, LIKELIHOOD).errors)
    assert 0.9 < rms(lone) / rms(clean) < 1.1


def test_distance_and_rotation_wrap() -> None:
    distance, turn = distance_and_rotation([[3.0, -4.0, 2.0 * np.pi - 0.1]])
    np.testing.assert_allclose(distance, 5.0)
    np.testing.assert_allclose(turn, 0.1)
    assert at_truth(
        [[1.0, 1.0, 2.0 * np.pi + 0.1], [1.0, 1.2, 0.0], [0.0, 0.0, 0.11]]
    ).tolist() == [
        True,
        False,
        False,
    ]


def test_minima_are_minima_and_the_truth_is_among_them() -> None:
    fixed, moving = scenarios.OVERLAPPED.sample(5, np.random.default_rng(5))
    for draw, found in enumerate(local_minima(scenarios.OVERLAPPED, LIKELIHOOD)):
        assert found.log_heights[0] == 0.0
        assert (np.diff(found.log_heights) <= 0.0).all()
        theta = found.errors + scenarios.OVERLAPPED.theta
        _, gradient, hessian = LIKELIHOOD.derivatives(theta, fixed[draw], moving[draw])
        np.testing.assert_allclose(gradient, 0.0, atol=1e-3)
        assert (np.linalg.eigvalsh(hessian)[:, 0] > 0.0).all()
        best = register(fixed[draw], moving[draw], LIKELIHOOD, scenarios.OVERLAPPED.theta).theta
        np.testing.assert_allclose(theta[0], best, atol=1e-6)
        apart = np.abs(theta[:, None] - theta).max(axis=-1) + np.eye(len(theta))
        assert apart.min() > 0.005


def test_a_start_at_the_truth_arrives_and_one_far_off_does_not() -> None:
    shares = arrival_shares(
        scenarios.OVERLAPPED, LIKELIHOOD, np.array([0.0, 40.0]), np.array([0.0, 1.0]), draws=2
    )
    assert shares.shape == (2, 2)
    assert shares[0, 0] == 1.0
    assert shares[1, 1] < 0.5


def test_surfaces_are_the_cost() -> None:
    sets = scenarios.OVERLAPPED.sample(1, np.random.default_rng(0))
    fixed, moving = (each[0] for each in sets)
    theta, offsets = scenarios.OVERLAPPED.theta, np.array([-1.0, 0.5])
    surface = translation_surface(SUMMING, fixed, moving, theta, offsets)
    assert surface[1, 0] == -SUMMING.value(theta + np.array([-1.0, 0.5, 0.0]), fixed, moving)
    profile = rotation_profile(SUMMING, fixed, moving, theta, offsets)
    assert profile[1] == -SUMMING.value(theta + np.array([0.0, 0.0, 0.5]), fixed, moving)


def test_nearest_by_hand() -> None:
    fixed, moving = np.array([[0.0, 0.0], [10.0, 0.0]]), np.array([[1.0, 0.0], [0.0, -9.0]])
    quarter = np.array([0.0, 0.0, np.pi / 2.0])
    np.testing.assert_allclose(nearest(fixed, moving, quarter), [1.0, 1.0])


def test_layouts_do_not_depend_on_each_other() -> None:
    few, more = (over_layouts("outliers", ROBUST, layouts=n, runs=20) for n in (3, 5))
    np.testing.assert_array_equal(few.rmse, more.rmse[:3])
    assert len(set(more.rmse)) == 5


def test_same_draws_are_those_of_the_runs() -> None:
    fixed, moving = same_draws(scenarios.OVERLAPPED, 1000)
    again = register(fixed, moving, SUMMING, scenarios.OVERLAPPED.theta)
    errors = evaluated(scenarios.OVERLAPPED, SUMMING).errors
    np.testing.assert_array_equal(again.theta - scenarios.OVERLAPPED.theta, errors)


def test_bfgs_finds_the_same_optimum_from_the_truth() -> None:
    errors = bfgs_errors(scenarios.OVERLAPPED, ROBUST, "truth", 5)
    ours = evaluated(scenarios.OVERLAPPED, ROBUST).errors[:5]
    np.testing.assert_allclose(errors, ours, atol=1e-4)


def test_hessian_of_the_plain_sum_by_differences() -> None:
    """The Hessian of -f is f times that of -log f at an optimum."""
    fixed, moving = same_draws(scenarios.OVERLAPPED)
    truth = scenarios.OVERLAPPED.theta
    result = evaluated(scenarios.OVERLAPPED, SUMMING)
    step = 1e-3 * np.eye(3)

    def density(theta: np.ndarray) -> float:
        return float(np.exp(-SUMMING.value(theta, fixed[0], moving[0])))

    best = truth + result.errors[0]
    hessian = [
        [
            -(density(best + a + b) - density(best + a - b) - density(best - a + b))
            - density(best - a - b)
            for b in step
        ]
        for a in step
    ]
    hessian = np.array(hessian) / 4e-6
    nees = result.errors[0] @ hessian @ result.errors[0]
    assert plain_sum_credibility(scenarios.OVERLAPPED).nees[0] == pytest.approx(nees, rel=1e-3)


def test_unweighted_outlier_component_is_that_of_the_thesis() -> None:
    """Its target densities are proportional to (1 - a) q + a sum_i N, without w_i."""
    fixed, moving = (each[0] for each in same_draws(scenarios.OUTLIERS, 1))
    theta, count = scenarios.OUTLIERS.theta, fixed.size
    plain = LIKELIHOOD.target_densities(theta, fixed, moving)
    wide = RegistrationCost(outlier=CorruptedGaussian(1.0, 100.0 * np.eye(2)))
    printed = 0.8 * plain + 0.2 * count * wide.target_densities(theta, fixed, moving)
    ours = unweighted_outlier(count).target_densities(theta, fixed, moving)
    np.testing.assert_allclose(printed / ours, printed[0] / ours[0])


def test_nci_is_blind_to_the_sign() -> None:
    """What claim nci-not-enough rests on, for exactly credible errors."""
    errors = np.random.default_rng(0).standard_normal((2000, 3))
    actual = errors.T @ errors / len(errors)
    wide, narrow = credibility(errors, 4.0 * actual), credibility(errors, 0.25 * actual)
    assert wide.nci == pytest.approx(narrow.nci)
    assert wide.inclination == pytest.approx(-narrow.inclination)
