"""The measures of chapter 6 against naive ones, its bounds on credibility, and its verdicts."""

import numpy as np

from d2d import register
from d2d.study import scenarios
from d2d.study.plane.evaluation import (
    ROBUST,
    SUMMING,
    at_truth,
    distance_and_rotation,
    evaluated,
    over_layouts,
    same_draws,
)


def test_sum_is_pessimistic_in_every_scene() -> None:
    for scenario in scenarios.ALL:
        assert evaluated(scenario, SUMMING).credibility.inclination < -3.0, scenario.name


def test_distance_and_rotation_wrap() -> None:
    distance, turn = distance_and_rotation([[3.0, -4.0, 2.0 * np.pi - 0.1]])
    np.testing.assert_allclose(distance, 5.0)
    np.testing.assert_allclose(turn, 0.1)
    errors = [[1.0, 1.0, 2.0 * np.pi + 0.1], [1.0, 1.2, 0.0], [0.0, 0.0, 0.11]]
    assert at_truth(errors).tolist() == [True, False, False]


def test_layouts_do_not_depend_on_each_other() -> None:
    few, more = (over_layouts("outliers", ROBUST, layouts=n, runs=20) for n in (3, 5))
    np.testing.assert_array_equal(few.rmse, more.rmse[:3])
    assert len(set(more.rmse)) == 5


def test_same_draws_are_those_of_the_runs() -> None:
    fixed, moving = same_draws(scenarios.OVERLAPPED, 1000)
    again = register(fixed, moving, SUMMING, scenarios.OVERLAPPED.theta)
    errors = evaluated(scenarios.OVERLAPPED, SUMMING).errors
    np.testing.assert_array_equal(again.theta - scenarios.OVERLAPPED.theta, errors)
