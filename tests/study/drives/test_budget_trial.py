"""The trial of a budget: errors drawn from it, drives in common, and a covariance that holds."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d.radar import Sensor, simulate_drive
from d2d.study.drives import budget_trial as trial
from d2d.study.drives.budget_trial import CORNERS, INGREDIENTS, Ingredient


def test_errors_have_the_standard_deviations_of_the_budget():
    """Breaks if an error is drawn with another one's, or is not a sensor's own or all sensors'."""
    wrong = INGREDIENTS["all"]
    drawn = trial.drawn_errors(np.random.default_rng(0), wrong, 400, 4)
    for name in ("azimuth", "doppler", "scale", "lag"):
        values = np.array([[getattr(own, name) for own in drive] for drive in drawn])
        assert_allclose(values.std(axis=0), getattr(wrong.budget, name), rtol=0.02)
        assert_allclose(values.mean(axis=0), 0.0, atol=0.02 * getattr(wrong.budget, name))
        between = np.corrcoef(values[:, 0], values[:, 1])[0, 1]
        assert between > 0.999 if name in ("scale", "lag") else abs(between) < 0.2
    assert drawn[0][0].extent == wrong.extent
    assert drawn[0][0].neighbours == wrong.budget.neighbours
    assert drawn[0][0].rounding == wrong.rounding


def test_all_ingredients_are_tried_on_the_same_drives():
    """Breaks if an ingredient changes what is detected, or where a drive starts."""
    kinds = [
        trial._simulated(INGREDIENTS[name], (CORNERS[0],), 2, 0.3, 1)
        for name in ("nothing", "extent, neighbours correlated", "azimuth")
    ]
    for other in kinds[1:]:
        for (first,), (second,) in zip(kinds[0], other, strict=True):
            assert_array_equal(first.truth.poses, second.truth.poses)
            for a, b in zip(first.targets, second.targets, strict=True):
                assert_array_equal(a.point, b.point)
    starts = [views[0].truth.poses[0] for views in kinds[0]]
    assert np.hypot(*(starts[1] - starts[0])[:2]) > 20.0


def test_what_is_told_is_each_targets_own_error():
    """Breaks if the extent or the error of rounding is not added to what the sensor reports."""
    scan = simulate_drive(np.random.default_rng(0), 0.1, sensor=Sensor()).scans[0]
    known = trial.told(scan, Ingredient(extent=0.3, rounding=4.0))
    assert_array_equal(known.extent, 0.3)
    assert_allclose(known.sigma_doppler**2 - scan.sigma_doppler**2, 0.25**2 / 12.0, rtol=1e-9)
    assert_allclose(known.sigma_azimuth**2 - scan.sigma_azimuth**2, 0.0008**2 / 12.0, rtol=1e-9)
    assert trial.told(scan, Ingredient(extent=0.3, rounding=4.0, told=False)) is scan


@pytest.mark.parametrize("name", ["azimuth", "Doppler", "scale", "lag", "all"])
def test_with_its_budget_the_covariance_is_credible(name):
    """Breaks if simulator and budget do not mean the same by an error."""
    found = trial.judge(INGREDIENTS[name], drives=16, duration=1.5)
    inverse, noise, full = found.anees
    assert inverse > 2.0
    assert noise > 2.0
    assert 0.6 < full < 1.5
    assert found.interval[0, 2] < 1.25
    assert found.covered[2] > 0.86 > 0.75 > found.covered[1]


def test_neighbours_that_move_alike_need_their_dependence():
    """Breaks if the scatter is not told, or the budget's length is not the simulator's."""
    alone, alike, unknown = (
        trial.judge(INGREDIENTS[name], drives=16, duration=1.5)
        for name in ("extent", "extent, neighbours correlated", "extent, not stated")
    )
    assert 0.85 < alone.anees[1] < 1.2
    assert_array_equal(alone.anees[1:2], alone.anees[2:])
    assert alike.anees[1] > 1.15
    assert 0.8 < alike.anees[2] < 1.15
    assert unknown.anees[0] > 2.0


def test_several_sensors_can_be_tried():
    """Breaks if sensors share their own errors, or ingredients are exchanged."""
    names = ("nothing", "Doppler")
    found = trial.budget_trial(names, mountings=CORNERS[:2], drives=6, duration=0.5)
    assert found.anees.shape == found.covered.shape == (2, 3)
    assert found.intervals.shape == (2, 2, 3)
    assert found.anees[1, 1] > 3.0 > found.anees[1, 2]
