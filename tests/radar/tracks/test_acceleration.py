"""The acceleration by which estimates are carried to their times."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d.radar import ErrorBudget, track
from d2d.radar.motion.doppler import Acceleration
from d2d.radar.simulation.drive import CAR_SPEED, _motion
from d2d.radar.tracks import acceleration
from d2d.radar.tracks.acceleration import (
    JERK,
    UNKNOWN,
    AccelerationFilter,
    accelerations_of_others,
)
from d2d.scores import normalised_squares
from tests.radar.scenes import AROUND, accelerating

DELAY = np.array([[0.0, 0.0, 0.01], [0.0, 0.02, 0.3], [0.0, 0.0, -0.15]])
NOISE = np.diag(np.square([0.02, 0.05, 0.006]))
UNSEEN = Acceleration(np.zeros(3), UNKNOWN)


def moved(passed):
    """The transition (6, 6) of velocity and acceleration over a time, and the covariance (2, 2) of
    a random walk of acceleration and its integral."""
    move = np.eye(6)
    move[:3, 3:] = passed * np.eye(3)
    return move, np.array([[passed**3 / 3.0, passed**2 / 2.0], [passed**2 / 2.0, passed]])


def of_car(rng, times, speed=CAR_SPEED, start=0.0):
    """Velocities and accelerations (n, 3) of a car around a block, and estimates (n, 3) of it."""
    later, theta, earlier = (_motion(times + by, start, speed).theta for by in (5e-3, 0.0, -5e-3))
    accelerations = (later - earlier) / 1e-2
    errors = rng.multivariate_normal(np.zeros(3), NOISE, len(times))
    return theta, accelerations, theta + accelerations @ DELAY.T + errors


@pytest.fixture
def one_mode(monkeypatch):
    """There is only the usual jerk."""
    monkeypatch.setattr(acceleration, "JERK_SCALES", np.ones(1))
    monkeypatch.setattr(acceleration, "MODE_PRIOR", np.ones(1))


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


@pytest.mark.usefixtures("one_mode")
def test_the_filter_and_the_smoother_are_least_squares():
    """Breaks if one of them does not use all estimates that it may, with their weights.

    One Gaussian of all states and estimates together gives the same.
    """
    times = np.array([0.0, 0.1, 0.17, 0.4, 0.5])
    _, _, estimates = of_car(np.random.default_rng(1), times)
    n = len(times)
    system, values, spread = [], [], []
    for i in range(n):  # states: theta and a at each time
        row = np.zeros((3, 6 * n))
        row[:, 6 * i : 6 * i + 3], row[:, 6 * i + 3 : 6 * i + 6] = np.eye(3), DELAY
        system.append(row), values.append(estimates[i]), spread.append(NOISE)
    for i, passed in enumerate(np.diff(times)):
        row, (move, corner) = np.zeros((6, 6 * n)), moved(passed)
        row[:, 6 * i : 6 * i + 6], row[:, 6 * i + 6 : 6 * i + 12] = move, -np.eye(6)
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


def test_a_jump_is_no_acceleration():
    """Breaks if an estimate that is wrong makes those after it wrong, as long as it is known."""
    learnt, times = AccelerationFilter(), 0.1 * np.arange(20)
    for time in times:
        jumped = [12.0, 1.2 * (time > 1.85), 0.1]
        learnt.update(time, np.array(jumped), DELAY, NOISE, learnt.predict(time) or UNSEEN)
    found = learnt.predict(2.0)
    assert found is not None
    assert abs(found.value[1]) < 0.1


@pytest.mark.parametrize(
    ("speed", "causal", "smooth"), [(1.0, (0.8, 1.1), (0.8, 1.1)), (5.0, (0.9, 1.75), (0.9, 1.2))]
)
def test_estimates_of_a_car_are_carried_as_surely_as_stated(speed, causal, smooth):
    """Breaks if the modes do not cover what a vehicle does, or the stated covariance is too large.

    A car that takes the corners of a block at 8 m/s, with accelerations of 2.6 m/s^2 and 19 deg/s^2
    RMS, is beyond every mode, as `test_a_hard_drive_is_smoothed` says.
    """
    found = np.mean([carried(seed, speed) for seed in range(5)], axis=0)
    assert causal[0] < found[0] < causal[1]
    assert smooth[0] < found[2] < smooth[1]


def test_a_hard_drive_is_smoothed():
    """Breaks if there is no mode for sharp corners: with a jerk of twice the usual one at most, the
    yaw rate is wrong by 1.7 deg/s, and the covariance by a factor of 7."""
    found = np.mean([carried(seed, CAR_SPEED) for seed in range(5)], axis=0)
    assert found[2] < 1.8
    assert found[3] < np.deg2rad(0.7)


def carried(seed, speed):
    """ANEES of the estimates that are carried, and the RMS error of omega, causal and smooth."""
    times = 0.1 * np.arange(600)
    theta, _, estimates = of_car(np.random.default_rng(seed), times, speed, 17.0 * seed)
    known, steps = filtered(times, estimates)
    found = []
    for by in (known, accelerations_of_others(steps)):
        errors = estimates - theta - [DELAY @ each.value for each in by]
        stated = NOISE + DELAY @ np.array([each.covariance for each in by]) @ DELAY.T
        found += [normalised_squares(errors, stated).mean() / 3.0, np.std(errors[:, 2])]
    return found


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
    for steady in ([2.0, 0.0, 0.0], [-2.0, 0.0, 0.04]):
        end = 5.0 if rates[0] == 1.0 else 2.0
        sensors, truth = accelerating(rates, offsets, np.array(steady), mountings, jitter, end=end)
        found = track(sensors, horizon=0.3, budget=ErrorBudget(), smooth=smooth)
        good = found.converged
        assert good.mean() > 0.9 or rates == [1.0]
        sigmas = np.sqrt(np.diagonal(found.covariance[good], axis1=1, axis2=2))
        errors = np.abs(found.theta - truth(found.times))[good] / sigmas
        # a target that moves into another's place in the mixture makes a small error of its own
        assert np.median(errors, axis=0).max() < 0.2
        assert np.quantile(errors, 0.9) < 0.3
