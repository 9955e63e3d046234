"""Clocks that step, wrong stamps, and what is there twice: used as it comes, or named."""

import warnings
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d.radar import ErrorBudget, RadarScan, ScanWarning, Track, Tracker, simulate_drive, track
from tests.radar.scenes import STRAIGHT, in_order, named_sensors, surround_scans
from tests.radar.tracks.test_files import assert_same
from tests.radar.tracks.test_tracker import added

OPTIONS = {"horizon": 0.3, "budget": ErrorBudget()}


def shifted(scans, first: int, seconds: float, last: int | None = None):
    """The scans, from a number on with another clock."""
    late = [replace(scan, time=scan.time + seconds) for scan in scans[first:last]]
    return [*scans[:first], *late, *(scans[last:] if last else [])]


PARTS = slice(-2), slice(-2, -1), slice(-1, None)  # of a scan with a line of another time


def live(sensors, arrival=None) -> tuple[Track, list[str]]:
    """The track of scans as they arrive, and what is said meanwhile.

    ``arrival`` are the same sensors with the times at which they are measured, if these differ.
    """
    tracker = Tracker({name: at for name, (_, at) in sensors.items()}, **OPTIONS)
    order = sorted(
        (scan.time, name, i)
        for name, (own, _) in (arrival or sensors).items()
        for i, scan in enumerate(own)
    )
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        for _, name, i in order:
            tracker.add(name, sensors[name][0][i])
        tracker.finish()
    assert all(each.category is ScanWarning for each in said)
    return tracker.track, [str(each.message) for each in said]


def one() -> dict:
    """One sensor."""
    return dict(list(named_sensors(30).items())[:1])


def three() -> dict:
    return named_sensors(30)


either = pytest.mark.parametrize("given", [one, three])


@either
@pytest.mark.parametrize("seconds", [-86400.0, -3.7])
def test_where_all_clocks_step_back_a_new_segment_begins(given, seconds):
    """Breaks if times are changed, a pair or an acceleration reaches over the step, or the path
    does not say so; live or afterwards."""
    measured = given()
    sensors = {name: (shifted(own, 15, seconds), at) for name, (own, at) in measured.items()}
    with pytest.warns(ScanWarning, match="steps back from 1.4.* s: a new segment") as said:
        found = track(sensors, **OPTIONS)
    assert len(said) == len(sensors)
    assert_array_equal(np.flatnonzero(~found.converged), [14])
    assert found.reasons[14] == "the first scan after the clock stepped back"
    parts = {name: (own[:15], at) for name, (own, at) in sensors.items()}
    later = {name: (own[15:], at) for name, (own, at) in sensors.items()}
    before, after = found.segments
    assert_same(before, replace(track(parts, **OPTIONS), reasons=before.reasons))
    alone = track(later, **OPTIONS, initial=before.theta[-1])
    assert_array_equal(after.times, alone.times)
    assert_allclose(after.theta, alone.theta, atol=1e-9)
    assert_array_equal(found.poses()[14], found.poses()[15])
    assert_same(live(sensors, measured)[0], found)


def test_a_track_of_two_segments_has_no_velocity_at_a_time(tmp_path):
    """Breaks if one of two estimates of the same time is taken, or a file holds times that go
    back; the npz file keeps them."""
    scans, at = next(iter(one().values()))
    with pytest.warns(ScanWarning):
        found = track((shifted(scans, 15, -10.0), at))
    for call in (
        lambda: found.at([1.0]),
        lambda: found.displacement([0.5], [1.0]),
        lambda: found.write_tum(tmp_path / "path.tum"),
    ):
        with pytest.raises(ValueError, match=r"its clock steps back to -8\.5 s at estimate 14"):
            call()
    found.save(tmp_path / "drive.npz")
    assert_same(Track.load(tmp_path / "drive.npz"), found)


def test_a_clock_that_steps_back_alone_is_refused_in_a_log():
    """Breaks if two drives of one sensor are laid over one drive of the others."""
    sensors = three()
    scans, at = sensors["left"]
    sensors["left"] = shifted(scans, 15, -1.2), at
    said = r"the clock of sensors\['left'\].scans steps back from 1.400 s to 0.300 s, and that of "
    with pytest.warns(ScanWarning), pytest.raises(ValueError, match=f"^{said}.*'right'.* does not"):
        track(sensors)


@either
@pytest.mark.parametrize("gap", [1.5, 100.0])
def test_after_a_gap_nothing_is_paired_with_what_was_before(given, gap):
    """Breaks if a gap loses the rest, or a velocity is the mean over it."""
    sensors = {name: (shifted(own, 15, gap), at) for name, (own, at) in given().items()}
    found = track(sensors, **OPTIONS)  # warnings are errors
    assert_array_equal(np.flatnonzero(~found.converged), [14])
    assert found.reasons[14] == "the first scan after a gap"
    assert_allclose(found.intervals[14], gap + 0.1)
    assert len(found.segments) == 1
    assert_same(live(sensors)[0], found)


@either
@pytest.mark.parametrize("torn", [False, True])
@pytest.mark.parametrize("seconds", [100.0, 3.0, -100.0, -3.0])
def test_one_wrong_stamp_is_left_out_with_a_word(given, torn, seconds):
    """Breaks if the times of other scans change for it, the others of a vehicle wait for it, or it
    begins a segment if it is that of a line in the middle of a scan."""
    measured = given()
    scans, at = measured["left"]
    if torn:
        scans = [*scans[:11], *(scans[11][part] for part in PARTS), *scans[12:]]
        measured |= {"left": (scans, at)}
    sensors = measured | {"left": (shifted(scans, 12, seconds, 13), at)}
    without = measured | {"left": ([*scans[:12], *scans[14 if torn else 13 :]], at)}
    with pytest.warns(ScanWarning, match="has a scan at .*out of step.* is its time") as said:
        found = track(sensors, **OPTIONS)
    assert len(said) == 1
    assert found.converged.all()
    assert_same(found, track(without, **OPTIONS))
    seen, words = live(sensors, measured)
    assert_same(seen, found)
    assert len(words) == 1


@pytest.mark.parametrize(
    ("first", "last", "seconds"),
    [*product([12], [13, 20, 30], [50.0, 1.5, -3.0]), *product([1], [2, 20, 30], [-3.0])],
)
def test_one_clock_that_steps_does_not_lose_the_others(first, last, seconds):
    """Breaks if the scans of all other sensors are late after one stamp, or for ever."""
    measured = three()
    scans, at = measured["left"]
    sensors = measured | {"left": (shifted(scans, first, seconds, last), at)}
    found, said = live(sensors, measured)
    assert all(text.startswith("'left' has a scan at") for text in said)
    assert 1 <= len(said) <= 2
    assert found.times[-1] < 3.0
    assert found.converged.all()
    assert len(found) == 29
    assert np.abs(found.theta - STRAIGHT).max() < 0.3
    if last < 30:
        assert np.median(found.targets[last + 2 :]) > 2.5 * np.mean([s.size for s in scans])


def test_a_sensor_that_is_slower_than_the_others_is_not_overruled():
    """Breaks if a fast sensor whose clock steps decides before a slow one has been heard."""
    measured = three()
    slow, at = measured["rear"]
    measured = {"left": measured["left"], "rear": (slow[::4], at)}
    scans, at = measured["left"]
    found, _ = live(measured | {"left": (shifted(scans, 13, 50.0, 16), at)}, measured)
    assert found.times[-1] < 3.0
    assert len(found.segments) == 1
    assert found.converged.mean() > 0.8


def test_scans_that_are_a_little_late_are_used_and_older_ones_named():
    """Breaks if a scan that is late runs time backwards, which no track can hold."""
    sensors = named_sensors(20)
    tracker = Tracker({name: at for name, (_, at) in sensors.items()})
    order = in_order(sensors)
    order[30], order[31] = order[31], order[30]  # of one round
    late = order.pop(32)
    del order[34]  # the next one of that sensor is lost
    order.insert(36, late)
    with pytest.warns(ScanWarning, match=r"^'rear' has a scan at 1\.026 s .* left out") as said:
        added(tracker, order)
    assert len(said) == 1
    found = tracker.track
    assert found.converged.all()
    assert (np.diff(found.times) > 0.0).all()
    assert np.abs(found.theta - STRAIGHT).max() < 0.3


def test_a_radar_that_becomes_slow_is_not_left_out():
    """Breaks if each of its scans waits for one that agrees with it, for ever."""
    times = np.concatenate([0.1 * np.arange(12), 3.0 + 2.0 * np.arange(12)])
    scans, at = surround_scans(times=times)[0]
    assert_allclose(track((scans, at)).times, times[1:])


def test_how_far_a_wrong_stamp_is_off_depends_on_the_cycle():
    """Breaks if a slow radar that misses some scans is out of step, or one wrong stamp is not."""
    scans, at = surround_scans(times=0.5 * np.arange(20))[0]
    with pytest.warns(ScanWarning, match="out of step"):
        found = track((shifted(scans, 12, 3.0, 13), at))
    assert_array_equal(found.times, np.delete(0.5 * np.arange(1, 20), 11))
    assert_array_equal(track((shifted(scans, 12, 1.5), at)).times[11:], 0.5 * np.arange(15, 23))


def test_times_of_different_days_are_refused():
    """Breaks if a clock that is off gives a track of each sensor alone, without a word."""
    sensors = three()
    scans, at = sensors["rear"]
    with pytest.raises(ValueError, match=r"\['.*'\]\.scans has times from .*do not overlap"):
        track({**sensors, "rear": (shifted(scans, 0, 86400.0), at)})


@either
@pytest.mark.parametrize("later", [0.0, 0.1], ids=["message", "frozen"])
def test_a_scan_that_repeats_the_one_before_is_left_out_with_a_word(given, later):
    """Breaks if a frozen sensor gives a velocity, or a message that comes twice ends the log."""
    measured = given()
    scans, at = measured["left"]
    twice = replace(scans[7], time=scans[7].time + later)
    kept = scans[9:] if later else scans[8:]
    sensors = measured | {"left": ([*scans[:8], twice, *kept], at)}
    without = measured | {"left": ([*scans[:8], *kept], at)}
    with pytest.warns(ScanWarning, match=rf"repeats its scan at {twice.time:.3f} s.* left out"):
        found = track(sensors, **OPTIONS)
    assert_same(found, track(without, **OPTIONS))
    seen, words = live(sensors)
    assert_same(seen, found)
    assert len(words) == 1


def test_a_frozen_sensor_is_named_once_and_the_others_go_on():
    """Breaks if one sensor discards the rounds of all, or what it repeats counts as measured."""
    sensors = named_sensors(20)
    scans, at = sensors["right"]
    sensors["right"] = [*scans[:8], *(replace(scans[7], time=s.time) for s in scans[8:])], at
    found, said = live(sensors)
    assert [text[:30] for text in said] == ["'right' repeats its scan at 0."]
    assert found.converged.all()
    size = [sum(own[k].size for own in (sensors["left"][0], sensors["rear"][0])) for k in (10, 19)]
    assert_array_equal(found.targets[[9, 18]], size)
    assert np.abs(found.theta - STRAIGHT).max() < 0.3


def test_a_coarse_radar_of_a_standing_vehicle_may_measure_the_same_again():
    """Breaks if a standing vehicle has no estimates, or a creeping one those of a frozen sensor."""
    drive = simulate_drive(np.random.default_rng(3), duration=1.0)
    still = replace(drive.scans[0], doppler=0.0 * drive.scans[0].doppler)
    standing = track(([replace(still, time=s.time) for s in drive.scans], drive.mounting))
    assert standing.converged.all()
    slow = [replace(s, doppler=0.01 * s.doppler - 0.7) for s in drive.scans]
    slow[5] = replace(slow[4], time=slow[5].time)
    with pytest.warns(ScanWarning, match="repeats its scan"):
        track((slow, drive.mounting))
    assert_allclose(standing.theta, 0.0, atol=1e-3)


def test_targets_that_are_there_twice_count_once():
    """Breaks if a log with every line twice halves the variances, or a warning is not at the line
    of the caller; a few equal targets may be so by chance."""
    rng = np.random.default_rng(3)
    scans, at = surround_scans(8)[0]
    scans = [scan[:40] for scan in scans]
    order = rng.permutation(np.tile(np.arange(40), 2))
    with pytest.warns(ScanWarning, match=r"^sensors\['front'\]\.scans has targets twice") as said:
        found = track({"front": ([scan[order] for scan in scans], at)})
    assert len(said) == 1
    assert said[0].filename == __file__
    met = list(dict.fromkeys(order.tolist()))  # on the order depend the last digits
    once = track(([scan[met] for scan in scans], at))
    assert_array_equal(found.targets, once.targets)
    assert_allclose(found.theta, once.theta, atol=1e-9)
    assert_allclose(found.covariance, once.covariance, rtol=1e-6)
    half = [scan[np.repeat(np.arange(4), 2)] for scan in scans]
    with pytest.warns(ScanWarning, match="has targets twice"):
        assert_array_equal(track((half, at)).targets, 4)
    pairs = np.array([5.0, 5.0, 7.0, 8.0]), np.array([0.1, 0.1, 0.2, 0.3]), np.full(4, 0.1)
    few = [RadarScan(time, *pairs, 0.1, 0.01, 0.1) for time in (0.0, 1.0)]
    assert_array_equal(track((few, at)).targets, [4])
