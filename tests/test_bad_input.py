"""What every public function refuses alike: masks, loops over what is no sequence, flags."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from d2d import LinearMeasurement, PointSet, gaussian, register
from d2d.radar import (
    Mounting,
    RadarScan,
    Sensor,
    VehicleLimits,
    doppler_ego_motion,
    doppler_velocity,
    estimate_ego_motion,
    inlier_probabilities,
    propagate_ego_motion,
    track,
)
from d2d.radar.simulation.drive import simulate_drive

SCANS = simulate_drive(np.random.default_rng(0), 0.3).scans
PAIR = (SCANS[0], SCANS[1], Mounting(0.4))
ESTIMATE = estimate_ego_motion(*PAIR)
LOST = replace(ESTIMATE, covariance=np.full((3, 3), np.nan))  # of any options
EYES = np.tile(np.eye(2), (3, 1, 1))
SET = PointSet([[8.0, 1.0], [5.0, -3.0], [6.0, 4.0]], EYES)
GAIN = np.ones((3, 3))

# ---- Masked arrays

MASKED = np.ma.masked_greater([1.0, 9999.0], 100.0)
POINTS = np.ma.masked_greater([[0.0, 1.0], [2.0, 9999.0], [3.0, 4.0]], 100.0)


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: RadarScan(0.0, MASKED, [0.0, 0.1], [0.0, 0.0], 0.1, 0.01, 0.1), "range"),
        (lambda: RadarScan(0.0, [1.0, 2.0], MASKED, [0.0, 0.0], 0.1, 0.01, 0.1), "azimuth"),
        (lambda: PointSet(POINTS, EYES), "means"),
        (lambda: PointSet(POINTS.data, EYES, np.ma.masked_less([0.1, 1.0, 1.0], 0.5)), "weights"),
        (lambda: PointSet.from_polar(MASKED, [0.0, 0.1], 0.1, 0.01), "range"),
        (lambda: register(SET, SET, scales=np.ma.masked_greater([9.0, 1.0], 5.0)), "scales"),
        (lambda: register(SET, SET, initial=np.ma.masked_greater([9.0, 1, 0], 5)), "initial"),
    ],
)
def test_a_masked_entry_is_refused(call, name):
    """Breaks if the mask is forgotten and what it hides is taken for a measurement."""
    with pytest.raises(ValueError, match=f"^{name} must not hold masked entries"):
        call()


def test_a_mask_that_hides_nothing_is_no_mask():
    """Breaks if all arrays of NumPy's masked kind are refused."""
    means = np.ma.masked_greater(SET.means, 100.0)
    assert_array_equal(PointSet(means, EYES).means, SET.means)


# ---- Loops


@pytest.mark.parametrize(
    "thing",
    [SCANS[0], simulate_drive(np.random.default_rng(0), 0.1).targets[0], SET],
    ids=lambda thing: type(thing).__name__,
)
def test_what_is_no_sequence_cannot_be_looped_over(thing):
    """Breaks if a loop over its targets runs through none of them and says nothing."""
    with pytest.raises(TypeError, match=r"iterable|iterate"):
        list(thing)


def test_a_batch_is_looped_over_along_its_first_axis():
    """Breaks if the last set is left out, or a batch of two axes comes out flat."""
    batch = SET.transformed(np.arange(24.0).reshape(4, 2, 3))
    sets = list(batch)
    assert [points.batch_shape for points in sets] == [(2,)] * 4
    for i, points in enumerate(sets):
        assert_array_equal(points.means, batch.means[i])
        assert_array_equal(points.covariances, batch.covariances[i])


# ---- Flags

FLAGS = {
    "estimate-doppler": ("doppler", lambda f: estimate_ego_motion(*PAIR, doppler=f)),
    "estimate-first_order": ("first_order", lambda f: estimate_ego_motion(*PAIR, first_order=f)),
    "inliers-doppler": (
        "doppler",
        lambda f: inlier_probabilities(ESTIMATE.theta, *PAIR, doppler=f),
    ),
    "inliers-first_order": (
        "first_order",
        lambda f: inlier_probabilities(ESTIMATE.theta, *PAIR, first_order=f),
    ),
    "propagate-doppler": ("doppler", lambda f: propagate_ego_motion(LOST, *PAIR, doppler=f)),
    "propagate-first_order": (
        "first_order",
        lambda f: propagate_ego_motion(LOST, *PAIR, first_order=f),
    ),
    "propagate-shared_azimuth": (
        "shared_azimuth",
        lambda f: propagate_ego_motion(ESTIMATE, *PAIR, shared_azimuth=f),
    ),
    "track-doppler": ("doppler", lambda f: track((SCANS, PAIR[2]), doppler=f)),
    "track-first_order": ("first_order", lambda f: track((SCANS, PAIR[2]), first_order=f)),
    "side_slip": ("side_slip", lambda f: doppler_ego_motion([PAIR[1:]], side_slip=f)),
    "quantised": ("quantised", lambda f: Sensor(quantised=f)),
    "of_twist": (
        "of_twist",
        lambda f: LinearMeasurement(np.zeros(3), 1.0, 0.0, GAIN, GAIN, of_twist=f),
    ),
    "equal_weights": (
        "equal_weights",
        lambda f: gaussian.maximise(
            SET.means,
            np.ones((3, 1)),
            gaussian.GaussianMixture([1.0], [[0.0, 0.0]], [np.eye(2)]),
            floor=0.1,
            equal_weights=f,
        ),
    ),
}


@pytest.mark.parametrize(
    "bad", ["no", np.nan, None, 0, 1, [], track], ids=lambda bad: repr(bad)[:9]
)
@pytest.mark.parametrize("case", FLAGS)
def test_a_flag_is_true_or_false(case, bad):
    """Breaks if "no" switches something on, or 0 is taken for an index."""
    name, call = FLAGS[case]
    with pytest.raises(
        ValueError, match=f"^{name} must be True or False, but is {re.escape(repr(bad))}"
    ):
        call(bad)


@pytest.mark.parametrize("case", FLAGS)
def test_a_flag_may_come_from_an_array(case):
    """Breaks if NumPy's own True and False are refused."""
    _, call = FLAGS[case]
    for value in np.array([True, False]):
        call(value)


@pytest.mark.parametrize("bad", [True, False, np.True_])
def test_a_flag_is_no_count(bad):
    """Breaks if ``baseline=True`` is a baseline of one scan."""
    for name, call in (
        ("baseline", lambda: track((SCANS, PAIR[2]), baseline=bad)),
        ("threads", lambda: register(SET, SET, threads=bad)),
        ("max_targets", lambda: Sensor(max_targets=bad)),
    ):
        with pytest.raises(ValueError, match=f"^{name} must be an integer"):
            call()


def test_limits_do_not_change_with_what_they_were_made_of():
    """Breaks if an array of no dimensions, which can be written to, is kept as a limit."""
    speed = np.array(30.0)
    limits = VehicleLimits(speed=speed)
    speed[...] = 1e9
    assert limits == VehicleLimits(speed=30.0)


# ---- Scans, sensors, views and pairs of scans

MOUNTING = PAIR[2]


def test_views_may_come_from_any_iterable():
    """Breaks if a generator, or a zip, is refused, or used up before all of it was read."""
    views = [(scan, MOUNTING) for scan in SCANS]
    for several in (iter, tuple):
        found = doppler_ego_motion(several(views))
        assert_array_equal(found.theta, doppler_ego_motion(views).theta)
    for bad, said in (
        (None, "views must be a sequence, but is a NoneType"),
        (iter([]), "views must hold at least one scan"),
        ([(MOUNTING, SCANS[0])], "views[0][0] must be a RadarScan, but is a Mounting"),
    ):
        with pytest.raises(ValueError, match=f"^{re.escape(said)}"):
            doppler_ego_motion(bad)


def test_a_tilde_in_a_path_is_the_home_folder(tmp_path, monkeypatch):
    """Breaks if a file in a folder of that name is looked for."""
    monkeypatch.setenv("HOME", str(tmp_path))
    track((SCANS, MOUNTING)).write_tum("~/driven.tum")
    assert len(np.loadtxt(tmp_path / "driven.tum")) == len(SCANS)


# ---- Units

TURN = 2.0 * np.pi


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda a: RadarScan(0.0, [5.0, 8.0], [0.1, a], [0.0, 0.0], 0.1, 0.01, 0.1), "azimuth"),
        (lambda a: PointSet.from_polar([5.0, 8.0], [0.1, a], 0.1, 0.01), "azimuth"),
        (lambda a: doppler_velocity([5.0, 0.0, 0.0], [0.1, a], MOUNTING), "azimuth"),
        (lambda a: Mounting(1.0, 0.5, a), "yaw"),
    ],
)
def test_angles_in_degrees_are_refused(call, name):
    """Breaks if degrees are taken for radians, and the drive comes out all zero or backwards."""
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
    np.testing.assert_allclose(placed, [1.0 + 5.0 * np.cos(0.3), -5.0 * np.sin(0.3)])
