"""A sensor whose stamps are late."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from d2d.radar import ErrorBudget, Tracker, track
from tests.radar.scenes import AROUND, observe
from tests.radar.tracks.test_tracker import added, fed, in_order

NAMES = ("left", "right", "rear")


def changing(rng, late: float, end: float = 7.0, speed=lambda t: 12.0 + 1.5 * np.sin(1.5 * t)):
    """Three sensors of a vehicle that speeds up and slows down; the second one's clock is late."""
    step = 1e-3
    speeds = speed(step * np.arange(round(end / step) + 2))
    driven = np.concatenate([[0.0], np.cumsum(step * speeds)])
    points = rng.uniform([-30.0, -40.0], [130.0, 40.0], (500, 2))
    points = points[np.abs(points[:, 1]) > 4.0]
    sensors = []
    for number, mounting in enumerate(AROUND):
        scans = []
        for ticks in range(20 * number, round(end / step), 77):
            pose, theta = np.eye(3), np.array([speeds[ticks], 0.0, 0.0])
            pose[0, 2] = driven[ticks]
            noise = rng.standard_normal((3, len(points)))
            time = ticks * step + late * (number == 1)
            full = observe(points, pose, time, theta, mounting, noise, (0.1, 0.005, 0.06))
            scans.append(full[(np.abs(full.azimuth) < 0.8) & (full.range < 50.0)])
        sensors.append((scans, mounting))
    return dict(zip(NAMES, sensors, strict=True))


@pytest.mark.parametrize("budget", [ErrorBudget(), None], ids=["budget", "none"])
@pytest.mark.parametrize(("late", "word"), [(0.3, "late"), (-0.3, "early")])
def test_a_sensor_that_is_late_is_named(late, word, budget):
    """Breaks if the wrong sensor is named, the sign is wrong or a tracker says nothing."""
    rng = np.random.default_rng(1)
    sensors = changing(rng, late)
    with pytest.warns(UserWarning, match=rf"^sensors\['right'\]\.scans .* 0\.[23]. s {word}"):
        track(sensors, horizon=0.3, budget=budget)
    tracker = Tracker({name: at for name, (_, at) in sensors.items()}, budget=budget)
    with pytest.warns(UserWarning, match=rf"^'right' seems to be 0\.[23]. s {word}"):
        fed(tracker, sensors)


def test_sensors_on_one_clock_are_not_accused():
    """Breaks if noise names a sensor."""
    for seed in range(3):
        sensors = changing(np.random.default_rng(seed), 0.0)
        track(sensors, horizon=0.3, budget=ErrorBudget())  # warnings are errors


@pytest.mark.parametrize("budget", [ErrorBudget(), None], ids=["budget", "none"])
@pytest.mark.parametrize("name", ["left", "right"])
def test_a_mounting_that_is_turned_is_no_late_clock(name, budget):
    """Breaks if what grows with the speed is taken for what the acceleration does: while a vehicle
    sets off, both fall."""
    sensors = changing(np.random.default_rng(1), 0.0, 8.0, lambda t: np.minimum(2 + 2.5 * t, 14.0))
    scans, at = sensors[name]
    sensors[name] = scans, replace(at, yaw=at.yaw - np.deg2rad(5.0))
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=".* seems to be")
        track(sensors, horizon=0.3, budget=budget)


def test_a_sensor_that_is_late_is_named_while_the_vehicle_drives():
    """Breaks if a service that never ends a drive is not told, or told again and again."""
    sensors = changing(np.random.default_rng(1), 0.3, end=18.0)
    tracker = Tracker({name: at for name, (_, at) in sensors.items()})
    with pytest.warns(UserWarning, match=r"^'right' seems to be 0\.[23]. s late") as said:
        added(tracker, in_order(sensors))
    assert len(said) == 1
    tracker.finish()  # where warnings are errors, says no more
