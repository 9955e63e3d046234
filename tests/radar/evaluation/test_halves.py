"""Covariances judged without a reference: two tracks, halves by target and by object."""

import warnings
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d import rigid
from d2d.radar import (
    Comparison,
    Mounting,
    RadarScan,
    Reference,
    compare,
    compare_halves,
    compare_tracks,
    track,
)
from tests.radar.evaluation.noisy_tracks import EMPTY, failed, noisy

THETA = np.array([3.0, 0.0, 0.1])
MOUNTING = Mounting(2.0, 0.0, 0.0)
SIGMA = 0.1  # m, along both axes


def drive(seed: int, shared: float, scans: int = 120) -> list[RadarScan]:
    """Scans of objects of five targets, whose errors have the stated variance.

    The part ``shared`` of the variance is one error of all targets of an object in a scan.
    """
    rng = np.random.default_rng(seed)
    centres = np.stack(np.meshgrid(np.arange(8.0, 62.0, 9.0), np.arange(-27.0, 28.0, 9.0)), -1)
    centres = centres.reshape(-1, 1, 2)
    around = 1.2 * np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    points = centres + around + rng.uniform(-0.2, 0.2, (len(centres), 5, 2))
    found = []
    for time in 0.1 * np.arange(scans):
        errors = np.sqrt(1.0 - shared) * rng.standard_normal(points.shape)
        errors += np.sqrt(shared) * rng.standard_normal(centres.shape)
        to_sensor = rigid.inverse(rigid.compose(rigid.exponential(time * THETA), MOUNTING.pose))
        local = rigid.transform_means(to_sensor, points.reshape(-1, 2))
        x, y = (local + SIGMA * errors.reshape(-1, 2)).T
        away, bearing = np.hypot(x, y), np.arctan2(y, x)
        scan = RadarScan(time, away, bearing, 0.0 * away, SIGMA, SIGMA / away, 1.0)
        found.append(scan[(np.abs(bearing) < 1.2) & (away > 3.0)])
    return found


@cache
def halves(shared: float, by: str) -> Comparison:
    sensors = [(drive(0, shared), MOUNTING)]
    return compare_halves(sensors, np.random.default_rng(1), by=by, doppler=False)


def test_independent_targets_are_credible_both_ways():
    """Breaks if the halves share errors, or the sum of the covariances is not the difference's."""
    for by in ("target", "object"):
        found = halves(0.0, by)
        assert found.share == 1.0
        low, high = found.intervals(0.99).anees
        assert low < 1.0 < high
        assert high - low < 0.6


def test_targets_that_err_together_are_told_by_object_only():
    """Breaks if an object's targets come into different halves.

    Half of the variance is the object's own, so that the error of five targets' mean has
    1 + 4 / 2 = 3 times the variance that independent ones would have.
    """
    apart, together = halves(0.5, "target"), halves(0.5, "object")
    low, high = apart.intervals(0.99).anees
    assert low < 1.0 < high
    low, high = together.intervals(0.99).anees
    assert 1.5 < low < 3.0 < high
    # and that is what the errors themselves say, which need a reference
    scans = drive(0, 0.5)
    driven = track((scans, MOUNTING), baseline=1, carry=False, doppler=False)
    still = np.tile(THETA, (len(driven.times), 1))
    true = compare(driven, Reference(driven.times, still, np.zeros_like(still)))
    assert low < true.measures.anees < high


def test_halves_of_several_sensors_are_compared_in_rounds():
    """Breaks if a half lacks a sensor, or the second one's mounting is the first one's."""
    scans = drive(1, 0.0, scans=12)
    later = [RadarScan(**{**vars(scan), "time": scan.time + 0.01}) for scan in scans]
    sensors = [(scans, MOUNTING), (iter(later), MOUNTING)]
    found = compare_halves(sensors, np.random.default_rng(2), doppler=False)
    alone = compare_halves(sensors[:1], np.random.default_rng(2), doppler=False)
    assert len(found.times) == len(alone.times) == 11
    assert_allclose(found.times, alone.times + 0.005)
    assert_allclose(np.mean(found.sigmas / alone.sigmas, axis=0), np.sqrt(0.5), rtol=0.1)


def test_a_scan_that_cannot_be_halved_is_left_out():
    """Breaks if one bad scan loses a drive, or an empty half is an estimate."""
    scans = drive(2, 0.0, scans=9)
    scans[3] = scans[3][:0]
    places = scans[6].range * np.exp(1j * scans[6].azimuth)
    near = np.abs(places[:, None] - places) < 4.5
    scans[6] = scans[6][near[near.sum(axis=1).argmax()]]  # a single object
    sensors = [(scans, MOUNTING)]
    found = compare_halves(sensors, np.random.default_rng(3), by="object", doppler=False)
    gone = [scans[i].time for i in (3, 6)]
    assert not np.isin(found.times, gone).any()
    assert len(found.times) >= 4
    assert found.share < found.converged <= 7 / 8  # all targets of scan 6 do give an estimate


def test_halves_of_a_log_with_a_gap_are_those_of_its_track():
    """Breaks if the halves are divided in other rounds than the track's, or targets count twice."""
    scans = drive(3, 0.0, scans=30)
    doubled = scans[20][np.repeat(np.arange(scans[20].size), 2)]
    found = []
    for twin in (scans[20], doubled):
        later = [replace(scan, time=scan.time + 0.9) for scan in (*scans[15:20], twin)]
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            log = [([*scans[:15], *later], MOUNTING)]
            found.append(compare_halves(log, np.random.default_rng(4), doppler=False))
        assert [each.filename for each in said] == [__file__] * (twin is doubled)
    gap, jump = found
    assert len(jump.times) == 19
    assert_allclose(jump.errors, gap.errors, atol=1e-6)


def test_arguments_of_halves_are_refused_by_name():
    """Breaks if a mistake is found only after the drive has been estimated, or not at all."""
    scans = drive(0, 0.0, 2)
    good = {"sensors": [(scans, MOUNTING)], "rng": np.random.default_rng(0)}
    for change, name in (
        ({"by": "scan"}, "by"),
        ({"rng": 1}, "rng"),
        ({"doppler": False}, "halves have 1 "),
    ):
        with pytest.raises(ValueError, match=name):
            compare_halves(**{**good, **change})


def test_the_second_track_is_interpolated_to_the_times_of_the_first():
    """Breaks if weights are exchanged, or their squares are left out."""
    times = np.arange(6) / 10.0
    first, second = noisy(2, times), noisy(3, times - 0.03)
    found = compare_tracks(first, second)
    assert_array_equal(found.times, times[:-1])
    for i in range(5):
        theta = 0.7 * second.theta[i] + 0.3 * second.theta[i + 1]
        assert_allclose(found.errors[i], first.theta[i] - theta, atol=1e-12)
        sigma = 0.49 * second.covariance[i] + 0.09 * second.covariance[i + 1]
        assert_allclose(found.covariances[i], first.covariance[i] + sigma, rtol=1e-9)


def test_at_equal_times_nothing_is_interpolated():
    """Breaks if a neighbour that did not converge takes an estimate with it."""
    times = np.arange(8) / 10.0
    first, second = noisy(4, times), noisy(5, times)
    first, second = failed(first, 5), failed(second, 3)
    found = compare_tracks(first, second)
    left = np.array([0, 1, 2, 4, 6, 7])
    assert_array_equal(found.times, times[left])
    assert_array_equal(found.errors, (first.theta - second.theta)[left])
    assert_array_equal(found.covariances, (first.covariance + second.covariance)[left])
    assert found.share == 6 / 8
    assert found.converged == 7 / 8


def test_tracks_that_cannot_be_compared_are_refused():
    """Breaks if the clocks of two sensors differ, or a track is empty, and nobody is told."""
    times = np.arange(20) / 10.0
    one, other = noisy(0, times), noisy(1, times + 100.0)
    for first, second, message in (
        (one, other, r"first and second have 0 .* clocks"),
        (EMPTY, one, "first and second have 0"),
        (one, EMPTY, "the track must hold at least one"),
    ):
        with pytest.raises(ValueError, match=message):
            compare_tracks(first, second)
