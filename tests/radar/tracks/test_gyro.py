"""A gyro beside the radar: what it adds to the yaw rate and the heading, and nothing later."""

import numpy as np
import pytest

from d2d.radar import ErrorBudget, Gyro, Reference, Sensor, Tracker, simulate_drive, track
from d2d.radar.simulation.drive import CAR_MOUNTING, ROAD_SPEED
from d2d.radar.simulation.world import lap_motion
from d2d.scores import normalised_squares
from tests.radar.tracks.test_files import assert_same

SIGMA, BIAS = (float(x) for x in np.deg2rad([0.2, 0.8]))
DRIVE = simulate_drive(
    np.random.default_rng(0), 20.0, ROAD_SPEED, mounting=CAR_MOUNTING, sensor=Sensor()
)
TIMES = np.arange(-0.5, 20.0, 0.01)


def gyro(bias=BIAS, at=TIMES, **more):
    """A gyro of 100 Hz with a bias, on the car of the drive, and the times that it states."""
    noise = SIGMA * np.random.default_rng(1).standard_normal(len(TIMES))
    rates = lap_motion(TIMES, 0.0, ROAD_SPEED).theta[:, 2] + bias + noise
    return Gyro(SIGMA, float(np.deg2rad(1.0)), at, rates, **more)


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("bias", [BIAS, -2.0 * BIAS])
def test_yaw_rates_are_better_and_as_sure_as_they_say(bias, smooth):
    """Breaks if the bias is taken for motion, or the gyro's mean rate for that at its end."""
    truth = DRIVE.truth.theta[1:]
    alone, both = (
        track(DRIVE, gyro=each, smooth=smooth, limits=None) for each in (None, gyro(bias))
    )
    off, better = (each.theta - truth for each in (alone, both))
    assert np.std(better[50:, 2]) < 0.4 * np.std(off[50:, 2])
    assert abs(np.mean(better[50:, 2])) < np.deg2rad(0.15)
    assert 0.4 < normalised_squares(better, both.covariance)[50:].mean() / 3.0 < 2.0
    ahead = both.displacement([5.0], [19.0]).covariance[0, 2, 2]
    assert ahead < 0.7 * alone.displacement([5.0], [19.0]).covariance[0, 2, 2]


def test_the_heading_goes_on_where_the_radar_sees_nothing():
    """Breaks if the gyro counts only beside estimates."""
    scans = [scan[:0] if 8.0 < scan.time < 12.0 else scan for scan in DRIVE.scans]
    found = track((scans, CAR_MOUNTING), gyro=gyro(), limits=None)
    yaws = found.poses()[1:, 2], np.unwrap(DRIVE.truth.poses[1:, 2])
    turned, true = (np.diff(np.interp([7.5, 12.5], found.times, yaw)) for yaw in yaws)
    assert turned == pytest.approx(true, abs=np.deg2rad(3.0))


def test_a_tracker_uses_what_it_has_been_given():
    """Breaks if a yaw rate of a later time is used, or the same log gives other numbers."""
    whole, given = track(DRIVE, gyro=gyro()), gyro()
    tracker = Tracker({"front": CAR_MOUNTING}, gyro=Gyro(given.sigma, given.bias))
    before = -np.inf
    for scan in DRIVE.scans:
        new = (given.times > before) & (given.times <= scan.time)
        tracker.add_gyro(given.times[new], given.yaw_rates[new])
        tracker.add("front", scan)
        before = scan.time
    tracker.finish()
    assert_same(tracker.track, whole)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Gyro(times=[0.0, 0.0], yaw_rates=[0.0, 0.0]), "times of the gyro must be"),
        (lambda: Gyro(times=[0.0], yaw_rates=[0.0, 0.0]), "yaw_rates must have the shape"),
        (lambda: Gyro(times=[0.0], yaw_rates=[1e6]), "yaw_rates must be in rad/s"),
        (lambda: Gyro(sigma=0.0), "sigma must be"),
        (lambda: Gyro(bias=1e200), "bias must be"),
        (lambda: track(DRIVE, gyro=1.0), "gyro must be a Gyro"),
        (lambda: track(DRIVE, gyro=gyro(), carry=False), "gyro must be None without carry"),
        (lambda: track(DRIVE, gyro=gyro(at=TIMES + 1e9)), "gyro must have .* only 0 of 200 rounds"),
        (lambda: track(DRIVE, gyro=gyro(at=1e3 * TIMES)), "gyro must have .* in another unit"),
        (lambda: Tracker({"a": CAR_MOUNTING}).add_gyro([0.0], [0.0]), "gyro must be given to"),
    ],
)
def test_what_is_no_gyro_is_refused(make, said):
    with pytest.raises(ValueError, match=f"^{said}"):
        make()


def test_what_is_checked_does_not_change():
    """Breaks if an edit afterwards, of the user's array or of its copy, is not checked."""
    times = np.arange(3.0)
    kept, reference = Gyro(times=times, yaw_rates=times), Reference(times, np.eye(3), np.eye(3))
    times[:] = 0.0
    for array in (kept.times, kept.yaw_rates, reference.times, reference.theta, reference.poses):
        assert array.any()
        assert not array.flags.writeable


def test_a_budget_does_not_hide_a_gyro():
    """Breaks if the slow errors and the bias take each other's place, or a sway adds to a gyro."""
    budget = ErrorBudget(azimuth=0.002, doppler=0.02, lag=0.01, sway=0.1)
    found = track(DRIVE, gyro=gyro(), budget=budget)
    assert (found.covariance[:, 2, 2] < 0.01).all()
    assert found.errors.shape[1:] == (2, 7, 7 + 5)
    assert np.std((found.theta - DRIVE.truth.theta[1:])[50:, 2]) < np.deg2rad(0.3)
