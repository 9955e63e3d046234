"""A filter on real drives: that it is credible where all of its assumptions hold."""

import numpy as np
import pytest

from benchmarks.road import Drive
from benchmarks.road_filter import Filtered, estimates, filtered
from d2d.radar import ErrorBudget, Mounting, Recording, Sensor, SensorErrors, simulate_drive

BUDGET = ErrorBudget(azimuth=0.005, doppler=0.05)


@pytest.fixture(scope="module")
def drive():
    """Two radars of a robot, which hardly accelerates, with slow errors of their own."""
    rng, recordings, world = np.random.default_rng(4), [], None
    for yaw, doppler in ((0.4, 0.07), (-0.4, 0.04)):
        simulated = simulate_drive(
            rng,
            12.0,
            mounting=Mounting(2.0, yaw, yaw),
            sensor=Sensor(quantised=False, clutter=0.0),
            world=world,
            errors=SensorErrors(azimuth=0.005, doppler=doppler),
        )
        world = simulated.world
        recordings.append(Recording(simulated.scans, simulated.mounting, simulated.truth, BUDGET))
    return Drive.of("a robot", recordings)


def test_slow_errors_as_states_make_the_filter_credible(drive):
    """Breaks if estimates lose their slow errors on the way, or are given as other ones."""
    given = estimates(drive, BUDGET)
    assert len(given) == len(drive.rounds)
    squares = []
    for as_states in (False, True):
        found = filtered(drive, given, as_states)
        inverse = np.linalg.inv(found.covariances)
        squares.append(np.einsum("ni,nij,nj->n", found.errors, inverse, found.errors).mean() / 3.0)
        assert 0.3 < np.nanmean(found.nis) / 3.0 < 1.3
    assert squares[0] > 2.0 * squares[1]
    assert 0.2 < squares[1] < 2.0


def test_what_has_no_reference_is_not_judged():
    errors = np.array([[np.nan] * 3, [0.2, 0.0, 0.0], [0.0, 0.0, 0.2]])
    found = Filtered(np.array([np.nan, 3.0, 30.0]), errors, np.tile(0.04 * np.eye(3), (3, 1, 1)))
    assert found.cells() == ("5.50", "50.0%", "0.33", "100%", "0.141", "0.000", "8.103")
