"""What counts as a sensor, rounds of scans, and the pairs of a round."""

from dataclasses import replace

import numpy as np
import pytest

from d2d.radar import Mounting, Recording, track
from d2d.radar.tracks.rounds import Rounds, named_sensors, rounds_of
from tests.radar.scenes import AROUND, CORNER, beginning, surround_scans, two_scans
from tests.radar.tracks.test_files import assert_same

SENSORS = surround_scans(5)
SCANS, MOUNTING = SENSORS[0]


def at_times(times):
    """A scan at each time, the same one: of a vehicle that stands, or it would be left out."""
    scan = two_scans(np.random.default_rng(67), [0.0, 0.0, 0.0])[0]
    return [replace(scan, time=float(time)) for time in times]


def test_sensors_given_in_any_way_give_the_same_bits():
    """Breaks if a way of giving them changes the scans, the order or the path of computation."""
    drive = beginning(6)
    pair = (drive.scans, drive.mounting)
    recording = Recording(drive.scans, drive.mounting, drive.truth)
    whole = track(drive)
    for given in (pair, recording, (iter(drive.scans), drive.mounting), [pair], {"front": pair}):
        assert_same(track(given), whole)
    lazy = ((iter(scans), mounting) for scans, mounting in SENSORS)
    recordings = [Recording(*sensor, drive.truth) for sensor in SENSORS]
    named = {"left": SENSORS[0], 2: recordings[1], "rear": SENSORS[2]}
    whole = track(SENSORS)
    for given in (tuple(SENSORS), lazy, recordings, named):
        assert_same(track(given), whole)


def test_what_is_no_sensor_is_refused_by_name():
    """Breaks if the user gets Python's words about len(), subscripts or unpacking."""
    no_sensor = "must be a Recording or a tuple"
    for given, said in (
        (SCANS, rf"sensors\[0\] {no_sensor} \(scans, Mounting\), but is a RadarScan"),
        ((SCANS, (3.6, 0.7, 0.4)), rf"sensors\[0\] {no_sensor}"),
        ([(MOUNTING, SCANS)], rf"sensors\[0\] {no_sensor}"),
        ({"front": SCANS}, rf"sensors\['front'\] {no_sensor}"),
        (([SCANS[0], None], MOUNTING), r"scans\[1\] must be a RadarScan, but is a NoneType"),
        ([], "sensors must have at least two rounds of scans"),
        ((SCANS[:1], MOUNTING), r"sensors .* \(of one sensor: two scans\), but have 1"),
        ([(scans[:1], at) for scans, at in SENSORS], "sensors must have .* but have 1"),
    ):
        with pytest.raises(ValueError, match=f"^{said}"):
            track(given)


def test_scans_out_of_time_order_are_refused_by_name():
    """Breaks if an interval of zero divides, no scan is named, or sensors cannot share a time."""
    swapped, twice = at_times([0.0, 0.2, 0.1]), at_times([0.0, 0.1, 0.1])
    twice[2] = twice[2].with_extent(0.1)[1:]  # another one of the same time
    for scans in (swapped, twice):
        said = rf"must be in strictly increasing .* at 0\.100000 s after {scans[1].time:.6f} s"
        with pytest.raises(ValueError, match=f"^scans {said}"):
            track((scans, CORNER))
        with pytest.raises(ValueError, match=rf"^sensors\['rear'\]\.scans {said}"):
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
        assert len(named_sensors([(few, CORNER), (few, AROUND[1])])) == 2


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


def test_a_wrong_baseline_or_horizon_is_refused_by_name():
    """Breaks if a scan can be registered with itself, or one of two options is ignored."""
    for baseline in (0, -1, 1.5, True):
        with pytest.raises(ValueError, match=r"^baseline must be an integer"):
            track(SENSORS, baseline=baseline)
    for options in ({"horizon": 0.0}, {"horizon": 300.0}, {"horizon": 0.3, "baseline": 2}):
        with pytest.raises(ValueError, match=r"^horizon"):
            track(SENSORS, **options)


def numbered(times):
    """Sensors with a scan at each time, none of them empty."""
    return [(at_times(own), Mounting(0.5 * s)) for s, own in enumerate(times)]


def test_rounds_hold_each_sensor_once_and_follow_time():
    """Breaks if a scan is used twice or never, or a gap of one sensor stops the others."""
    for times, expected in (
        ([[0.0, 1.0, 2.0]], [{0: 1.0}, {0: 2.0}]),
        ([[0.0, 1.0], [0.5, 1.5]], [{0: 1.0, 1: 1.5}]),
        ([[0.5, 1.5], [0.0, 1.0]], [{1: 1.0, 0: 1.5}]),
        # the second sensor misses its turn, and comes back
        ([[0.0, 1.0, 2.0], [0.1, 2.1]], [{0: 1.0}, {0: 2.0, 1: 2.1}]),
        ([[0.0, 1.0], [0.0, 1.0]], [{0: 1.0, 1: 1.0}]),
        ([[], [0.0]], []),
        # at equal times, sensors stay together whichever is named first and starts late
        ([[0.0, 1.0, 2.0], [1.0, 2.0]], [{0: 1.0, 1: 1.0}, {0: 2.0, 1: 2.0}]),
        ([[1.0, 2.0], [0.0, 1.0, 2.0]], [{0: 1.0, 1: 1.0}, {0: 2.0, 1: 2.0}]),
        # the third is blind, and nobody waits for it longer than for one and a half cycles
        ([[0.0, 1.0, 5.0], [0.1, 1.1, 4.9], []], [{0: 1.0, 1: 1.1}, {1: 4.9, 0: 5.0}]),
        ([[0.0, 1.0, 2.0], [0.1, 1.1, 3.6], []], [{0: 1.0, 1: 1.1}, {0: 2.0}, {1: 3.6}]),
    ):
        found = rounds_of(numbered(times))
        assert [{s: scan.time for s, scan in each.scans.items()} for each in found] == expected
        for each in found:
            assert each.time == np.mean([scan.time for scan in each.scans.values()])


def test_a_round_ends_with_the_last_of_its_sensors():
    """Breaks if an estimate waits for the next round although nothing more can come."""
    rounds, (a, b, c) = Rounds([CORNER, MOUNTING]), at_times([0.0, 0.1, 0.2])
    assert rounds.add(0, a) == rounds.add(1, a) == rounds.add(1, b) == []
    (ended,) = rounds.add(0, b)
    assert set(ended.scans) == {0, 1}
    assert [(pair.previous, pair.current) for pair in ended.pairs] == [(a, b), (a, b)]
    assert rounds.add(0, c) == []
    (ended,) = rounds.finish()
    assert list(ended.scans) == [0]
    assert rounds.finish() == []


def paired(sensors, **options):
    """The times of the two scans of each pair, round by round."""
    found = rounds_of(sensors, **options or {"baseline": 1})
    return [[(p.previous.time, p.current.time) for p in each.pairs] for each in found]


def test_a_horizon_is_the_baseline_nearest_to_it():
    """Breaks if another scan is taken, or if rounding decides between two that are equally near."""
    sensors = surround_scans(12)
    for horizon, baseline in ((0.3, 3), (0.26, 3), (0.05, 1), (0.35, 3)):
        assert paired(sensors, horizon=horizon) == paired(sensors, baseline=baseline)


def test_pairs_leave_out_first_and_empty_scans():
    """Breaks if a scan is registered with nothing, or with one of another sensor."""
    scans = at_times([0.0, 0.1, 0.2, 0.3])
    blinded = [*scans[:2], scans[2][:0], scans[3]]
    sensors = [(scans, CORNER), (blinded, Mounting())]
    assert paired(sensors) == [[(0.0, 0.1)] * 2, [(0.1, 0.2)], [(0.1, 0.3), (0.2, 0.3)]]
    assert paired(sensors, baseline=2) == [[(0.0, 0.1)] * 2, [(0.0, 0.2)], [(0.0, 0.3), (0.1, 0.3)]]
    reasons = [each.reason for each in rounds_of([(blinded, CORNER)]) if not each.pairs]
    assert reasons == ["a scan without targets"]


@pytest.mark.parametrize("options", [{}, {"baseline": 3}, {"horizon": 0.3}])
def test_no_pair_reaches_over_a_gap(options):
    """Breaks if a velocity is the mean over seconds in which nothing was seen."""
    steps = 0.1 * np.arange(10)
    for gap in (0.6, 3.0):
        times = np.concatenate([steps, steps + steps[-1] + gap])
        found = paired([(at_times(times), CORNER)], **options)
        assert found[9] == []
        assert max(now - before for pairs in found for before, now in pairs) < 0.31
        assert found[10] == [(times[10], times[11])]
    missing = np.delete(steps, 5)  # a scan that is lost is no gap
    assert all(paired([(at_times(missing), CORNER)], **options))
    if not options:  # two that are lost are one, unless the pairs are longer anyway
        assert paired([(at_times(np.delete(steps, [5, 6])), CORNER)])[4] == []
    slow = [(at_times(5.0 * steps), CORNER)]  # a radar of 2 Hz has no shorter pairs
    assert all(paired(slow, horizon=0.3))


def test_no_more_scans_are_kept_than_can_make_a_pair():
    """Breaks if a tracker that runs for days fills the memory."""
    for options, most in (({"baseline": 1}, 4), ({"baseline": 4}, 8), ({"horizon": 0.3}, 6)):
        rounds = Rounds([CORNER], **options)
        for scan in at_times(0.1 * np.arange(100)):
            rounds.add(0, scan)
            assert len(rounds.histories[0].scans) <= most
