"""The tracks of the guides: a line for each, what is wrong with them, and what undoes it."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d.radar import (
    Reference,
    Track,
    calibrate,
    compare,
    load_csv,
    over_ground_undone,
    track,
    unfolded,
)
from d2d.study.guides import own_log, symptoms
from d2d.study.guides.rows import row, row_table
from d2d.study.guides.stated_sigmas import front_drive, rounded, scaled

DEGREE = np.deg2rad(1.0)
SIGMAS = {"sigma_range": 0.15, "sigma_azimuth": 0.7 * DEGREE, "sigma_doppler": 0.1}


def test_a_row_has_the_errors_the_credibility_and_the_reason():
    """Breaks if a failed estimate counts as an error, or its reason is lost."""
    times = np.arange(1, 11) / 10.0
    theta = np.tile([5.0, 0.0, 0.1], (10, 1))
    good = times < 0.95
    covariance = np.where(good[:, None, None], 0.04 * np.eye(3), np.nan)
    reasons = np.where(good, "", "a side slip of -0.50 m/s")
    errors = 0.2 * np.random.default_rng(0).choice([-1.0, 1.0], (10, 3))
    driven = Track(times, np.full(10, 0.1), theta + errors, covariance, good, reasons)
    found = row("mine", driven, Reference(times, theta, np.zeros((10, 3))))
    assert found.accepted == 0.9
    assert_allclose((found.v_x, found.v_y, found.omega), [0.2, 0.2, np.rad2deg(0.2)])
    assert found.anees == pytest.approx(1.0)
    assert found.reason == "a side slip of -0.50 m/s"
    assert row_table([found]).rows == (("mine", "90.0%", "0.200", "0.200", "11.46", "1"),)


def test_a_track_that_failed_is_no_error():
    """Breaks if the table of symptoms ends where a fault is too large."""
    nothing = Track(
        np.arange(1.0, 6.0), np.ones(5), np.zeros((5, 3)), np.full((5, 3, 3), np.nan),
        np.zeros(5, dtype=bool), np.full(5, "no optimum near the start"),
    )  # fmt: skip
    found = row("none", nothing, front_drive().truth)
    assert found.accepted == 0.0
    assert math.isnan(found.anees)
    assert found.reason == "no optimum near the start"


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """The scans of the made-up car, and what else is known of its drive."""
    path = tmp_path_factory.mktemp("log") / "log.csv"
    drive = own_log.write_log(path)
    return load_csv(path, degrees=True, **SIGMAS), drive


def test_the_log_is_read_as_it_was_made(log):
    """Breaks if angles are not in degrees, a column is exchanged, or a sensor is missing."""
    scans, drive = log
    assert scans.keys() == own_log.TRUE.keys() == own_log.STATED.keys()
    for name, mounting in own_log.TRUE.items():
        driven = track((scans[name][:100], mounting), baseline=1)
        found = compare(driven, drive.truth)
        assert found.rmse[0] < 0.1, name
        steps = scans[name][0].doppler / own_log.DOPPLER_STEP
        assert_allclose(steps, np.round(steps), atol=1e-6)


def test_the_calibration_finds_what_was_put_in(log):
    """Breaks if the page's errors are not those that it names, or not told by the drive."""
    scans, drive = log
    names = list(own_log.TRUE)
    found = calibrate([(scans[n], own_log.STATED[n], drive.odometry) for n in names])
    assert found.lag == pytest.approx(own_log.ODOMETRY_LAG, abs=0.005)
    assert found.speed_factor == pytest.approx(own_log.ODOMETRY_FACTOR, abs=0.002)
    true = [own_log.TRUE[n].yaw - own_log.STATED[n].yaw for n in names]
    assert_allclose(found.yaw, true, atol=0.05 * DEGREE)


def test_scans_are_rounded_and_scaled():
    """Breaks if the steps, or what is told of them, are not those asked for."""
    scan = front_drive().scans[0]
    (coarse,) = rounded([scan], 0.5, 0.3)
    assert_allclose(coarse.doppler * 2.0, np.round(coarse.doppler * 2.0))
    assert np.abs(coarse.doppler - scan.doppler).max() <= 0.25
    assert_allclose(coarse.sigma_doppler**2, scan.sigma_doppler**2 + 0.09)
    half = scaled(scan, 0.5)
    for name in ("range", "azimuth", "doppler"):
        assert_allclose(getattr(half, f"sigma_{name}"), 0.5 * getattr(scan, f"sigma_{name}"))
        assert_allclose(getattr(half, name), getattr(scan, name))


def test_velocities_over_ground_and_folded_ones_are_undone():
    """Breaks if a cure needs more than a rough velocity, or does not cure."""
    drive = front_drive()
    scans, place, truth = drive.scans[:30], drive.mounting, drive.truth
    folded, _ = symptoms.FAULTS["Doppler folded at 8 m/s"](scans, place, truth)
    rough = truth.theta[:30] + np.array([1.0, 0.0, 0.0])
    back = unfolded(folded, rough, place, limit=8.0)
    static = [np.abs(a.doppler - b.doppler) < 1e-9 for a, b in zip(back, scans, strict=True)]
    assert np.concatenate(static).mean() > 0.95
    cut = Reference(truth.times[:30], truth.theta[:30], truth.poses[:30])
    ground, _ = symptoms.FAULTS["Doppler over ground"](scans, place, cut)
    measured = over_ground_undone(ground, cut.theta, place)
    for one, other in zip(measured, scans, strict=True):
        assert_allclose(one.doppler, other.doppler, atol=1e-12)
