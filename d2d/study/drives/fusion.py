"""A yaw-rate gyro and a radar in one Kalman filter: the effect of the radar's covariance."""

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from d2d._types import Array
from d2d.radar import (
    EgoMotionModel,
    ErrorBudget,
    Mounting,
    RadarScan,
    Sensor,
    SensorErrors,
    Track,
    estimate_ego_motion,
    simulate_drive,
    track,
)
from d2d.radar.motion.covariance import influences
from d2d.radar.motion.doppler import Acceleration
from d2d.radar.motion.pairs import ScanPair, scan_pair
from d2d.radar.simulation.drive import CAR_MOUNTING, CAR_SPEED
from d2d.radar.tracks.acceleration import UNKNOWN, AccelerationFilter
from d2d.scores import normalised_squares
from d2d.study.drives.budget_trial import INGREDIENTS, drawn_errors, with_known_errors

FILTERS = ("inverse Hessian", "budget as white noise", "budget, slow errors as states")
SEED, DRIVES, DURATION = 29, 12, 20.0  # s: half a lap of the car
# Of the NIS and NEES: of credible ones, 99.9 % and 95 % lie below.
GATE = float(scipy.special.chdtri(3, 0.001))
REGION = float(scipy.special.chdtri(3, 0.05))
SETTLED = 2.0  # s, after which a filter is judged

GYRO_NOISE, GYRO_BIAS = (float(x) for x in np.deg2rad([0.1, 1.0]))  # rad/s, standard deviations
# The filter's model of the vehicle: first-order Gauss-Markov processes of its acceleration
# and its side slip, each with a standard deviation and a time constant, and steps of the yaw rate.
_ACCELERATION, _SLIP = (2.0, 0.5), (0.1, 1.0)  # m/s^2 and s, m/s and s
_YAW_STEP = 0.03  # rad/s from one scan to the next
_W, _BIAS, _A, _SLOW = 2, 3, 4, 5  # places in the state; v_x and v_y come first, slow errors last


class Measured(NamedTuple):
    """The input of a filter at the n times of a drive, and the truth."""

    gyro: Array  # (n,) rad/s
    radar: Track
    inverse_hessian: Array  # (n, 3, 3)
    # (n, 3, 4), changes of the radar's velocity by an azimuth error, a Doppler error, a scale error
    # and a lag, each of one standard deviation of the budget
    slow: Array
    truth: Array  # (n, 3) m/s, m/s, rad/s
    bias: float  # rad/s, of the gyro


class Fused(NamedTuple):
    """The output of a filter for a drive."""

    times: Array
    nis: Array  # (n,) of the radar's innovations, nan without an estimate of the radar
    used: NDArray[np.bool_]  # (n,), which passed the gate
    errors: Array  # (n, 4) of [v_x, v_y, omega, gyro bias]
    covariances: Array  # (n, 4, 4), as stated by the filter

    @property
    def nees(self) -> Array:
        """Normalised squares (n,) of the errors of the velocity."""
        return normalised_squares(self.errors[:, :3], self.covariances[:, :3, :3])


class FusionTrial(NamedTuple):
    """The verdicts on each of `FILTERS`, over all drives after `SETTLED` seconds.

    Credible filters have the means 1 and the shares 0.95.
    """

    nis: Array  # (3,) mean per dimension
    rejected: Array  # (3,) share beyond the gate
    nees: Array  # (3,) mean per dimension, of the filtered velocity
    nees_within: Array  # (3,) share in the 95 % region
    rmse: Array  # (3, 4) of v_x, v_y, omega and the gyro's bias in m/s, m/s, °/s, °/s


def fusion_trial(drives: Sequence[Measured]) -> FusionTrial:
    """Filter all drives with each of `FILTERS`."""
    columns = []
    for name in FILTERS:
        fused = [fuse(measured, name) for measured in drives]
        late = np.concatenate([each.times > SETTLED for each in fused])
        nis, used, errors, nees = (
            np.concatenate([getattr(each, field) for each in fused])[late]
            for field in ("nis", "used", "errors", "nees")
        )
        known = np.isfinite(nis)
        columns.append(
            (
                nis[known].mean() / 3.0,
                np.mean(~used[known]),
                nees.mean() / 3.0,
                np.mean(nees < REGION),
                np.sqrt(np.mean(errors**2, axis=0)) * [1.0, 1.0, *np.rad2deg([1.0, 1.0])],
            )
        )
    return FusionTrial(*(np.array(column) for column in zip(*columns, strict=True)))


@cache
def measured_drives(
    drives: int = DRIVES, duration: float = DURATION, seed: int = SEED
) -> list[Measured]:
    """Drives of the car with all that can be wrong, and a gyro with a constant bias in each."""
    rng = np.random.default_rng(seed)
    wrong = INGREDIENTS["all"]
    return [_measured(rng, duration, errors) for errors in drawn_errors(rng, wrong, drives)]


def _measured(rng: np.random.Generator, duration: float, errors: SensorErrors) -> Measured:
    wrong = INGREDIENTS["all"]
    drive = simulate_drive(
        rng, duration, CAR_SPEED, mounting=CAR_MOUNTING, sensor=Sensor(), errors=errors
    )
    scans = [with_known_errors(scan, wrong) for scan in drive.scans]
    plain, full = (
        track((scans, CAR_MOUNTING), initial=drive.truth.theta[0], budget=budget, limits=None)
        for budget in (None, wrong.budget)
    )
    truth = drive.truth.theta[1:]
    bias = GYRO_BIAS * float(rng.standard_normal())
    gyro = truth[:, 2] + bias + GYRO_NOISE * rng.standard_normal(len(truth))
    slow = slow_errors(scans, CAR_MOUNTING, full, wrong.budget)
    return Measured(gyro, full, plain.covariance, slow, truth, bias)


def slow_errors(
    scans: Sequence[RadarScan], mounting: Mounting, driven: Track, budget: ErrorBudget
) -> Array:
    """The effect (n, 3, 4) of each error of a budget on the velocities of a track of one sensor.

    The products of these columns with themselves add up to the track's systematic covariances.
    Unlike those, the columns also show that the error of one interval is that of the next.  They
    are nan where the track has no estimate.
    """
    model = EgoMotionModel()
    columns = np.full((len(driven.times), 3, 4), np.nan)
    parts, acceleration = driven.parts, AccelerationFilter()
    assert parts is not None
    for i in np.flatnonzero(driven.converged).tolist():
        pair = ScanPair(scans[i], scans[i + 1], mounting)
        estimate = estimate_ego_motion(*pair, initial=driven.theta[i])
        problem = model.problem([scan_pair(*pair, model)])
        before, after = influences(problem, estimate, [pair])
        columns[i, :, 0] = before.azimuth.sum(axis=0) + after.azimuth.sum(axis=0)
        columns[i, :, 1] = after.doppler.sum(axis=0)
        columns[i, :, 2] = scans[i + 1].doppler @ after.doppler
        time, noise = float(driven.times[i]), parts.noise[i] + parts.dependence[i]
        known = acceleration.predict(time)
        by = Acceleration(np.zeros(3), UNKNOWN) if known is None else known
        acceleration.update(time, driven.theta[i], np.zeros((3, 3)), noise, by)
        columns[i, :, 3] = -by.value
    return columns * [budget.azimuth, budget.doppler, budget.scale, budget.lag]


def fuse(measured: Measured, name: str, gate: float = GATE) -> Fused:
    """Filter the gyro's yaw rates and the radar's velocities.

    The state is [v_x, v_y, omega], the gyro's bias and the acceleration; with the third of
    `FILTERS` also the slow errors, each in its standard deviation.  A velocity of the radar whose
    NIS exceeds the gate is not used.
    """
    parts = measured.radar.parts
    assert parts is not None
    noise, slow = {
        FILTERS[0]: (measured.inverse_hessian, measured.slow[..., :0]),
        FILTERS[1]: (parts.total, measured.slow[..., :0]),
        FILTERS[2]: (parts.noise + parts.dependence, measured.slow),
    }[name]
    size = _SLOW + slow.shape[-1]
    state, covariance = np.zeros(size), np.eye(size)
    state[0] = measured.radar.theta[0, 0]
    covariance[range(5), range(5)] = np.square([1.0, _SLIP[0], 0.5, GYRO_BIAS, _ACCELERATION[0]])
    to_gyro = np.eye(size)[[_W]] + np.eye(size)[[_BIAS]]
    results = []
    for i, interval in enumerate(measured.radar.intervals):
        step, added = _motion(size, float(interval))
        state, covariance = step @ state, step @ covariance @ step.T + added
        state, covariance, _ = _updated(
            state, covariance, measured.gyro[i : i + 1], to_gyro, np.array([[GYRO_NOISE**2]])
        )
        nis = np.nan
        if measured.radar.converged[i]:
            to_radar = np.hstack([np.eye(3), np.zeros((3, 2)), slow[i]])
            *after, nis = _updated(state, covariance, measured.radar.theta[i], to_radar, noise[i])
            if nis < gate:
                state, covariance = after
        results.append((nis, nis < gate, state[:4], covariance[:4, :4]))
    squares, used, states, covariances = (np.array(each) for each in zip(*results, strict=True))
    true = np.column_stack([measured.truth, np.full(len(squares), measured.bias)])
    return Fused(measured.radar.times, squares, used, states - true, covariances)


def _motion(size: int, interval: float) -> tuple[Array, Array]:
    """The transition of the state over an interval, and the covariance of the process noise."""
    step, added = np.eye(size), np.zeros((size, size))
    step[0, _A] = interval
    for place, (sigma, constant) in ((_A, _ACCELERATION), (1, _SLIP)):
        step[place, place] = np.exp(-interval / constant)
        added[place, place] = sigma**2 * (1.0 - step[place, place] ** 2)
    added[_W, _W] = _YAW_STEP**2
    return step, added


def _updated(
    state: Array, covariance: Array, value: Array, to: Array, noise: Array
) -> tuple[Array, Array, float]:
    """State and covariance after a measurement, and the NIS of its innovation."""
    innovation, expected = value - to @ state, to @ covariance @ to.T + noise
    gain = np.linalg.solve(expected, to @ covariance).T
    kept = np.eye(len(state)) - gain @ to
    return (
        state + gain @ innovation,
        kept @ covariance @ kept.T + gain @ noise @ gain.T,
        float(innovation @ np.linalg.solve(expected, innovation)),
    )
