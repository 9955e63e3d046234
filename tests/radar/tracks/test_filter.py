"""The filter of a track: beside a plain Kalman filter, and as certain as vehicles show it to be."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d.radar import FilterInput, track
from d2d.radar.simulation.drive import CAR_SPEED, ROAD_SPEED, ROBOT_SPEED
from d2d.radar.simulation.world import lap_motion
from d2d.radar.tracks import filter as filtering
from d2d.radar.tracks.filter import JERK, UNKNOWN, Belief, begin, predict, smooth_mixtures, update
from d2d.scores import normalised_squares
from tests.radar.scenes import AROUND, accelerating

DELAY = np.array([[-0.01, 0.0, 0.01], [0.0, -0.02, 0.3], [0.0, 0.0, -0.15]])
NOISE = np.diag(np.square([0.02, 0.05, 0.006]))
SLOW = np.array([[0.01, 0.02, 0.0], [0.04, 0.0, 0.05], [0.004, 0.0, 0.001]])
LAG, STAYS = 0.02, 15.0  # s, the latter as long as errors on the road do


def given(velocity, slow=SLOW, lag=LAG, noise=NOISE):
    """An estimate as the filter gets it."""
    return FilterInput(velocity, noise, DELAY, slow, lag)


def filtered(times, inputs):
    """The beliefs after each estimate."""
    found = []
    for time, each in zip(times, inputs, strict=True):
        before = predict(found[-1], time) if found else None
        found.append(begin(time, each) if before is None else update(before, each))
    return found


def test_the_modes_differ_by_as_much_as_they_do():
    """Breaks if a mixture is as sure as its modes are, however far these are apart."""
    own = np.array([0.01 * np.eye(6), 0.03 * np.eye(6)])
    apart = Belief(np.array([np.zeros(6), np.arange(6.0)]), own, np.zeros((2, 6, 1)))
    whole = apart.combined(np.array([0.75, 0.25]))
    assert_allclose(whole.mean, 0.25 * np.arange(6.0))
    between = 0.75 * 0.25 * np.outer(np.arange(6.0), np.arange(6.0))
    assert_allclose(whole.covariance, 0.015 * np.eye(6) + between)


def moved(passed):
    """Transition (6, 6) of velocity and acceleration over a time, and the usual noise."""
    move = np.eye(6)
    move[:3, 3:] = passed * np.eye(3)
    corner = [[passed**3 / 3.0, passed**2 / 2.0], [passed**2 / 2.0, passed]]
    return move, np.kron(corner, JERK)


def white(passed):
    """The usual noise of an estimate, and that of a mean over 0.3 s whose acceleration walks."""
    return NOISE + max(0.3 / 5.0, 0.3**2 / 9.0 / passed) * DELAY @ JERK @ DELAY.T


def drawn(rng, times, theta, accelerations, slow=SLOW, lag=LAG):
    """Estimates of a vehicle with these true velocities and accelerations (n, 3)."""
    errors, inputs = rng.standard_normal(slow.shape[1] + 1), []
    for i, (v, a) in enumerate(zip(theta, accelerations, strict=True)):
        if i:
            kept = np.exp(-(times[i] - times[i - 1]) / STAYS)
            fresh = rng.standard_normal(len(errors))
            errors = kept * errors + np.sqrt(1.0 - kept**2) * fresh
        noise = rng.multivariate_normal(np.zeros(3), NOISE)
        late = DELAY @ a - lag * errors[-1] * a
        inputs.append(given(v + late + slow @ errors[:-1] + noise, slow, lag))
    return inputs


def over_an_interval(theta_at, times):
    """Velocities (n, 3), and accelerations that make their means of the last 0.3 s from them."""
    theta = theta_at(times)
    mean = np.mean([theta_at(times - ago) for ago in 0.01 * (np.arange(30) + 0.5)], axis=0)
    return theta, (theta - mean) / 0.15


def around_the_block(times, speed, start=0.0):
    """Velocities and accelerations (n, 3) of a vehicle that drives around a block."""
    return over_an_interval(lambda at: lap_motion(at, start, speed).theta, times)


def along_a_railway(times, phase=0.0):
    """Velocities and accelerations (n, 3) of a train that changes its speed and takes curves."""

    def theta_at(at):
        t = at + phase
        parts = 35.0 + 3.0 * np.sin(0.2 * t), 0.02 * np.sin(0.5 * t), 0.02 * np.sin(0.3 * t)
        return np.stack(parts, axis=-1)

    return over_an_interval(theta_at, times)


@pytest.fixture
def one_mode(monkeypatch):
    """There is only the usual jerk."""
    monkeypatch.setattr(filtering, "JERK_SCALES", np.ones(1))


@pytest.mark.usefixtures("one_mode")
def test_it_is_a_kalman_filter_whose_gain_for_slow_errors_is_zero():
    """Breaks if a covariance is not that of the errors: a plain filter has all of them as states,
    and says what becomes of their covariance with whatever gain (Joseph)."""
    times = np.cumsum([0.0, 0.1, 0.07, 0.23, 0.1, 0.4])
    inputs = drawn(np.random.default_rng(1), times, *around_the_block(times, ROAD_SPEED, 3.0))
    state, whole, spread = np.zeros(6), np.eye(10), NOISE
    for i, (each, found) in enumerate(zip(inputs, filtered(times, inputs), strict=True)):
        if i:
            move, noise = moved(times[i] - times[i - 1])
            spread = white(times[i] - times[i - 1])
            kept = np.exp(-(times[i] - times[i - 1]) / STAYS)
            step, added = kept * np.eye(10), (1.0 - kept**2) * np.eye(10)
            step[:6, :6], added[:6, :6] = move, noise
            state, whole = move @ state, step @ whole @ step.T + added
        else:  # nothing is known of the velocity
            whole[:3, :3], whole[3:6, 3:6] = 1e8 * np.eye(3), UNKNOWN
        to = np.hstack([np.eye(3), DELAY, SLOW, -LAG * state[3:, None]])
        gain = whole @ to.T @ np.linalg.inv(to @ whole @ to.T + spread)
        gain[6:] = 0.0
        state = state + gain[:6] @ (each.velocity - to[:, :6] @ state)
        kept = np.eye(10) - gain @ to
        whole = kept @ whole @ kept.T + gain @ spread @ gain.T
        belief = found.whole
        assert_allclose(belief.mean, state, rtol=1e-5, atol=1e-5)
        assert_allclose(belief.covariance, whole[:6, :6], rtol=1e-4, atol=1e-7)
        assert_allclose(belief.cross, whole[:6, 6:], rtol=1e-4, atol=1e-7)


@pytest.mark.usefixtures("one_mode")
def test_without_slow_errors_filter_and_smoother_are_least_squares():
    """Breaks if one of them does not use all estimates that it may, with their weights."""
    times = np.array([0.0, 0.1, 0.17, 0.4, 0.5])
    inputs = drawn(
        np.random.default_rng(1), times, *around_the_block(times, CAR_SPEED), 0.0 * SLOW, 0.0
    )
    n = len(times)
    system, values, spread = [], [], []
    for i in range(n):  # states: theta and a at each time
        row = np.zeros((3, 6 * n))
        row[:, 6 * i : 6 * i + 3], row[:, 6 * i + 3 : 6 * i + 6] = np.eye(3), DELAY
        system.append(row), values.append(inputs[i].velocity)
        spread.append(white(times[i] - times[i - 1]) if i else NOISE)
    for i, passed in enumerate(np.diff(times)):
        row, (move, noise) = np.zeros((6, 6 * n)), moved(passed)
        row[:, 6 * i : 6 * i + 6], row[:, 6 * i + 6 : 6 * i + 12] = move, -np.eye(6)
        system.append(row), values.append(np.zeros(6)), spread.append(noise)
    first = np.zeros((3, 6 * n))
    first[:, 3:6] = np.eye(3)
    system.append(first), values.append(np.zeros(3)), spread.append(UNKNOWN)

    def expected(i, used):
        information, vector = np.zeros((6 * n, 6 * n)), np.zeros(6 * n)
        for k in [*used, *range(n, 2 * n)]:
            weight = np.linalg.inv(spread[k])
            information += system[k].T @ weight @ system[k]
            vector += system[k].T @ weight @ values[k]
        scale = np.sqrt(np.abs(np.diag(information)))
        inverse = np.linalg.pinv(information / np.outer(scale, scale), 1e-13, hermitian=True)
        inverse /= np.outer(scale, scale)
        own = slice(6 * i, 6 * i + 6)
        return (inverse @ vector)[own], inverse[own, own]

    causal = filtered(times, inputs)
    for i, later in enumerate(smooth_mixtures(causal)):
        for found, used in ((causal[i], range(i + 1)), (later, range(n))):
            value, covariance = expected(i, used)
            assert_allclose(found.whole.mean, value, rtol=1e-4, atol=1e-5)
            assert_allclose(found.whole.covariance, covariance, rtol=1e-3, atol=1e-7)


def anywhere(seed):
    """A time in s on the lap at which a drive begins."""
    return 120.0 * np.random.default_rng(1000 + seed).uniform()


VEHICLES = {
    "car": lambda times, seed: around_the_block(times, ROAD_SPEED, anywhere(seed)),
    "robot": lambda times, seed: around_the_block(times, ROBOT_SPEED, anywhere(seed)),
    "train": along_a_railway,
    "corners": lambda times, seed: around_the_block(times, CAR_SPEED, anywhere(seed)),
}


def normalised(vehicle, rate, seeds=30, seconds=4.0):
    """Normalised squares over 3 of the errors, causal and smooth (2, seeds, n)."""
    times, found = np.arange(0.0, seconds, 1.0 / rate), []
    for seed in range(seeds):
        theta, accelerations = VEHICLES[vehicle](times, seed)
        beliefs = filtered(times, drawn(np.random.default_rng(seed), times, theta, accelerations))
        for each in (beliefs, filtering.smooth_twice(beliefs)):
            errors = np.array([b.whole.mean[:3] for b in each]) - theta
            stated = np.array([b.whole.covariance[:3, :3] for b in each])
            found.append(normalised_squares(errors, stated) / 3.0)
    return np.array(found[::2]), np.array(found[1::2])


@pytest.mark.parametrize("rate", [4.0, 25.0])
@pytest.mark.parametrize("vehicle", ["car", "robot", "train"])
def test_errors_are_as_large_as_stated(vehicle, rate):
    """Breaks if the modes do not cover what a vehicle does, or slow errors average out.

    Of the first, an inner and the last estimate, each known to 0.15 of itself, and of all.
    """
    for own in normalised(vehicle, rate):
        first, inner, last = own.mean(axis=0)[[0, own.shape[1] // 2, -1]]
        assert 0.6 < first < 1.5  # of a vehicle that accelerates less than others, or more
        assert 0.7 < inner < 1.6
        assert 0.7 < last < 1.6
        assert 0.8 < own.mean() < 1.3


def test_corners_are_followed():
    """Breaks without a mode for them, as with a tenth of its jerk: the factor is 2 and more, or if
    a smoother takes the acceleration of an interval for that at its end: smooth, it is 1.5."""
    causal, smooth = normalised("corners", 10.0)
    assert causal[:, 5:].mean() < 1.5
    assert 0.8 < smooth[:, 5:].mean() < 1.3


def test_what_nothing_explains_begins_anew_and_so_does_what_comes_after_a_gap():
    """Breaks if an estimate that is wrong makes those after it wrong, or an acceleration lasts as
    long as nothing is seen."""
    times = 0.1 * np.arange(20)
    velocities = np.array([[12.0, 1.2 * (time > 1.85), 0.1] for time in times])
    found = filtered(times, [given(each) for each in velocities])[-1]
    assert found.predicted is None
    assert_allclose(found.whole.mean, [*velocities[-1], 0.0, 0.0, 0.0])
    assert predict(found, 3.5) is not None
    assert predict(found, 4.5) is None


def test_estimates_far_more_precise_than_the_acceleration_are_survived():
    """Breaks if rounding makes a covariance indefinite, so that a track with standard deviations of
    micrometres is refused."""
    rng, noise = np.random.default_rng(0), np.diag(np.square([1e-6, 1e-2, 1e-3]))
    times = np.cumsum(rng.uniform(0.5, 1.5, 12))
    inputs = [given(np.array([5.0 + time, 0.0, 0.1]), 0.0 * SLOW, 0.0, noise) for time in times]
    beliefs = filtered(times, inputs)
    for each in (*beliefs, *filtering.smooth_twice(beliefs)):
        assert np.linalg.eigvalsh(each.whole.covariance)[0] > 0.0


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize(
    ("rates", "offsets", "jitter", "options"),
    [
        ([1.0], [0.0], 0.0, {}),
        ([4.0], [0.0], 0.2, {}),
        ([25.0], [0.0], 0.0, {}),
        ([13.0] * 3, [0.01, 0.03, 0.06], 0.2, {}),
        ([20.0, 4.0], [0.01, 0.03], 0.0, {}),
        ([1.0, 1.0], [0.0, 0.3], 0.0, {}),
        ([10.0] * 3, [0.01, 0.03, 0.06], 0.0, {"baseline": 1}),
        ([10.0] * 3, [0.01, 0.03, 0.06], 0.0, {"baseline": 4}),
        ([10.0] * 3, [0.01, 0.03, 0.06], 0.0, {"horizon": 0.45}),
    ],
)
def test_a_constant_acceleration_makes_no_error(rates, offsets, jitter, options, smooth):
    """Breaks if an estimate lags behind, whatever the rates of the radars and the pairs."""
    mountings = AROUND[: len(rates)]
    for steady in ([2.0, 0.0, 0.0], [-2.0, 0.0, 0.04]):
        end = 5.0 if rates[0] == 1.0 else 2.0
        sensors, truth = accelerating(rates, offsets, np.array(steady), mountings, jitter, end=end)
        found = track(sensors, **options, smooth=smooth)
        good = found.converged
        assert good.mean() > 0.9 or rates == [1.0]
        sigmas = np.sqrt(np.diagonal(found.covariance[good], axis1=1, axis2=2))
        errors = np.abs(found.theta - truth(found.times))[good] / sigmas
        # a target that moves into another's place in the mixture makes a small error of its own
        assert np.median(errors, axis=0).max() < 0.2
        assert np.quantile(errors, 0.9) < 0.3
