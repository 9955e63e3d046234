"""Clocks that jump, and targets that are there twice."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d.radar import RadarScan, track
from d2d.radar.tracks.intake import Intake
from tests.radar.scenes import STRAIGHT, surround_scans


def shifted(scans, first: int, seconds: float):
    """The scans, from a number on with another clock."""
    return [*scans[:first], *(replace(s, time=s.time + seconds) for s in scans[first:])]


@pytest.mark.parametrize("seconds", [-86400.0, -3.7])
def test_a_clock_that_jumps_back_is_named_and_the_log_goes_on(seconds):
    """Breaks if a log that runs over midnight is refused, or a pair reaches over the jump."""
    sensors = {
        str(s): (shifted(scans, 15, seconds), at)
        for s, (scans, at) in enumerate(surround_scans(30))
    }
    with pytest.warns(UserWarning, match="the clock of .* jumps by") as said:
        found = track(sensors, horizon=0.3)
    assert len(said) == 3
    assert f"sensors['0'].scans jumps by {seconds - 0.1 + 0.2:.3f} s" in str(said[0].message)
    assert_array_equal(np.flatnonzero(~found.converged), [14])
    assert found.reasons[14] == "the first scan after a gap"
    assert np.abs(found.theta - STRAIGHT).max() < 0.3
    assert_allclose(found.intervals[15:], 0.1, atol=1e-9)


@pytest.mark.parametrize("seconds", [100.0, 3.0, -100.0])
def test_one_wrong_stamp_is_named_and_left_out(seconds):
    """Breaks if the times of all later scans are shifted by it, or it ends the log."""
    scans, at = surround_scans(30)[0]
    wrong = [*scans[:12], *shifted(scans[12:13], 0, seconds), *scans[13:]]
    with pytest.warns(UserWarning, match="^scans has one scan at .* left out; is its") as said:
        found = track((wrong, at))
    assert len(said) == 1
    without = track(([*scans[:12], *scans[13:]], at))
    assert_array_equal(found.times, without.times)
    assert_array_equal(found.theta, without.theta)
    assert found.converged.all()


def test_a_time_that_comes_twice_after_a_gap_is_refused():
    """Breaks if a scan that waits is confirmed by another one of the same time."""
    scans, at = surround_scans(16)[0]
    late = shifted(scans, 12, 5.0)
    with pytest.raises(ValueError, match=r"^scans must be in strictly increasing time, .* 6\.2"):
        track(([*late[:13], late[12], *late[13:]], at))


def test_a_radar_that_becomes_slow_is_not_left_out():
    """Breaks if each of its scans waits for one that agrees with it, for ever."""
    times = np.concatenate([0.1 * np.arange(12), 3.0 + 2.0 * np.arange(12)])
    scans, at = surround_scans(times=times)[0]
    found = track((scans, at))
    assert_allclose(found.times[-4:], times[-4:])


def test_a_long_gap_is_told_and_the_log_goes_on():
    """Breaks if a clock that jumps ahead loses the rest of a log."""
    scans, at = surround_scans(30)[0]
    with pytest.warns(UserWarning, match=r"scans has a gap, or its clock jumps, by 100\.1"):
        found = track((shifted(scans, 15, 100.0), at))
    assert_array_equal(np.flatnonzero(~found.converged), [14])


def test_a_pause_is_told_of_a_clock_that_has_jumped_back_before():
    """Breaks if a mended jump hides what happens to the sensor later, or is told as a pause."""
    (scans, at), other = surround_scans(60)[:2]
    jumped = shifted(scans, 15, -5.0)
    for missing, told in ((0, []), (20, ["2.100 s"])):
        log = {"a": ([*jumped[:30], *jumped[30 + missing :]], at), "b": other}
        with pytest.warns(UserWarning, match="has a gap|the clock of .* jumps") as said:
            track(log, horizon=0.3)
        first, *rest = (str(each.message) for each in said)
        assert "the clock of sensors['a'].scans jumps by" in first
        assert [text.split(" by ")[1].split(" at ")[0] for text in rest] == told


def test_targets_that_are_there_twice_count_once():
    """Breaks if a log with every line twice halves the variances."""
    rng = np.random.default_rng(3)
    scans, at = surround_scans(8)[0]
    doubled = [scan[rng.permutation(np.tile(np.arange(scan.size), 2))] for scan in scans]
    with pytest.warns(UserWarning, match=r"^sensors\['front'\]\.scans has targets twice") as said:
        found = track({"front": (doubled, at)})
    assert len(said) == 1
    assert said[0].filename == __file__  # the caller's line, not one of the package
    once = track((scans, at))
    assert_array_equal(found.targets, once.targets)
    assert_allclose(found.theta, once.theta, atol=1e-9)
    assert_allclose(found.covariance, once.covariance, rtol=1e-6)


def test_equal_targets_of_a_coarse_radar_are_left():
    """Breaks if what is equal by chance is taken for a fault of the log."""
    scan = RadarScan(0.0, [5.0, 5.0, 7.0, 8.0], [0.1, 0.1, 0.2, 0.3], np.zeros(4), 0.1, 0.01, 0.1)
    assert Intake(["front"], 60.0).taken(0, scan) == [scan]
