"""What users of the radar get wrong: each mistake is refused with a message that says it."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d import PointSet
from d2d.radar import (
    Mounting,
    RadarScan,
    VehicleLimits,
    calibrate,
    compare,
    compare_halves,
    doppler_ego_motion,
    doppler_velocity,
    estimate_ego_motion,
    estimate_joint_ego_motion,
    sensor_velocity,
    simulate_drive,
    track,
    track_joint,
)

DRIVE = simulate_drive(np.random.default_rng(0), 1.0)
SCANS, MOUNTING = DRIVE.scans[:4], Mounting(0.4)
SENSORS = [(DRIVE.scans, DRIVE.mounting)]
PAIR = (SCANS[0], SCANS[1], MOUNTING)
MASKED = np.ma.masked_greater([1.0, 9999.0], 100.0)


def cartesian(**options):
    """The scan of one target, with one argument that is out of any range."""
    sigmas = {"sigma_range": 0.1, "sigma_azimuth": 0.1, "sigma_doppler": 0.1}
    return RadarScan.from_cartesian(0.0, [1.0], [1.0], doppler=[0.0], **(sigmas | options))


def assert_refused(*calls):
    """Each call ends in a ValueError that begins with what is said."""
    for call, said in calls:
        with pytest.raises(ValueError, match=f"^{re.escape(said)}"):
            call()


def test_numbers_that_mean_nothing_are_refused_by_name():
    """Breaks if a mask is forgotten, or a number out of any range is computed with."""
    assert_refused(
        (lambda: RadarScan(0.0, MASKED, [0.0, 0.1], [0.0, 0.0], 0.1, 0.01, 0.1), "range must not"),
        (lambda: track(SCANS, MOUNTING, slips=1e-200), "slips must"),
        (lambda: track(SCANS, MOUNTING, slips=1e200), "slips must"),
        (lambda: track(SCANS, MOUNTING, initial=SCANS[0]), "initial must"),
        (lambda: PointSet(SCANS, np.eye(2)), "means must"),
        (lambda: VehicleLimits(speed=np.ones(3)), "speed must"),
        (lambda: cartesian(grid=1e300), "grid must"),
        (lambda: cartesian(step=1e300), "step must"),
        (lambda: compare_halves(SENSORS, np.random.default_rng(0), by="objects"), "by must"),
        (lambda: calibrate([(*SENSORS[0], DRIVE.truth)], max_lag=1e300), "max_lag must"),
        (lambda: SCANS[0].doppler_measurement(MOUNTING, 0.0), "interval must"),
        (lambda: track(SCANS, MOUNTING).write_tum(None), "path must be a path, but is None"),
    )


def test_an_empty_scan_gives_nothing_and_is_refused_where_something_must_be():
    """Breaks if a mean over nothing reaches the kernel."""
    empty = RadarScan(0.0, [], [], [], [], [], [])
    assert_array_equal(sensor_velocity(empty, Mounting()), 0.0)
    assert np.isnan(doppler_ego_motion([(empty, Mounting())]).covariance).all()
    assert_refused((lambda: estimate_ego_motion(empty, *PAIR[1:]), "previous"))


def test_limits_do_not_change_with_what_they_were_made_of():
    """Breaks if an array of no dimensions, which can be written to, is kept as a limit."""
    speed = np.array(30.0)
    limits = VehicleLimits(speed=speed)
    speed[...] = 1e9
    assert limits == VehicleLimits(speed=30.0)


# ---- Scans, sensors, views and pairs of scans


def test_scans_may_come_from_any_iterable():
    """Breaks if a generator, or a zip, is refused, or used up before all of it was read."""
    alone = track(SCANS, MOUNTING)
    assert_array_equal(track(iter(SCANS), MOUNTING).theta, alone.theta)
    sensors = [(SCANS, MOUNTING), ([scan[1:] for scan in SCANS[1:]], Mounting(0.4, 0.2))]
    joint = track_joint(sensors)
    again = track_joint(iter([(iter(scans), mounting) for scans, mounting in sensors]))
    assert_array_equal(again.theta, joint.theta)
    pairs = [PAIR, (SCANS[1], SCANS[2], MOUNTING)]
    together = estimate_joint_ego_motion(pairs)
    assert_array_equal(estimate_joint_ego_motion(iter(pairs)).theta, together.theta)
    views = [(scan, MOUNTING) for scan in SCANS]
    assert_array_equal(doppler_ego_motion(iter(views)).theta, doppler_ego_motion(views).theta)


def test_what_is_no_such_sequence_is_refused_by_name():
    """Breaks if the user gets Python's words about len(), subscripts or unpacking."""
    assert_refused(
        (lambda: track(None, MOUNTING), "scans must be a sequence, but is a NoneType"),
        (lambda: track(SCANS[0], MOUNTING), "scans must be a sequence, but is a RadarScan"),
        (
            lambda: track([SCANS[0], None, SCANS[2]], MOUNTING),
            "scans[1] must be a RadarScan, but is a NoneType",
        ),
        (lambda: track(iter(SCANS[:1]), MOUNTING), "scans must hold at least two scans"),
        (lambda: track_joint(None), "sensors must be a sequence, but is a NoneType"),
        (
            lambda: track_joint((SCANS, MOUNTING)),
            "sensors[0] must be a tuple (Iterable, Mounting), but is a list of length 4",
        ),
        (
            lambda: track_joint([(SCANS, (0.4, 0.0, 0.0))]),
            "sensors[0][1] must be a Mounting, but is a tuple",
        ),
        (
            lambda: track_joint([(SCANS, MOUNTING), (["scan"], MOUNTING)]),
            "sensors[1][0][0] must be a RadarScan, but is a str",
        ),
        (lambda: track_joint([]), "sensors must have at least two rounds of scans, but have 0"),
        (lambda: estimate_joint_ego_motion(iter([])), "pairs must hold at least one pair"),
        (
            lambda: estimate_joint_ego_motion([PAIR[:2]]),
            "pairs[0] must be a tuple (RadarScan, RadarScan, Mounting), but is a tuple of length 2",
        ),
        (
            lambda: estimate_joint_ego_motion(PAIR),
            "pairs[0] must be a tuple (RadarScan, RadarScan, Mounting), but is a RadarScan",
        ),
        (
            lambda: estimate_joint_ego_motion([(PAIR[0], MOUNTING, PAIR[1])]),
            "pairs[0][1] must be a RadarScan, but is a Mounting",
        ),
        (lambda: doppler_ego_motion(None), "views must be a sequence, but is a NoneType"),
        (
            lambda: doppler_ego_motion([(MOUNTING, SCANS[0])]),
            "views[0][0] must be a RadarScan, but is a Mounting",
        ),
    )


def test_a_tilde_in_a_path_is_the_home_folder(tmp_path, monkeypatch):
    """Breaks if a file in a folder of that name is looked for."""
    monkeypatch.setenv("HOME", str(tmp_path))
    track(SCANS, MOUNTING).write_tum("~/driven.tum")
    assert len(np.loadtxt(tmp_path / "driven.tum")) == len(SCANS)


# ---- Units

TURN = 2.0 * np.pi


def test_angles_in_degrees_are_refused():
    """Breaks if degrees are taken for radians, and the drive comes out all zero or backwards."""
    for call, name in (
        (lambda a: RadarScan(0.0, [5.0, 8.0], [0.1, a], [0.0, 0.0], 0.1, 0.01, 0.1), "azimuth"),
        (lambda a: doppler_velocity([5.0, 0.0, 0.0], [0.1, a], MOUNTING), "azimuth"),
        (lambda a: Mounting(1.0, 0.5, a), "yaw"),
    ):
        for degrees in (88.0, -6.3, 6.3):
            said = f"^{name} must be in radians .* but holds {degrees:g}; are these degrees"
            with pytest.raises(ValueError, match=said):
                call(degrees)
        for radians in (TURN, -TURN, np.float32(TURN)):
            call(radians)


def test_a_target_behind_a_sensor_that_looks_back_is_in_front():
    """Breaks if azimuth and yaw, each within a turn, are refused or placed wrongly in their sum."""
    scan = RadarScan(0.0, [5.0], [TURN - 0.1], [0.0], 0.1, 0.01, 0.1)
    placed = scan.point_set(Mounting(1.0, 0.0, TURN - 0.2)).means[0]
    assert_allclose(placed, [1.0 + 5.0 * np.cos(0.3), -5.0 * np.sin(0.3)])


def in_unit(scans, factor):
    """The scans with their times multiplied by a factor."""
    return [replace(scan, time=factor * scan.time) for scan in scans]


TRACKERS = {
    "track": lambda scans, **options: track(scans, MOUNTING, **options),
    "track_joint": lambda scans, **options: track_joint([(scans, MOUNTING)], **options),
    "second-sensor": lambda scans, **options: track_joint(
        [(SCANS, MOUNTING), ([scan[1:] for scan in scans], MOUNTING)], **options
    ),
}


@pytest.mark.parametrize("tracker", TRACKERS)
def test_times_in_milliseconds_are_refused(tracker):
    """Breaks if the drive is a thousand times as long, and its velocity all zero."""
    said = r"must have times in seconds \(s\), at most max_interval = 60 apart, but .*microseconds"
    for factor in (1e3, 1e6, 1e9):
        with pytest.raises(ValueError, match=said):
            TRACKERS[tracker](in_unit(SCANS, factor))


@pytest.mark.parametrize("tracker", TRACKERS)
def test_a_long_pause_is_taken_where_the_user_allows_it(tracker):
    """Breaks if a recording with a gap cannot be read at all."""
    scans = in_unit(SCANS, 700.0)  # 70 s from one to the next
    assert len(TRACKERS[tracker](scans, max_interval=200.0).times) >= len(scans) - 1
    with pytest.raises(ValueError, match="max_interval = 60 apart"):
        TRACKERS[tracker](scans)
    for bad, word in ((0.0, "positive"), (np.nan, "finite"), ("long", "real numbers")):
        with pytest.raises(ValueError, match=f"^max_interval must be .*{word}"):
            TRACKERS[tracker](SCANS, max_interval=bad)


def test_sensors_with_clocks_of_different_days_are_refused():
    """Breaks if a joint track silently joins drives that never overlap."""
    later = [replace(scan, time=scan.time + 86400.0) for scan in SCANS]
    with pytest.raises(ValueError, match=r"^the rounds of all sensors must have times in seconds"):
        track_joint([(SCANS, MOUNTING), (later, MOUNTING)])


def test_a_comparison_is_read_only():
    """Breaks if its cached numbers no longer belong to its errors."""
    found = compare(track(*SENSORS[0]), DRIVE.truth)
    for array in (found.times, found.errors, found.covariances):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
