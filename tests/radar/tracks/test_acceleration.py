"""The acceleration by which estimates are carried to their times."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d.radar import ErrorBudget, Mounting, track
from d2d.radar.motion.doppler import Acceleration
from d2d.radar.tracks.acceleration import JERK, UNKNOWN, AccelerationFilter, accelerations_of_others
from tests.radar.scenes import AROUND, CORNER, accelerating

DELAY = np.array([[0.0, 0.0, 0.01], [0.0, 0.02, 0.3], [0.0, 0.0, -0.15]])
NOISE = np.diag(np.square([0.02, 0.05, 0.006]))
UNSEEN = Acceleration(np.zeros(3), UNKNOWN)


def drawn(rng, times):
    """Accelerations (n, 3) and estimates (n, 3) by the model of the filter."""
    state = np.concatenate([[12.0, 0.0, 0.1], rng.multivariate_normal(np.zeros(3), UNKNOWN)])
    states = [state]
    for passed in np.diff(times):
        move = np.eye(6)
        move[:3, 3:] = passed * np.eye(3)
        corner = np.array([[passed**3 / 3.0, passed**2 / 2.0], [passed**2 / 2.0, passed]])
        states.append(rng.multivariate_normal(move @ states[-1], np.kron(corner, JERK)))
    states = np.array(states)
    errors = rng.multivariate_normal(np.zeros(3), NOISE, len(times))
    return states[:, 3:], states[:, :3] + states[:, 3:] @ DELAY.T + errors


def filtered(times, estimates):
    """The accelerations before each estimate, and the steps of the filter."""
    known, learnt, steps = [], AccelerationFilter(), []
    for time, estimate in zip(times, estimates, strict=True):
        known.append(learnt.predict(time) or UNSEEN)
        steps.append(learnt.update(time, estimate, DELAY, NOISE, known[-1]))
    return known, steps


def test_estimates_far_more_precise_than_the_acceleration_are_survived():
    """Breaks if rounding makes the covariance of what the others show indefinite, so that a smooth
    track with standard deviations of micrometres is refused."""
    precise, learnt, steps = np.diag(np.square([1e-6, 1e-2, 1e-3])), AccelerationFilter(), []
    for time in np.cumsum(np.random.default_rng(0).uniform(0.5, 1.5, 12)):
        by = learnt.predict(time) or UNSEEN
        steps.append(learnt.update(time, np.array([5.0 + time, 0.0, 0.1]), DELAY, precise, by))
    for _, covariance in accelerations_of_others(steps):
        assert np.linalg.eigvalsh(covariance)[0] > 0.0


def test_the_filter_and_the_smoother_are_least_squares():
    """Breaks if one of them does not use all estimates that it may, with their weights.

    One Gaussian of all states and estimates together gives the same.
    """
    times = np.array([0.0, 0.1, 0.17, 0.4, 0.5])
    _, estimates = drawn(np.random.default_rng(1), times)
    n = len(times)
    system, values, spread = [], [], []
    for i in range(n):  # states: theta and a at each time
        row = np.zeros((3, 6 * n))
        row[:, 6 * i : 6 * i + 3], row[:, 6 * i + 3 : 6 * i + 6] = np.eye(3), DELAY
        system.append(row), values.append(estimates[i]), spread.append(NOISE)
    for i, passed in enumerate(np.diff(times)):
        row, move = np.zeros((6, 6 * n)), np.eye(6)
        move[:3, 3:] = passed * np.eye(3)
        row[:, 6 * i : 6 * i + 6], row[:, 6 * i + 6 : 6 * i + 12] = move, -np.eye(6)
        corner = np.array([[passed**3 / 3.0, passed**2 / 2.0], [passed**2 / 2.0, passed]])
        system.append(row), values.append(np.zeros(6)), spread.append(np.kron(corner, JERK))
    first = np.zeros((3, 6 * n))
    first[:, 3:6] = np.eye(3)
    system.append(first), values.append(np.zeros(3)), spread.append(UNKNOWN)

    def expected(i, used):
        rows = [*used, *range(n, 2 * n)]
        information, vector = np.zeros((6 * n, 6 * n)), np.zeros(6 * n)
        for k in rows:
            weight = np.linalg.inv(spread[k])
            information += system[k].T @ weight @ system[k]
            vector += system[k].T @ weight @ values[k]
        scale = np.sqrt(np.abs(np.diag(information)))
        inverse = np.linalg.pinv(information / np.outer(scale, scale), 1e-13, hermitian=True)
        inverse /= np.outer(scale, scale)
        own = slice(6 * i + 3, 6 * i + 6)
        return (inverse @ vector)[own], inverse[own, own]

    known, steps = filtered(times, estimates)
    for i, others in enumerate(accelerations_of_others(steps)):
        cases = [(others, [j for j in range(n) if j != i])]
        if i:
            cases.append((known[i], list(range(i))))
        for found, used in cases:
            value, covariance = expected(i, used)
            assert_allclose(found.value, value, rtol=1e-4, atol=1e-5)
            assert_allclose(found.covariance, covariance, rtol=1e-4, atol=1e-7)


def test_both_know_how_well_they_know():
    """Breaks if a covariance is not that of the errors."""
    rng, times = np.random.default_rng(2), np.cumsum(np.full(25, 0.08))
    squares = []
    for _ in range(150):
        true, estimates = drawn(rng, times)
        known, steps = filtered(times, estimates)
        for found in (known, accelerations_of_others(steps)):
            errors = [each.value for each in found] - true
            own = np.array([each.covariance for each in found])
            squares.append(np.einsum("ni,nij,nj->n", errors, np.linalg.inv(own), errors) / 3.0)
    causal, smooth = np.mean(squares[::2], axis=0), np.mean(squares[1::2], axis=0)
    for found in (causal, smooth):
        assert (np.abs(found[[0, 12, -1]] - 1.0) < 0.25).all()
        assert found.mean() == pytest.approx(1.0, abs=0.1)


def test_nothing_is_known_after_a_gap():
    """Breaks if an acceleration lasts as long as nothing is seen."""
    learnt = AccelerationFilter()
    assert learnt.predict(0.0) is None
    step = learnt.update(0.0, np.zeros(3), DELAY, NOISE, UNSEEN)
    assert learnt.predict(1.5) is not None
    assert learnt.predict(2.5) is None
    (alone,) = accelerations_of_others([step])
    assert_allclose(alone.covariance, UNKNOWN)
    assert accelerations_of_others([]) == []


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize(
    ("rates", "offsets", "jitter"),
    [
        ([1.0], [0.0], 0.0),
        ([4.0], [0.0], 0.2),
        ([25.0], [0.0], 0.0),
        ([13.0] * 3, [0.01, 0.03, 0.06], 0.2),
        ([20.0, 4.0], [0.01, 0.03], 0.0),
        ([1.0, 1.0], [0.0, 0.3], 0.0),
    ],
    ids=["1 Hz", "4 Hz, jitter", "25 Hz", "three, jitter", "20 and 4 Hz", "1 Hz, 0.3 s apart"],
)
def test_a_constant_acceleration_makes_no_error(rates, offsets, jitter, smooth):
    """Breaks if an estimate lags behind, whatever the rates of the radars."""
    mountings = AROUND[: len(rates)]
    for acceleration in ([2.0, 0.0, 0.0], [-2.0, 0.0, 0.04]):
        end = 5.0 if rates[0] == 1.0 else 2.0
        sensors, truth = accelerating(
            rates, offsets, np.array(acceleration), mountings, jitter, end=end
        )
        found = track(sensors, horizon=0.3, budget=ErrorBudget(), smooth=smooth)
        good = found.converged
        assert good.mean() > 0.9 or rates == [1.0]
        sigmas = np.sqrt(np.diagonal(found.covariance[good], axis1=1, axis2=2))
        errors = np.abs(found.theta - truth(found.times))[good] / sigmas
        # a target that moves into another's place in the mixture makes a small error of its own
        assert np.median(errors, axis=0).max() < 0.2
        assert np.quantile(errors, 0.9) < 0.3


@pytest.mark.slow
@pytest.mark.parametrize("smooth", [False, True])
def test_the_covariance_contains_the_error_of_the_carry(smooth):
    """Breaks if the acceleration is taken as known, at the first, an inner or the last estimate."""
    squares = []
    for seed in range(60):
        sensors, truth = accelerating(
            [10.0], [0.0], np.zeros(3), [Mounting(3.6, 0.5, 0.3)], noise=1.0, seed=seed, end=1.6
        )
        found = track(sensors, horizon=0.3, budget=ErrorBudget(), limits=None, smooth=smooth)
        assert found.converged.all()
        errors = found.theta - truth(found.times)
        inverse = np.linalg.inv(found.covariance)
        squares.append(np.einsum("ni,nij,nj->n", errors, inverse, errors) / 3.0)
    mean = np.mean(squares, axis=0)
    # 60 runs of three components: a standard deviation of 0.1; what the vehicle could have done
    # but did not is in the covariance, too
    assert (np.abs(mean[[0, 8, -1]] - 1.0) < 0.3).all()
    assert 0.8 < mean.mean() < 1.1


def test_one_estimate_alone_is_carried_by_what_is_usual():
    """Breaks if two scans give a covariance as if the vehicle could not accelerate."""
    sensors, _ = accelerating([10.0], [0.0], np.zeros(3), [CORNER], end=0.2)
    found = track(sensors, budget=ErrorBudget())
    assert len(found.times) == 1
    assert found.converged.all()
