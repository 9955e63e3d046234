"""What counts as a sensor, rounds of scans, and the pairs of a round."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from d2d.radar import Mounting, Recording, track
from d2d.radar.tracks.rounds import check_sensors, round_pairs, rounds
from tests.radar.scenes import AROUND, CORNER, beginning, surround_scans, two_scans

SENSORS = surround_scans(5)
SCANS, MOUNTING = SENSORS[0]


def at_times(times):
    """A scan at each time."""
    scan = two_scans(np.random.default_rng(67), [5.0, 0.0, 0.0])[0]
    return [replace(scan, time=float(time)) for time in times]


def test_sensors_given_in_any_way_give_the_same_bits():
    """Breaks if a way of giving them changes the scans, the order or the path of computation."""
    drive = beginning(6)
    pair = (drive.scans, drive.mounting)
    recording = Recording(drive.scans, drive.mounting, drive.truth)
    assert_same_tracks(
        track(drive),
        track(pair),
        track(recording),
        track((iter(drive.scans), drive.mounting)),
        track([pair]),
        track({"front": recording}),
    )
    lazy = ((iter(scans), mounting) for scans, mounting in SENSORS)
    recordings = [Recording(*sensor, drive.truth) for sensor in SENSORS]
    assert_same_tracks(
        track(SENSORS),
        track(tuple(SENSORS)),
        track(lazy),
        track(recordings),
        track({"left": SENSORS[0], 2: recordings[1], "rear": SENSORS[2]}),
    )


def assert_same_tracks(first, *others):
    for other in others:
        for name in ("times", "theta", "covariance", "inliers"):
            assert_array_equal(getattr(other, name), getattr(first, name))


def test_what_is_no_sensor_is_refused_by_name():
    """Breaks if the user gets Python's words about len(), subscripts or unpacking."""
    no_sensor = "must be a Recording or a tuple"
    for given, said in (
        (None, "sensors must be a sequence, but is a NoneType"),
        (SCANS, rf"sensors\[0\] {no_sensor} \(scans, Mounting\), but is a RadarScan"),
        ((SCANS, (3.6, 0.7, 0.4)), rf"sensors\[0\] {no_sensor}"),
        ([(MOUNTING, SCANS)], rf"sensors\[0\] {no_sensor}"),
        ({"front": SCANS}, rf"sensors\['front'\] {no_sensor}"),
        ((7, MOUNTING), "scans must be a sequence, but is a int"),
        (([SCANS[0], None], MOUNTING), r"scans\[1\] must be a RadarScan, but is a NoneType"),
        ({"left": (["scan"], MOUNTING)}, r"sensors\['left'\].scans\[0\] must be a RadarScan"),
        ([], "sensors must have at least two rounds of scans"),
        ((SCANS[:1], MOUNTING), r"sensors .* \(of one sensor: two scans\), but have 1"),
        ([(scans[:1], at) for scans, at in SENSORS], "sensors must have .* but have 1"),
    ):
        with pytest.raises(ValueError, match=f"^{said}"):
            track(given)
    with pytest.raises(TypeError, match="takes 1 positional argument"):
        track(SCANS, MOUNTING)


def test_scans_out_of_time_order_are_refused_by_name():
    """Breaks if an interval of zero divides, or the error does not say which scan; two sensors may
    share a time."""
    swapped, twice = at_times([0.0, 0.2, 0.1]), at_times([0.0, 0.1, 0.1])
    for scans in (swapped, twice):
        with pytest.raises(ValueError, match=r"^scans must be in strictly increasing .* scan 2"):
            track((scans, CORNER))
        with pytest.raises(ValueError, match=r"^sensors\['rear'\]\.scans must be in .* scan 2"):
            track({"front": SENSORS[0], "rear": (scans, CORNER)})
    assert track(surround_scans(4, shift=0.0)).converged.all()


def test_one_sensor_given_twice_is_refused():
    """Breaks if a slip of the pen halves the covariance, or puts one radar at two places."""
    copies = [replace(scan) for scan in SCANS]
    for second in (SENSORS[0], (copies[3:], AROUND[1])):
        said = r"^sensors\[0\].scans and sensors\[1\].scans must be different"
        with pytest.raises(ValueError, match=said):
            track([SENSORS[0], second])
    none, alone = [scan[:0] for scan in SCANS], [scan[:1] for scan in SCANS]
    for few in (none, alone):  # which may be alike by chance
        assert len(check_sensors([(few, CORNER), (few, AROUND[1])])) == 2


def test_times_in_another_unit_and_long_gaps_are_refused_unless_allowed():
    """Breaks if a drive in ms is a thousand times as long, or a recording with a gap unreadable."""

    def in_unit(factor):
        return [replace(scan, time=factor * scan.time) for scan in SCANS]

    said = r"must have times in seconds \(s\), at most max_interval = 60 apart, but .*microseconds"
    for factor in (1e3, 1e6, 1e9):
        for sensors in ((in_unit(factor), MOUNTING), [SENSORS[1], (in_unit(factor), MOUNTING)]):
            with pytest.raises(ValueError, match=f"scans {said}"):
                track(sensors)
    slow = in_unit(700.0)  # 70 s from one to the next
    with pytest.raises(ValueError, match="max_interval = 60 apart"):
        track((slow, MOUNTING))
    assert len(track((slow, MOUNTING), max_interval=200.0).times) == 4
    with pytest.raises(ValueError, match=r"^max_interval must be positive"):
        track(SENSORS, max_interval=0.0)
    tomorrow = [replace(scan, time=scan.time + 86400.0) for scan in SCANS]
    with pytest.raises(ValueError, match=r"^the rounds of all sensors must have times in seconds"):
        track([SENSORS[1], (tomorrow, MOUNTING)])


def test_a_wrong_baseline_or_horizon_is_refused_by_name():
    """Breaks if a scan can be registered with itself, or one of two options is ignored."""
    for baseline in (0, -1, 1.5, True):
        with pytest.raises(ValueError, match=r"^baseline must be an integer"):
            track(SENSORS, baseline=baseline)
    for options in ({"horizon": 0.0}, {"horizon": 300.0}, {"horizon": 0.3, "baseline": 2}):
        with pytest.raises(ValueError, match=r"^horizon"):
            track(SENSORS, **options)


def test_rounds_hold_each_sensor_once_and_follow_time():
    """Breaks if a scan is used twice or never, or a gap of one sensor stops the others."""
    for times, expected in (
        ([[0.0, 1.0, 2.0]], [[(0, 0)], [(0, 1)], [(0, 2)]]),
        ([[0.0, 1.0], [0.5, 1.5]], [[(0, 0), (1, 0)], [(0, 1), (1, 1)]]),
        ([[0.5, 1.5], [0.0, 1.0]], [[(1, 0), (0, 0)], [(1, 1), (0, 1)]]),
        # the second sensor misses its turn, and comes back
        ([[0.0, 1.0, 2.0], [0.1, 2.1]], [[(0, 0), (1, 0)], [(0, 1)], [(0, 2), (1, 1)]]),
        ([[0.0, 1.0], [0.0, 1.0]], [[(0, 0), (1, 0)], [(0, 1), (1, 1)]]),
        ([[], [0.0]], [[(1, 0)]]),
        # at equal times, sensors stay together whichever is named first and starts late
        ([[0.0, 1.0, 2.0], [1.0, 2.0]], [[(0, 0)], [(0, 1), (1, 0)], [(0, 2), (1, 1)]]),
        ([[1.0, 2.0], [0.0, 1.0, 2.0]], [[(1, 0)], [(0, 0), (1, 1)], [(0, 1), (1, 2)]]),
    ):
        assert rounds([at_times(own) for own in times]) == expected


def test_pairs_leave_out_first_and_empty_scans():
    """Breaks if a scan is registered with nothing, or with one of another sensor."""
    scans = at_times([0.0, 0.1, 0.2, 0.3])
    sensors = [(scans, CORNER), ([*scans[:2], scans[2][:0], scans[3]], Mounting())]
    for group, baseline, expected in (
        ([(0, 1), (1, 0)], 1, [(0, 1)]),
        ([(0, 3), (1, 3)], 1, [(2, 3)]),
        ([(0, 3), (1, 3)], 2, [(1, 3), (1, 3)]),
        ([(0, 1), (1, 1)], 5, [(0, 1), (0, 1)]),
    ):
        pairs = round_pairs(sensors, group, baseline)
        assert [(p.previous.time, p.current.time) for p in pairs] == [
            (scans[i].time, scans[j].time) for i, j in expected
        ]
