"""A gyro and a radar in one filter: the slow errors' columns, the filter itself, its verdicts."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d.radar import (
    CovarianceParts,
    ErrorBudget,
    Sensor,
    SensorErrors,
    Track,
    simulate_drive,
    track,
)
from d2d.radar.simulation.drive import CAR_MOUNTING, CAR_SPEED
from d2d.study.drives import figures, fusion
from d2d.study.drives.budget_trial import INGREDIENTS, BudgetTrial
from d2d.study.drives.fusion import FILTERS, Measured, fuse


@pytest.fixture(scope="module")
def drives():
    return fusion.measured_drives(6, 8.0, 3)


def test_the_columns_add_up_to_the_systematic_covariance(drives):
    """Breaks if a column is not that of one standard deviation of its error.

    The track's covariance sums the targets' influences in compiled code, one scan after the other.
    The rest is that of the lag, whose acceleration is known to within 1 m/s^2.  The track's own
    optima know of the acceleration, by which influences differ by a percent.
    """
    lag = INGREDIENTS["all"].budget.lag
    for measured in drives[:2]:
        products = np.einsum("nia,nja->anij", measured.slow, measured.slow)
        rest = measured.radar.parts.systematic - products[:3].sum(axis=0)
        size = np.nanmax(measured.radar.parts.systematic)
        assert_allclose(rest, products[3], rtol=0, atol=lag**2 + 0.02 * size)


def test_a_column_is_what_its_error_does_to_the_radar():
    """Breaks if a column has the wrong sign: the budget squares it, a filter does not.

    The same drive with and without the error; a lag is known only as well as the acceleration.
    """

    def driven(budget: ErrorBudget, errors: SensorErrors | None):
        drive = simulate_drive(
            np.random.default_rng(2),
            3.0,
            CAR_SPEED,
            start=4.5,
            mounting=CAR_MOUNTING,
            sensor=Sensor(quantised=False, clutter=0.0),
            errors=errors,
        )
        found = track((drive.scans, CAR_MOUNTING), initial=drive.truth.theta[0], budget=budget)
        return found.theta, fusion.slow_errors(drive.scans, CAR_MOUNTING, found, budget)

    errors = {"azimuth": (1e-4, 1), "doppler": (1e-3, 0), "scale": (1e-4, 0), "lag": (0.02, 0)}
    for column, (name, (small, component)) in enumerate(errors.items()):
        budget = ErrorBudget(**{name: small})
        plain, slow = driven(budget, None)
        moved = driven(budget, SensorErrors(**{name: small}))[0] - plain
        expected = slow[:, component, column]
        assert np.abs(expected).max() > 1e-5
        slope = expected @ moved[:, component] / (expected @ expected)
        assert slope == pytest.approx(1.0, abs=0.4 if name == "lag" else 0.02), name


def synthetic(rng: np.random.Generator, count: int = 300) -> Measured:
    """A drive by the filter's own model: Gauss-Markov motion, exact columns and covariances."""
    state, truth = np.array([8.0, 0.0, 0.0, 0.0, 0.0]), []
    for _ in range(count):
        step, added = fusion._motion(5, 0.1)
        state = step @ state + np.sqrt(np.diag(added)) * rng.standard_normal(5)
        truth.append(state[:3])
    truth = np.array(truth)
    noise = np.tile(np.diag([0.05, 0.2, 0.05]) ** 2, (count, 1, 1))
    slow = np.zeros((count, 3, 4))
    slow[:, 1, 0], slow[:, 0, 1], slow[:, 2, 2] = 0.1, 0.05, 0.02
    constant = rng.standard_normal(4)
    theta = truth + slow @ constant + rng.standard_normal((count, 3)) * [0.05, 0.2, 0.05]
    parts = CovarianceParts(noise, 0.0 * noise, np.einsum("nia,nja->nij", slow, slow))
    times = 0.1 * np.arange(1, count + 1)
    radar = Track(times, np.full(count, 0.1), theta, parts.total, np.ones(count, bool), parts=parts)
    bias = fusion.GYRO_BIAS * rng.standard_normal()
    gyro = truth[:, 2] + bias + fusion.GYRO_NOISE * rng.standard_normal(count)
    return Measured(gyro, radar, noise, slow, truth, bias)


def test_the_filter_is_credible_where_its_model_is_true():
    """Breaks if prediction or update of the Kalman filter is wrong."""
    rng = np.random.default_rng(1)
    results = [fuse(synthetic(rng), FILTERS[2], np.inf) for _ in range(12)]
    nis = np.concatenate([each.nis[20:] for each in results])
    nees = np.concatenate([each.nees[20:] for each in results])
    assert 0.93 < nis.mean() / 3.0 < 1.07
    assert np.mean(nis < fusion.REGION) == pytest.approx(0.95, abs=0.015)
    assert 0.6 < nees.mean() / 3.0 < 1.5
    blind = fuse(synthetic(rng), FILTERS[0], np.inf)
    assert blind.nees[20:].mean() > 2.0 * nees.mean()


def test_nothing_is_used_where_the_radar_has_no_estimate():
    """Breaks if the last velocity, repeated where an estimate failed, is taken for a new one."""
    measured = synthetic(np.random.default_rng(0), 60)
    converged = measured.radar.converged.copy()
    converged[30:40] = False
    lost = measured._replace(radar=replace(measured.radar, converged=converged))
    result, whole = fuse(lost, FILTERS[2]), fuse(measured, FILTERS[2])
    assert np.isnan(result.nis[30:40]).all()
    assert not result.used[30:40].any()
    assert np.isfinite(result.errors).all()
    assert result.covariances[39, 0, 0] > 4.0 * whole.covariances[39, 0, 0]


def test_only_with_the_slow_errors_as_states_the_filter_can_be_believed(drives):
    """Breaks if the budget does not make the filter's statements true, or no longer needs to."""
    found = fusion.fusion_trial(drives)
    inverse, white, states = range(3)
    assert found.nis[inverse] > 1.25 > found.nis[states] > 0.6
    assert found.rejected[inverse] > 0.015 > found.rejected[states]
    assert found.nees[inverse] > 5.0 > 2.0 > found.nees[states]
    assert found.nees_within[inverse] < 0.5 < 0.8 < found.nees_within[states]
    assert found.nees_within[white] < found.nees_within[states]
    assert found.rmse[states, 0] < found.rmse[inverse, 0]


def test_the_figures_show_every_ingredient_and_what_the_gate_rejects(drives):
    """Breaks if rows are left out, or an innovation beyond the gate is drawn as one that counts."""
    _, axes = plt.subplots(3, 3)
    fused = {name: fuse(drives[0], name) for name in FILTERS}
    figures.filters(axes, fused)
    for column, result in enumerate(fused.values()):
        used, rejected = axes[0, column].lines[:2]
        assert len(used.get_xdata()) == result.used.sum()
        assert (rejected.get_ydata() > fusion.GATE).all()
    _, ax = plt.subplots()
    anees = np.array([[3.0, 2.0, 1.0], [5.0, 4.0, 1.1]])
    intervals = np.stack([anees - 0.1, anees + 0.1], axis=1)
    figures.ingredients(ax, BudgetTrial(("a", "b"), anees, intervals, anees))
    assert [label.get_text() for label in ax.get_yticklabels()] == ["a", "b"]
    assert_allclose(ax.containers[2].lines[0].get_xdata(), anees[:, 2])
