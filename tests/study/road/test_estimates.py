"""The results files of chapter 14, what is computed into them, and what is fitted for them."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d.radar import Drive, Recording, Sensor, simulate_drive, track
from d2d.radar.evaluation.calibration_model import scan_velocities
from d2d.radar.simulation.drive import CAR_MOUNTING, CAR_SPEED
from d2d.study.road import estimates
from d2d.study.road.estimates import Result
from d2d.study.road.residuals import fit_correction, residual_rms, residual_sigmas

LAG, SLIP, SPEED, YAW = 0.08, -0.06, 0.004, 0.004


@pytest.fixture(scope="module")
def drive() -> Drive:
    """A car that brakes, and bends to both sides."""
    sensor, rng = Sensor(quantised=False, clutter=0.0), np.random.default_rng(0)
    return simulate_drive(rng, 10.0, CAR_SPEED, mounting=CAR_MOUNTING, sensor=sensor)


def test_lag_slip_speed_and_mounting_are_found(drive):
    """Breaks if a parameter enters with the wrong sign or size, or takes over another's part."""
    truth, at = drive.truth, drive.mounting
    slips = SLIP * truth.theta[:, 0] * truth.theta[:, 2]
    scans = [
        replace(scan, doppler=scan.doppler - slip * np.sin(scan.azimuth + at.yaw))
        for scan, slip in zip(drive.scans, slips, strict=True)
    ]
    targets = scan_velocities([(scans, replace(at, yaw=at.yaw - YAW))])
    theta = truth.theta / [1.0 + SPEED, 1.0, 1.0]
    odometry = replace(truth, times=truth.times - LAG, theta=theta)
    fit = fit_correction(targets, odometry)
    assert fit.time_offset == pytest.approx(LAG, abs=0.003)
    assert fit.side_slip == pytest.approx(SLIP, abs=0.005)
    assert fit.speed == pytest.approx(SPEED, abs=0.001)
    assert_allclose(fit.yaw, YAW, rtol=0, atol=np.deg2rad(0.05))
    assert fit.rms == pytest.approx(1.0, abs=0.1)
    profile = [residual_rms(targets, odometry, t) for t in np.arange(0.0, 0.25, 0.02)]
    assert np.argmin(profile) == 4
    assert profile[4] == pytest.approx(fit.rms, rel=0.002)


def test_sigmas_are_read_off_the_residuals(drive):
    """Breaks if along and across change places, or the sqrt(2) of two scans is forgotten."""
    recording = Recording(drive.scans, drive.mounting, drive.truth)
    (found,) = residual_sigmas(recording, track(recording), (0, 90))
    true = drive.scans[0]
    assert found["sector"] == (0, 90)
    assert found["range"] == pytest.approx(true.sigma_range[0], rel=0.2)
    assert found["azimuth"] == pytest.approx(true.sigma_azimuth[0], rel=0.2)
    assert true.sigma_doppler[0] < found["doppler"] < 2.0 * true.sigma_doppler[0]
    assert found["pairs"] > 100


@pytest.fixture(scope="module")
def estimated(drive) -> dict[str, Result]:
    """Two runs with a gap, and times without a reference."""
    scans = [*drive.scans[:7], drive.scans[7][:0], *drive.scans[8:25]]
    found = {}
    for name, doppler in (("with", True), ("without, Doppler", False)):
        driven = track((scans, drive.mounting), doppler=doppler)
        errors = driven.theta - drive.truth.theta[1:25]
        errors[-2:] = np.nan
        found[name] = Result(driven, errors)
    return found


def test_runs_are_read_as_they_were_written(estimated, tmp_path):
    """Breaks if columns change places, or are not what the header says, a covariance loses its
    symmetry, or the file its bytes."""
    path = tmp_path / "new" / "results.csv"
    estimates.write_estimates(path, estimated)
    again = estimates.read_estimates(path)
    assert list(again) == list(estimated)
    for name, (driven, errors) in estimated.items():
        other = again[name].track
        for field in ("times", "intervals", "theta", "covariance"):
            assert_allclose(getattr(other, field), getattr(driven, field), rtol=1e-4, atol=1e-12)
        assert_array_equal(other.converged, driven.converged)
        assert_allclose(again[name].errors, errors, rtol=1e-4)
    driven, errors = estimated["with"]
    first = pd.read_csv(path).iloc[0]
    expected = {"vx": driven.theta[0, 0], "omega": driven.theta[0, 2], "converged": 1.0}
    expected |= {"cov_xw": driven.covariance[0, 0, 2], "error_vx": errors[0, 0]}
    assert_allclose([first[name] for name in expected], [*expected.values()], rtol=1e-4)
    estimates.write_estimates(tmp_path / "again.csv", again)
    assert (tmp_path / "again.csv").read_bytes() == path.read_bytes()


def test_the_results_files_hold_no_measurements():
    """Breaks if targets get into what is committed: see the data's licence."""
    path = estimates.estimates_path(105)
    header = path.read_text().splitlines()[0].split(",")
    assert not {"range", "azimuth", "vr", "rcs", "x_seq", "y_seq", "yaw_seq"} & set(header)
    known = "seconds stated_rmse sigmas duration targets corrections profile halves"
    assert set(estimates.read_facts(path)) == set(known.split())
    assert len(json.dumps(estimates.read_facts(path))) < 20_000


@pytest.mark.radarscenes
def test_the_committed_results_are_what_the_data_give(radarscenes, tmp_path):
    """Breaks if the code changes the estimates and the chapter still shows the old ones."""
    names = ("sensor 3, baseline 2", "four sensors, baseline 2", "four sensors, Doppler only")
    chosen = {name: estimates.RUNS[name] for name in names}
    results, facts = estimates.compute(radarscenes, 105, chosen)
    estimates.write_estimates(tmp_path / "fresh.csv", results)
    fresh = estimates.read_estimates(tmp_path / "fresh.csv")
    path = estimates.estimates_path(105)
    committed, known = estimates.read_estimates(path), estimates.read_facts(path)
    for name in names:
        for field in ("times", "intervals", "theta", "covariance", "converged"):
            ours, theirs = (getattr(each[name].track, field) for each in (fresh, committed))
            assert_allclose(ours, theirs, rtol=2e-4, atol=1e-6, err_msg=f"{name}: {field}")
        assert_allclose(fresh[name].errors, committed[name].errors, rtol=1e-3, atol=1e-5)
        assert_allclose(facts["stated_rmse"][name], known["stated_rmse"][name], rtol=1e-4)
    for one, other in zip(facts["corrections"], known["corrections"], strict=True):
        assert one["time_offset"] == pytest.approx(other["time_offset"], abs=1e-4)
