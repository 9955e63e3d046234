"""A yaw-rate gyro and a radar in one Kalman filter: the effect of the radar's covariance."""

from collections.abc import Iterable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray

from d2d._types import Array
from d2d.radar import (
    FilterInput,
    Sensor,
    SensorErrors,
    Track,
    Tracker,
    VelocityEstimate,
    simulate_drive,
    track,
)
from d2d.radar.simulation.drive import CAR_MOUNTING, CAR_SPEED
from d2d.scores import normalised_squares
from d2d.study.drives.budget_trial import INGREDIENTS, drawn_errors, with_known_errors

FILTERS = ("inverse Hessian", "budget as white noise", "budget, slow errors as states")
SEED, DRIVES, DURATION = 29, 12, 20.0  # s: half a lap of the car
# Of the NIS and NEES: of credible ones, 99.9 % and 95 % lie below.
GATE = float(scipy.special.chdtri(3, 0.001))
REGION = float(scipy.special.chdtri(3, 0.05))
SETTLED = 2.0  # s, after which a filter is judged

_W = 2  # place of the yaw rate in the state
GYRO_NOISE, GYRO_BIAS = (float(x) for x in np.deg2rad([0.1, 1.0]))  # rad/s, standard deviations


class Motion(NamedTuple):
    """How a vehicle's accelerations change: first-order Gauss-Markov processes.

    Along x and y in m/s^2 and about z in rad/s^2, each with a standard deviation and a time
    constant in s.
    """

    sigma: Array  # (3,)
    constant: Array  # (3,)

    def over(self, interval: float) -> tuple[Array, Array]:
        """Transition and process noise (6, 6) of velocity and acceleration over a time in s."""
        passed = interval / self.constant
        kept = np.exp(-passed)
        step = np.eye(6)
        step[:3, 3:] = np.diag(self.constant * (1.0 - kept))
        step[3:, 3:] = np.diag(kept)
        moved = self.constant**2 * (2.0 * passed - 4.0 * (1.0 - kept) + 1.0 - kept**2)
        both = np.diag(self.sigma**2 * self.constant * (1.0 - kept) ** 2)
        acceleration = np.diag(self.sigma**2 * (1.0 - kept**2))
        return step, np.block([[np.diag(self.sigma**2 * moved), both], [both, acceleration]])


# Of the simulated car over a lap, forward and about z: standard deviation, and the time after which
# the correlation is 1/e.  It does not slide; the filter allows for a little.
SIMULATED = Motion(np.array([2.6, 0.1, 0.34]), np.array([0.65, 0.65, 0.65]))
_START = 1.0, 0.1, 0.5  # m/s, m/s, rad/s, standard deviations of the first velocity


class Filter:
    """A Kalman filter of a vehicle's velocity (3,), its acceleration (3,) and further errors (m,).

    It begins straight ahead with a ``speed`` in m/s.  The errors are in units of their standard
    deviations; they are constant, or decay with the time constant ``persistence`` in s and are
    renewed as fast.
    """

    def __init__(
        self, speed: float, motion: Motion, errors: int, persistence: float = np.inf
    ) -> None:
        self._motion, self._persistence = motion, persistence
        self.state = np.array([speed, *np.zeros(5 + errors)])
        self.covariance = np.diag(np.square([*_START, *motion.sigma, *np.ones(errors)]))

    def predict(self, interval: float) -> None:
        """Go on by a time in s."""
        kept = np.exp(-interval / self._persistence)
        step, added = kept * np.eye(len(self.state)), (1.0 - kept**2) * np.eye(len(self.state))
        step[:6, :6], added[:6, :6] = self._motion.over(interval)
        self.state, self.covariance = step @ self.state, step @ self.covariance @ step.T + added

    def update(
        self, innovation: Array, jacobian: Array, noise: Array, gate: float = np.inf
    ) -> float:
        """Take a measurement unless its NIS, which is returned, exceeds the gate.

        ``jacobian`` holds its derivatives in the state; those beyond its columns are zero.
        """
        jacobian = np.pad(jacobian, [(0, 0), (0, len(self.state) - jacobian.shape[1])])
        expected = jacobian @ self.covariance @ jacobian.T + noise
        nis = float(innovation @ np.linalg.solve(expected, innovation))
        if nis < gate:
            gain = np.linalg.solve(expected, jacobian @ self.covariance).T
            reduced = np.eye(len(self.state)) - gain @ jacobian
            self.state = self.state + gain @ innovation
            self.covariance = reduced @ self.covariance @ reduced.T + gain @ noise @ gain.T
        return nis


class Measured(NamedTuple):
    """The input of a filter at the n times of a drive, and the truth."""

    gyro: Array  # (n,) rad/s
    radar: Track
    estimates: Sequence[VelocityEstimate]  # n, the rows of the track
    inverse_hessian: Array  # (n, 3, 3)
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


def fusion_trial(drives: Sequence[Measured]) -> pd.DataFrame:
    """Filter all drives with each of `FILTERS`; a row for each, of what follows `SETTLED` seconds.

    ``nis`` and ``nees`` are means per dimension, 1 for a credible filter; ``rejected`` is the share
    beyond the gate and ``inside`` the share in the 95 % region.  The RMSE are in m/s, m/s, °/s.
    """
    rows = {}
    for name in FILTERS:
        fused = [fuse(measured, name) for measured in drives]
        late = np.concatenate([result.times > SETTLED for result in fused])
        nis, used, errors, nees = (
            np.concatenate([getattr(result, field) for result in fused])[late]
            for field in ("nis", "used", "errors", "nees")
        )
        known = np.isfinite(nis)
        rmse = np.sqrt(np.mean(errors[:, :3] ** 2, axis=0)) * [1.0, 1.0, np.rad2deg(1.0)]
        shares = np.mean(~used[known]), nees.mean() / 3.0, np.mean(nees < REGION)
        rows[name] = (nis[known].mean() / 3.0, *shares, *rmse)
    columns = ["nis", "rejected", "nees", "inside", "v_x", "v_y", "omega"]
    return pd.DataFrame.from_dict(rows, orient="index", columns=columns)


@cache
def measured_drives() -> list[Measured]:
    """Drives of the car with all that can be wrong, and a gyro with a constant bias in each."""
    rng = np.random.default_rng(SEED)
    wrong = INGREDIENTS["all"]
    return [_measured(rng, errors) for errors in drawn_errors(rng, wrong, DRIVES)]


def _measured(rng: np.random.Generator, errors: SensorErrors) -> Measured:
    wrong = INGREDIENTS["all"]
    drive = simulate_drive(
        rng, DURATION, CAR_SPEED, mounting=CAR_MOUNTING, sensor=Sensor(), errors=errors
    )
    scans = [with_known_errors(scan, wrong) for scan in drive.scans]
    start = drive.truth.theta[0]
    plain = track((scans, CAR_MOUNTING), baseline=1, carry=False, initial=start, limits=None)
    tracker = Tracker(
        {"radar": CAR_MOUNTING}, baseline=1, initial=start, budget=wrong.budget, limits=None
    )
    estimates = [estimate for scan in scans for estimate in tracker.add("radar", scan)]
    truth = drive.truth.theta[1:]
    bias = GYRO_BIAS * float(rng.standard_normal())
    gyro = truth[:, 2] + bias + GYRO_NOISE * rng.standard_normal(len(truth))
    return Measured(gyro, tracker.track, estimates, plain.covariance, truth, bias)


def fuse(measured: Measured, name: str) -> Fused:
    """Filter the gyro's yaw rates and the radar's velocities.

    The filter's errors are, with the third of `FILTERS`, the slow ones of the radar, and always, as
    the last, the gyro's bias.  A velocity of the radar whose NIS exceeds `GATE` is not used.
    """
    parts = measured.radar.parts
    assert parts is not None
    stated = {FILTERS[0]: measured.inverse_hessian, FILTERS[1]: parts.total}.get(name)
    slow = 0 if stated is not None else slow_errors(measured.estimates)
    filtered = Filter(float(measured.radar.theta[0, 0]), SIMULATED, slow + 1)
    gyro_jacobian = np.eye(7 + slow)[[_W]] + GYRO_BIAS * np.eye(7 + slow)[[-1]]
    output = np.eye(7 + slow)[[0, 1, 2, -1]] * [[1.0], [1.0], [1.0], [GYRO_BIAS]]
    results = []
    for i, estimate in enumerate(measured.estimates):
        filtered.predict(estimate.interval)
        innovation = measured.gyro[i] - gyro_jacobian @ filtered.state
        filtered.update(innovation, gyro_jacobian, np.array([[GYRO_NOISE**2]]))
        nis = np.nan
        if stated is not None and estimate.converged:
            off = estimate.theta - filtered.state[:3]
            nis = filtered.update(off, np.eye(3), stated[i], GATE)
        elif estimate.filter_input is not None:
            nis = take(filtered, estimate.filter_input, GATE)
        results.append(
            (nis, nis < GATE, output @ filtered.state, output @ filtered.covariance @ output.T)
        )
    squares, used, states, covariances = (np.array(column) for column in zip(*results, strict=True))
    true = np.column_stack([measured.truth, np.full(len(squares), measured.bias)])
    return Fused(measured.radar.times, squares, used, states - true, covariances)


def take(filtered: Filter, radar: FilterInput, gate: float = np.inf) -> float:
    """Give an estimate of a radar to a filter with its slow errors; returns the NIS."""
    slow = filtered.state[6 : 6 + radar.slow.shape[1] + 1]
    expected, jacobian = radar.expected(filtered.state[:3], filtered.state[3:6], slow)
    return filtered.update(radar.velocity - expected, jacobian, radar.white, gate)


def slow_errors(estimates: Iterable[VelocityEstimate]) -> int:
    """How many slow errors the estimates have, the lag among them."""
    inputs = (item.filter_input for item in estimates)
    return next(len(item.slow.T) + 1 for item in inputs if item is not None)
