"""The guides: tracks, small covariances, and the logs of the readers' project."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d import PointSet, register
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
from d2d.study.guides import small_covariance as small
from d2d.study.guides.project import hidden_log
from d2d.study.guides.rows import row, row_table
from d2d.study.guides.stated_sigmas import front_drive
from d2d.study.plane.evaluation import LIKELIHOOD
from d2d.study.plane.scenarios import OVERLAPPED

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


THETA = OVERLAPPED.theta
FIXED, MOVING = OVERLAPPED.sample(400, np.random.default_rng(3))


def test_repeated_targets_divide_the_covariance_and_nothing_else():
    """Breaks if a copy has an error of its own, or moves the optimum."""
    one = register(FIXED[:5], MOVING[:5], LIKELIHOOD, THETA)
    three = register(small.repeated(FIXED[:5], 3), small.repeated(MOVING[:5], 3), LIKELIHOOD, THETA)
    assert_allclose(three.theta, one.theta, atol=1e-6)
    assert_allclose(three.covariance, one.covariance / 3.0, rtol=1e-4)


def test_unit_weights_are_repaired_by_the_residuals():
    """Breaks if the variance of the residuals is not that of two points."""
    rng = np.random.default_rng(0)
    noisy = [
        PointSet(0.3 * rng.standard_normal((4000, 8, 2)) + true, np.eye(2))
        for true in OVERLAPPED.true_sets
    ]
    found = register(*noisy, LIKELIHOOD, THETA)
    variance = small.residual_variance(found.theta, *noisy) / 2.0
    assert variance.mean() == pytest.approx(0.09, rel=0.05)
    scaled = small.credibility_of(found, THETA, found.covariance * variance[:, None, None])
    # with 13 degrees of freedom the variance itself is known roughly: E(1 / chi^2) = 1 / 11
    assert scaled.anees == pytest.approx(13.0 / 11.0, rel=0.05)
    assert small.credibility_of(found, THETA).anees < 0.15


def test_halves_are_of_different_targets():
    """Breaks if both halves hold the same targets, or the first half always the same ones."""
    each = small.halves(FIXED, MOVING, LIKELIHOOD, THETA, np.arange(8))
    assert each.anees == pytest.approx(1.0, abs=0.15)
    pairs = small.halves(FIXED, MOVING, LIKELIHOOD, THETA, np.arange(8) // 2)
    assert pairs.anees == pytest.approx(1.0, abs=0.15)
    assert abs(pairs.nees - each.nees).max() > 0.1
    two = small.repeated(FIXED, 2), small.repeated(MOVING, 2)
    together = small.halves(*two, LIKELIHOOD, THETA, np.repeat(np.arange(8), 2))
    assert_allclose(together.nees, 2.0 * each.nees, rtol=0.05)


def test_a_bias_does_not_average_out():
    """Breaks if the error falls with the number of targets as the inverse Hessian does."""
    rows = small.bias_against_targets()
    first, last = rows.iloc[0], rows.iloc[-1]
    assert last["targets"] > 4.0 * first["targets"]
    assert last["stated"] < 0.5 * first["stated"]
    assert last["error"] > 2.0 * last["stated"]
    assert (rows["budget stated"] / rows["budget error"]).between(0.85, 1.15).all()


@pytest.mark.parametrize("name", ["first", "second", "third"])
def test_a_hidden_fault_shows(name: str) -> None:
    """Breaks if a log has no fault that a reader could find."""
    log = hidden_log(name, 20.0)
    assert compare(track(log), log.truth).measures.anees > 2.0


def test_another_log_is_refused() -> None:
    with pytest.raises(ValueError, match=r"^name must be one of first, second, third"):
        hidden_log("fourth")
