"""The drive that the first page replays is the one that is stored, and its budget that of d2d."""

import re

import numpy as np

from d2d.radar import ErrorBudget, simulate_drive, track
from d2d.radar.readers.radarscenes import RADARSCENES_BUDGET
from d2d.radar.simulation.drive import CAR_SPEED, Sensor
from tools.replay_data import MOUNTING, SCRIPT, drive, script, shared_errors


def numbers(text):
    return [float(each) for each in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", text)]


def test_the_stored_script_is_current():
    """Breaks if estimates, budget or tool changed: run `python tools/replay_data.py`."""
    stored, fresh = SCRIPT.read_text(encoding="utf-8"), script(drive())
    assert re.sub(r"[-\d.e]+", "", stored) == re.sub(r"[-\d.e]+", "", fresh)
    np.testing.assert_allclose(numbers(stored), numbers(fresh), rtol=2e-3, atol=1e-7)


def test_shared_errors_are_those_of_d2d():
    """Breaks if an effect has a wrong sign or size; d2d sums it over the targets of the scan.

    Both leave the targets' own noise out.  They differ by what the directions of the targets, here
    all taken as straight ahead of the sensor, change.
    """
    sensor = Sensor(quantised=False)
    driven = simulate_drive(
        np.random.default_rng(3), 12.0, CAR_SPEED, mounting=MOUNTING, sensor=sensor
    )
    budget = ErrorBudget(
        azimuth=RADARSCENES_BUDGET.azimuth,
        doppler=RADARSCENES_BUDGET.doppler,
        scale=RADARSCENES_BUDGET.scale,
        lag=RADARSCENES_BUDGET.lag,
    )
    found = track(driven, baseline=2, budget=budget)
    theta = driven.truth.at(found.times).theta
    known = found.converged & np.isfinite(theta).all(axis=1)
    mine = shared_errors(found.times[known], theta[known])
    theirs = found.systematic[known][:, :2, :2]
    sigmas = [np.sqrt(np.median(np.diagonal(s, axis1=1, axis2=2), axis=0)) for s in (mine, theirs)]
    np.testing.assert_allclose(*sigmas, rtol=0.15)
    np.testing.assert_allclose(*(np.median(s[:, 0, 1]) for s in (mine, theirs)), rtol=0.15)
