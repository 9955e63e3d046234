"""The trial of a budget: errors drawn from it, drives in common, and a covariance that holds."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d.study.drives import budget_trial as trial
from d2d.study.drives.budget_trial import INGREDIENTS


def test_errors_have_the_standard_deviations_of_the_budget():
    """Breaks if an error is drawn with another one's, or all errors are drawn alike."""
    wrong = INGREDIENTS["all"]
    drawn = trial.drawn_errors(np.random.default_rng(0), wrong, 400)
    names = ("azimuth", "doppler", "scale", "lag")
    values = np.array([[getattr(own, name) for name in names] for own in drawn])
    sigmas = [getattr(wrong.budget, name) for name in names]
    assert_allclose(values.std(axis=0) / sigmas, 1.0, rtol=0.02)
    assert_allclose(values.mean(axis=0) / sigmas, 0.0, atol=0.02)
    assert np.abs(np.corrcoef(values.T) - np.eye(4)).max() < 0.2
    assert drawn[0].extent == wrong.extent
    assert drawn[0].neighbours == wrong.budget.neighbours
    assert drawn[0].rounding == wrong.rounding


def test_all_ingredients_are_tried_on_the_same_drives():
    """Breaks if an ingredient changes what is detected, or where a drive starts."""
    kinds = [
        trial._simulated(INGREDIENTS[name], 2, 0.3)
        for name in ("no error", "extent, neighbours correlated", "azimuth bias")
    ]
    for other in kinds[1:]:
        for first, second in zip(kinds[0], other, strict=True):
            assert_array_equal(first.truth.poses, second.truth.poses)
            for a, b in zip(first.targets, second.targets, strict=True):
                assert_array_equal(a.point, b.point)
    starts = [drive.truth.poses[0] for drive in kinds[0]]
    assert np.hypot(*(starts[1] - starts[0])[:2]) > 20.0


@pytest.mark.parametrize("name", ["azimuth bias", "shared Doppler error", "scale", "all"])
def test_with_its_budget_the_covariance_is_credible(name):
    """Breaks if simulator and budget do not mean the same by an error."""
    found = trial.trial_errors(INGREDIENTS[name], drives=16, duration=1.5)
    inverse, noise, full = found.anees
    assert inverse > 2.0
    assert noise > 2.0
    assert 0.6 < full < 1.5
    assert found.interval[0, 2] < 1.25
    assert found.covered[2] > 0.86 > 0.75 > found.covered[1]


def test_most_of_a_lag_is_covered_by_its_budget():
    """Breaks if the lag's column is lost; a filter learns too late how hard a car brakes."""
    found = trial.trial_errors(INGREDIENTS["lag"], drives=16, duration=1.5)
    inverse, noise, full = found.anees
    assert full < 0.15 * min(inverse, noise)
    assert found.covered[2] > 0.8 > 0.75 > found.covered[1]


def test_neighbours_that_move_alike_need_their_dependence():
    """Breaks if the scatter is not told, or the budget's length is not the simulator's."""
    alone, alike, unknown = (
        trial.trial_errors(INGREDIENTS[name], drives=16, duration=1.5)
        for name in ("extent", "extent, neighbours correlated", "extent, not stated")
    )
    assert 0.85 < alone.anees[1] < 1.2
    assert_array_equal(alone.anees[1:2], alone.anees[2:])
    assert alike.anees[2] < 0.95 * alike.anees[1]
    assert 0.8 < alike.anees[2] < 1.15
    assert unknown.anees[0] > 2.0
