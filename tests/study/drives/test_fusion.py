"""A gyro and a radar in one filter: the filter itself, its verdicts."""

import numpy as np
import pytest

from d2d.radar import CovarianceParts, ErrorBudget, FilterInput, VelocityEstimate
from d2d.radar.motion.doppler import Acceleration
from d2d.radar.tracks.tracker import track_of
from d2d.study.drives import fusion
from d2d.study.drives.fusion import FILTERS, Measured, fuse


def synthetic(rng: np.random.Generator, count: int = 300) -> Measured:
    """A drive by the filter's own model: Gauss-Markov motion, exact columns and covariances."""
    step, added = fusion.SIMULATED.over(0.1)
    noise, nothing = np.diag([0.05, 0.2, 0.05]) ** 2, np.zeros((3, 3))
    slow = np.array([[0.0, 0.05, 0.0, 0.0], [0.1, 0.0, 0.0, 0.0], [0.0, 0.0, 0.02, 0.0]])
    parts = CovarianceParts(noise, nothing, slow @ slow.T)
    delay = 0.1 * np.array([[0.0, 0.0, 0.0], [0.0, 0.1, 2.0], [0.0, 0.0, -0.6]])
    constant, root = rng.standard_normal(5), np.linalg.cholesky(added)
    state = np.array([8.0, *np.zeros(5)])
    truth, estimates = [], []
    for i in range(count):
        state = step @ state + root @ rng.standard_normal(6)
        seen = FilterInput(np.zeros(3), parts, delay, slow, 0.02)
        value, _ = seen.expected(state[:3], state[3:], constant)
        value = value + [0.05, 0.2, 0.05] * rng.standard_normal(3)
        known = Acceleration(state[3:], nothing)
        theta, own = seen._replace(velocity=value).carried(known)
        seen = seen._replace(velocity=value)
        time = 0.1 * (i + 1)
        estimates.append(VelocityEstimate(time, 0.1, theta, own.total, "", 20, 0.9, own, seen))
        truth.append(state[:3])
    radar = track_of(estimates, ErrorBudget())
    bias = fusion.GYRO_BIAS * rng.standard_normal()
    gyro = np.array(truth)[:, 2] + bias + fusion.GYRO_NOISE * rng.standard_normal(count)
    return Measured(gyro, radar, estimates, radar.parts.noise, np.array(truth), bias)


def test_the_filter_is_credible_where_its_model_is_true(monkeypatch):
    """Breaks if prediction or update of the Kalman filter is wrong."""
    monkeypatch.setattr(fusion, "GATE", np.inf)
    rng = np.random.default_rng(1)
    results = [fuse(synthetic(rng), FILTERS[2]) for _ in range(12)]
    nis = np.concatenate([each.nis[20:] for each in results])
    nees = np.concatenate([each.nees[20:] for each in results])
    assert 0.93 < nis.mean() / 3.0 < 1.07
    assert np.mean(nis < fusion.REGION) == pytest.approx(0.95, abs=0.015)
    assert 0.6 < nees.mean() / 3.0 < 1.5
    blind = fuse(synthetic(rng), FILTERS[0])
    assert blind.nees[20:].mean() > 2.0 * nees.mean()


def test_nothing_is_used_where_the_radar_has_no_estimate():
    """Breaks if the last velocity, repeated where an estimate failed, is taken for a new one."""
    measured = synthetic(np.random.default_rng(0), 60)
    estimates = [
        each._replace(reason="lost", filter_input=None) if 30 <= i < 40 else each
        for i, each in enumerate(measured.estimates)
    ]
    lost = measured._replace(estimates=estimates)
    for name in FILTERS:
        result, whole = fuse(lost, name), fuse(measured, name)
        assert np.isnan(result.nis[30:40]).all()
        assert not result.used[30:40].any()
        assert np.isfinite(result.errors).all()
        assert result.covariances[39, 0, 0] > 4.0 * whole.covariances[39, 0, 0]
