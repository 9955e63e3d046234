"""The results files of chapter 14, what is computed into them, and what is fitted for them.

The stand-in for the data set is a made-up drive of four sensors whose clock is late, whose axle
slips and whose mountings are turned by known amounts.
"""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d import rigid
from d2d.radar import (
    Mounting,
    RadarScan,
    Recording,
    Reference,
    doppler_velocity,
    track,
)
from d2d.radar.evaluation.calibration_model import scan_velocities
from d2d.radar.tracks.path import integrate
from d2d.study.road import estimates
from d2d.study.road.estimates import Result
from d2d.study.road.residuals import fit_correction, residual_rms, residual_sigmas

LAG, SLIP, SPEED = 0.08, -0.06, 0.004
YAW = np.deg2rad([0.2, -0.15, 0.1, -0.25])
MOUNTINGS = [
    Mounting(3.7, -0.9, -1.48),
    Mounting(3.9, -0.7, -0.44),
    Mounting(3.9, 0.7, 0.44),
    Mounting(3.7, 0.9, 1.48),
]
SIGMAS = (0.1, 0.004, 0.05)
START = 100.0


def velocity(time) -> np.ndarray:
    """[v_x, v_y, omega] (n, 3) at the odometry's times: braking, and bends to both sides."""
    time = np.asarray(time, dtype=float) - START
    v, omega = 12.0 + 3.0 * np.sin(1.3 * time), 0.25 * np.sin(1.7 * time + 1.0)
    return np.column_stack([v, SLIP * v * omega, omega])


def recordings(count: int = 50, time_offset: float = LAG, side_slip: float = SLIP):
    """Four recordings of one world; the odometry as `load_radarscenes` would correct it."""
    rng = np.random.default_rng(5)
    fine = START + np.arange(-0.5, 0.075 * count + 0.5, 0.005)
    poses = integrate(velocity(fine)[:-1], np.diff(fine))
    points = rng.uniform([-40.0, -60.0], [110.0, 60.0], (700, 2))
    found = []
    for s, mounting in enumerate(MOUNTINGS):
        scans = []
        times = START + 0.075 * np.arange(count) + 0.017 * s
        for time in times:
            real = time - LAG
            x, y, yaw = (np.interp(real, fine, column) for column in poses.T)
            theta = velocity([real])[0] * [1.0 + SPEED, 1.0, 1.0]
            true = replace(mounting, yaw=mounting.yaw + YAW[s])
            ahead = rigid.transform_means(
                rigid.inverse(rigid.compose([x, y, yaw], true.pose)), points
            )
            distance, azimuth = np.hypot(*ahead.T), np.arctan2(ahead[:, 1], ahead[:, 0])
            doppler = doppler_velocity(theta, azimuth, true)
            seen = (np.abs(azimuth) < 0.9) & (distance < 50.0) & (distance > 3.0)
            noise = rng.standard_normal((3, len(points))) * np.array(SIGMAS)[:, None]
            measured = (np.stack([distance, azimuth, doppler]) + noise)[:, seen]
            scans.append(RadarScan(time, *measured, *SIGMAS))
        odometry = velocity(times - time_offset)
        odometry[:, 1] = side_slip * odometry[:, 0] * odometry[:, 2]
        found.append(Recording(scans, mounting, Reference(times, odometry, np.zeros((count, 3)))))
    return found


@pytest.fixture(scope="module")
def raw():
    """The recordings with the odometry as it is."""
    return recordings(time_offset=0.0, side_slip=0.0)


# ---- clock, slip, mountings, noise


def static_targets(found):
    return scan_velocities((recording.scans, recording.mounting) for recording in found)


def test_lag_slip_speed_and_mountings_are_found(raw):
    """Breaks if a parameter enters with the wrong sign or size, or takes over another's part."""
    fit = fit_correction(static_targets(raw), raw[0].reference)
    assert fit.time_offset == pytest.approx(LAG, abs=0.003)
    assert fit.side_slip == pytest.approx(SLIP, abs=0.005)
    assert fit.speed == pytest.approx(SPEED, abs=0.001)
    assert_allclose(fit.yaw, YAW, rtol=0, atol=np.deg2rad(0.05))
    assert fit.rms == pytest.approx(1.0, abs=0.1)
    targets, odometry = static_targets(raw), raw[0].reference
    profile = [residual_rms(targets, odometry, t) for t in np.arange(0.0, 0.25, 0.02)]
    assert fit.rms <= min(profile) + 1e-9
    assert profile[4] == pytest.approx(fit.rms, rel=0.01)


def test_sigmas_are_read_off_the_residuals():
    """Breaks if along and across change places, or the sqrt(2) of two scans is forgotten."""
    recording = recordings(20)[2]
    near = [scan[scan.range < 25.0] for scan in recording.scans]
    true = replace(recording.mounting, yaw=recording.mounting.yaw + YAW[2])
    recording = replace(recording, scans=near, mounting=true)
    driven = track(recording)
    (found,) = residual_sigmas(recording, driven, (0, 90))
    assert found["sector"] == (0, 90)
    assert found["range"] == pytest.approx(SIGMAS[0], rel=0.2)
    assert found["azimuth"] == pytest.approx(SIGMAS[1], rel=0.2)
    assert SIGMAS[2] < found["doppler"] < 2.0 * SIGMAS[2]
    assert found["pairs"] > 100


# ---- the files


@pytest.fixture(scope="module")
def estimated() -> dict[str, Result]:
    """Two runs with a gap, and times without a reference."""
    recording = recordings(25)[2]
    scans = [*recording.scans[:7], recording.scans[7][:0], *recording.scans[8:]]
    found = {}
    for name, doppler in (("with", True), ("without, Doppler", False)):
        driven = track((scans, recording.mounting), doppler=doppler)
        errors = driven.theta - recording.reference.theta[1:]
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


# ---- the committed results


def test_the_results_files_hold_no_measurements():
    """Breaks if targets get into what is committed: see the data's licence."""
    path = estimates.estimates_path(105)
    header = path.read_text().splitlines()[0].split(",")
    assert not {"range", "azimuth", "vr", "rcs", "x_seq", "y_seq", "yaw_seq"} & set(header)
    assert set(estimates.read_facts(path)) == {
        *("seconds", "stated_rmse", "sigmas", "duration", "targets", "corrections", "profile"),
        "halves",
    }
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
            assert_allclose(
                getattr(fresh[name].track, field),
                getattr(committed[name].track, field),
                rtol=2e-4,
                atol=1e-6,
                err_msg=f"{name}: {field}",
            )
        assert_allclose(fresh[name].errors, committed[name].errors, rtol=1e-3, atol=1e-5)
        assert_allclose(facts["stated_rmse"][name], known["stated_rmse"][name], rtol=1e-4)
    for one, other in zip(facts["corrections"], known["corrections"], strict=True):
        assert one["time_offset"] == pytest.approx(other["time_offset"], abs=1e-4)
