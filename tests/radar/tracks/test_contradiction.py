"""Whether a track says that its Doppler velocities cannot be right, and is silent if they are."""

from dataclasses import replace
from itertools import islice, product

import numpy as np
import pytest

from d2d.radar import (
    ErrorBudget,
    Mounting,
    RadarScan,
    Sensor,
    doppler_velocity,
    simulate_drive,
    track,
)
from d2d.radar.tracks import contradiction
from tests.radar.scenes import CORNER, accelerating


def test_a_wrong_unit_is_told():
    """Breaks if km/h are taken for m/s without a word, only multiples of 3.6 are looked at, or a
    vehicle at rest is accused."""
    drive = simulate_drive(np.random.default_rng(3), duration=4.0)
    first, rng = drive.scans[0], np.random.default_rng(4)
    in_kmh = [
        replace(scan, doppler=3.6 * scan.doppler, sigma_doppler=3.6 * scan.sigma_doppler)
        for scan in drive.scans
    ]
    in_dm = [replace(scan, range=10.0 * scan.range) for scan in drive.scans]
    for scans, said in (
        (in_kmh, "3.6 times slower .* not in km/h"),
        (in_dm, "a faster one.* another unit"),
    ):
        with pytest.warns(UserWarning, match=said) as told:
            track((scans, drive.mounting), limits=None)
        assert told[0].filename == __file__  # the caller's line, not one of the package
    still = [
        replace(
            first,
            time=0.1 * i,
            doppler=0.05 * rng.standard_normal(first.size),
            azimuth=first.azimuth + first.sigma_azimuth * rng.standard_normal(first.size),
        )
        for i in range(20)
    ]
    track((still, drive.mounting))  # warnings are errors


def test_fits_by_chance_do_not_hide_a_wrong_sign(monkeypatch):
    """Breaks if fits of another kind that point the other way cancel those of the sign."""
    fits = iter(6 * [("the opposite velocity", [1.0, 0.0])] + 3 * [("a faster one", [-1.0, 0.0])])
    monkeypatch.setattr(contradiction, "_contradiction", lambda *_: [*islice(fits, 1)])
    with pytest.warns(UserWarning, match="in 9 of 11 .* mostly the opposite"):
        contradiction.warn_of_contradiction(np.zeros((11, 3)), lambda _: None)


def compensated(drive):
    """The scans of a radar that subtracts its own motion from the Doppler velocities."""
    own = zip(drive.scans, drive.truth.theta, strict=True)
    return [
        replace(scan, doppler=scan.doppler - doppler_velocity(theta, scan.azimuth, drive.mounting))
        for scan, theta in own
    ]


def test_velocities_that_are_compensated_or_not_filled_in_are_told():
    """Breaks if a moving vehicle gets a track at rest without a word."""
    for speed in (5.0, 15.0):
        drive = simulate_drive(np.random.default_rng(5), 4.0, speed)
        empty = [replace(scan, doppler=np.zeros(scan.size)) for scan in drive.scans]
        for scans in (compensated(drive), empty):
            with pytest.warns(UserWarning, match="a faster one.*compensated for the ego-motion"):
                track((scans, drive.mounting))


def test_correct_drives_are_not_accused():
    """Breaks if positions that fit something else by chance count."""
    for yaw, speed, clutter in product((0.0, 1.57, 2.6), (0.5, 2.5, 10.0), (0.0, 10.0)):
        sensor = Sensor(max_targets=15, sigma_azimuth=0.009, clutter=clutter)
        rng, mounting = np.random.default_rng(1023), Mounting(2.0, 0.5, yaw)
        drive = simulate_drive(rng, 4.0, speed, mounting=mounting, sensor=sensor)
        track((drive.scans, mounting))  # warnings are errors


def test_what_travels_with_the_vehicle_is_no_contradiction():
    """Breaks if a guardrail, whose reflections stay beside the vehicle, accuses the radar."""
    rng, theta, mounting = np.random.default_rng(7), [15.0, 0.0, 0.0], Mounting(2.0, -0.8, -1.5)
    azimuth = np.linspace(-0.7, 0.7, 40)
    scans = [
        RadarScan(
            0.1 * i,
            6.0 / np.cos(azimuth) + 0.05 * rng.standard_normal(40),
            azimuth,
            doppler_velocity(theta, azimuth, mounting) + 0.05 * rng.standard_normal(40),
            0.1,
            0.01,
            0.05,
        )
        for i in range(20)
    ]
    found = track((scans, mounting), limits=None)
    assert found.converged.mean() > 0.5
    assert np.median(found.theta[:, 0]) == pytest.approx(15.0, abs=1.0)


@pytest.mark.parametrize("acceleration", [2.0, -2.0])
def test_a_slow_radar_of_an_accelerating_vehicle_is_not_accused(acceleration):
    """Breaks if the mean velocity of a long interval, which positions show, counts as another."""
    driven = np.array([acceleration, 0.0, 0.0])
    (sensor,), _ = accelerating([1.0], [0.0], driven, [CORNER], noise=1.0, end=6.0)
    track(sensor, budget=ErrorBudget(), limits=None)  # warnings are errors
    (sensor,), _ = accelerating([4.0], [0.0], driven, [CORNER], noise=1.0, end=6.0)
    empty = [replace(scan, doppler=np.zeros(scan.size)) for scan in sensor[0]]
    with pytest.warns(UserWarning, match="a faster one.*compensated for the ego-motion"):
        track((empty, CORNER), budget=ErrorBudget(), limits=None)
