"""What a Kalman filter gets: columns of slow errors, white noise, and nothing counted twice."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d.radar import (
    ErrorBudget,
    Mounting,
    Sensor,
    SensorErrors,
    Tracker,
    VelocityEstimate,
    simulate_drive,
)
from d2d.radar.simulation.drive import CAR_MOUNTING, CAR_SPEED
from d2d.radar.simulation.world import lap_motion
from tests.radar.scenes import named_sensors
from tests.radar.tracks.test_tracker import fed

BUDGET = ErrorBudget(azimuth=0.004, doppler=0.03, scale=0.004, lag=0.03)
SENSOR = Sensor(quantised=False, clutter=0.0)


def estimated(drive, mounting=CAR_MOUNTING, budget=BUDGET, **options) -> list[VelocityEstimate]:
    """The estimates of a drive with one radar, each scan registered with the one before."""
    tracker = Tracker({"radar": mounting}, baseline=1, budget=budget, limits=None, **options)
    return [each for scan in drive.scans for each in tracker.add("radar", scan)]


def of_car(rng, duration, **given):
    return simulate_drive(rng, duration, CAR_SPEED, mounting=CAR_MOUNTING, sensor=SENSOR, **given)


def true_motion(times, start):
    """Velocities (n, 3) and accelerations (n, 3) of the car."""
    later, earlier = (lap_motion(times + by, start, CAR_SPEED).theta for by in (0.005, -0.005))
    return lap_motion(times, start, CAR_SPEED).theta, (later - earlier) / 0.01


def test_each_sensor_has_columns_of_its_own():
    sensors = named_sensors(6)
    tracker = Tracker({name: at for name, (_, at) in sensors.items()}, budget=BUDGET, side_slip=0.1)
    del sensors["right"][0][4]
    for i, each in enumerate(fed(tracker, sensors)):
        slow = each.filter_input.slow
        assert slow.shape == (3, 8)
        without = [1, 4] if i == 3 else []
        assert np.flatnonzero(~slow.any(axis=0)).tolist() == without


@pytest.mark.parametrize(
    ("name", "small", "component", "column"),
    [("azimuth", 1e-4, 1, 0), ("doppler", 1e-3, 0, 1), ("scale", 1e-4, 0, 2), ("lag", 0.05, 0, 4)],
)
def test_a_column_is_what_its_error_does_to_the_velocity(name, small, component, column):
    """Breaks if a column has the wrong sign or size: the budget squares it, a filter does not."""
    budget, start = ErrorBudget(**{name: small}), 4.5

    def driven(errors):
        drive = of_car(np.random.default_rng(2), 3.0, start=start, errors=errors)
        return estimated(drive, budget=budget)

    plain, wrong = driven(None), driven(SensorErrors(**{name: small}))
    _, accelerations = true_motion(np.array([each.time for each in plain]), start)
    expected, moved = [], []
    for before, after, acceleration in zip(plain, wrong, accelerations, strict=True):
        unit = np.eye(5)[column]
        values = [
            before.filter_input.expected(before.theta, acceleration, slow)[0]
            for slow in (unit, 0.0 * unit)
        ]
        expected.append((values[0] - values[1])[component])
        moved.append((after.filter_input.velocity - before.filter_input.velocity)[component])
    expected, moved = np.array(expected), np.array(moved)
    assert np.abs(expected).max() > 1e-5
    within = 0.2 if name == "lag" else 0.02  # with a lag other targets are seen
    assert expected @ moved / (expected @ expected) == pytest.approx(1.0, abs=within)


def test_the_prior_pulls_as_its_column_says():
    """Breaks if the side slip's column has the wrong sign: a filter would add its error."""
    ahead = Mounting(CAR_MOUNTING.x - 1.0)  # of an origin that moves sideways by omega m/s
    drive = of_car(np.random.default_rng(3), 3.0, start=4.5)
    free, held = (estimated(drive, ahead, ErrorBudget(), side_slip=slip) for slip in (True, 0.05))
    slip = drive.truth.theta[1:, 2]
    column = np.array([each.filter_input.slow[:, 3] for each in held])
    off = np.array([each.filter_input.velocity for each in held])[:, 1] - slip
    expected = column[:, 1] * slip / 0.05
    assert expected @ off / (expected @ expected) == pytest.approx(1.0, abs=0.1)
    assert not np.array([each.filter_input.slow[:, 3] for each in free]).any()


def test_derivatives_are_those_of_the_expected_velocity():
    """Breaks if a filter linearises something else than what it predicts."""
    seen = estimated(of_car(np.random.default_rng(4), 0.5))[-1].filter_input
    state = np.random.default_rng(5).standard_normal(11)
    value, to = seen.expected(state[:3], state[3:6], state[6:])
    for i, unit in enumerate(1e-6 * np.eye(11)):
        moved = state + unit
        after, _ = seen.expected(moved[:3], moved[3:6], moved[6:])
        assert_allclose((after - value) / 1e-6, to[:, i], atol=1e-6)
    with pytest.raises(ValueError, match=r"^slow must have the shape \(5,\), but has \(4,\)"):
        seen.expected(state[:3], state[3:6], state[6:10])


def test_bare_pairs_and_failures_have_none():
    """Breaks if a filter is given what nothing is known of."""
    drive = of_car(np.random.default_rng(8), 0.5)
    assert [each.filter_input for each in estimated(drive, budget=None, carry=False)] == [None] * 5
    drive.scans[2] = drive.scans[2][:0]
    found = [each.filter_input is not None for each in estimated(drive)]
    assert found == [True, False, True, True, True]
