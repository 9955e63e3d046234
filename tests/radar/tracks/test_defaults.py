"""The defaults: the same numbers through every door, at their times, as certain as they say."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d.radar import (
    ErrorBudget,
    Mounting,
    Sensor,
    Track,
    Tracker,
    simulate_drive,
    track,
    write_csv,
)
from d2d.radar.cli import main
from d2d.radar.simulation.drive import CAR_SPEED, ROAD_SPEED
from d2d.radar.simulation.world import build_world, lap_motion
from d2d.scores import normalised_squares
from tests.radar.scenes import named_sensors
from tests.radar.tracks.test_files import assert_same
from tests.radar.tracks.test_tracker import fed

CORNERS = (
    Mounting(3.6, 0.7, 0.5),
    Mounting(3.6, -0.7, -0.5),
    Mounting(-0.9, 0.8, 2.5),
    Mounting(-0.9, -0.8, -2.5),
)
FRONT = (Mounting(3.6),)


@pytest.mark.parametrize("count", [1, 3])
def test_every_door_gives_the_same_numbers(tmp_path, count):
    """Breaks if the command line, `track` and `Tracker` have defaults of their own."""
    sensors = {
        name: ([replace(s, time=round(s.time, 6)) for s in scans], at)
        for name, (scans, at) in list(named_sensors(12).items())[:count]
    }
    whole = track(sensors)
    tracker = Tracker({name: at for name, (_, at) in sensors.items()})
    fed(tracker, sensors)
    assert_same(tracker.track, whole)
    for same in ({"horizon": 0.3}, {"budget": ErrorBudget()}, {"carry": True}):
        assert_same(track(sensors, **same), whole)
    log, words = str(tmp_path / "log.csv"), []
    write_csv(log, {name: scans for name, (scans, _) in sensors.items()})
    for name, (_, at) in sensors.items():
        words += ["--mounting", name, *map(repr, (at.x, at.y, float(np.rad2deg(at.yaw))))]
    assert main(["track", "--csv", log, *words, "--output", f"{tmp_path}/d", "--no-picture"]) == 0
    written = Track.load(tmp_path / "d.npz")
    assert_allclose(written.theta, whole.theta, rtol=1e-9, atol=1e-12)  # degrees are rounded
    assert_allclose(written.covariance, whole.covariance, rtol=1e-6, atol=1e-15)


def town(seed, speed, rate, mountings, seconds):
    """Radars that are not in step, on one car, and its true velocity."""
    rng, start, sensors = np.random.default_rng(seed), 17.0 * seed, {}
    world = build_world(rng)
    for i, at in enumerate(mountings):
        late = 0.3 * i / len(mountings) / rate
        drive = simulate_drive(
            rng, seconds, speed, start=start + late, mounting=at, world=world, sensor=Sensor(rate)
        )
        sensors[f"radar {i}"] = [replace(s, time=s.time + late) for s in drive.scans], at
    return sensors, lambda times: lap_motion(times, start, speed).theta


def anees(speed, rate, mountings, seconds, **options):
    """ANEES of the estimates of two drives, and the share that is accepted."""
    squares, accepted = [], []
    for seed in (0, 1):
        sensors, truth = town(seed, speed, rate, mountings, seconds)
        found = track(sensors, **options)
        good = found.converged
        errors = (found.theta - truth(found.times))[good]
        squares.append(normalised_squares(errors, found.covariance[good]))
        accepted.append(good.mean())
    return np.concatenate(squares).mean() / 3.0, np.mean(accepted)


@pytest.mark.parametrize("mountings", [FRONT, CORNERS], ids=["one radar", "four"])
@pytest.mark.parametrize(("rate", "seconds"), [(4.0, 40.0), (10.0, 20.0), (20.0, 12.0)])
def test_covariances_are_credible_on_a_road(mountings, rate, seconds):
    """Breaks if the acceleration is known worse than stated, or without a budget not contained.

    Causal, with no option at all.  The vehicle accelerates as recorded ones do, see `ROAD_SPEED`.
    """
    found, accepted = anees(ROAD_SPEED, rate, mountings, seconds)
    assert 0.8 < found < 1.3
    assert accepted > 0.98


def test_a_hard_drive_is_followed():
    """Breaks if what is said of a car that takes the corners of a block at 8 m/s is wrong."""
    causal, _ = anees(CAR_SPEED, 10.0, CORNERS, 12.0)
    smooth, _ = anees(CAR_SPEED, 10.0, CORNERS, 12.0, smooth=True)
    assert 0.8 < causal < 2.0
    assert 0.8 < smooth < 1.5
