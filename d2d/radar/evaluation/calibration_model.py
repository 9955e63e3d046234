"""The clock, speed, slip and mounting angles with which a reference fits Doppler velocities best.

The Doppler velocities of a scan's static targets depend on the velocity u of their sensor alone.
The sum of their squared residuals is a quadratic function of u, whose coefficients are all that a
fit needs to know of a scan.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from d2d._types import Array
from d2d.radar.evaluation.sandwich import covariance_of_sum
from d2d.radar.motion.doppler import doppler_ego_motion
from d2d.radar.scans.reference import Reference
from d2d.radar.scans.scan import Mounting, RadarScan, doppler_gradients, level

_STEP = 0.02  # s, of the search for the lag before it is refined
_HALF_DIFFERENCE = 0.05  # s, for derivatives in the lag: references jitter from row to row
_MAX_ITERATIONS = 10  # Gauss-Newton steps; the angles are small, so that three are enough
_TOLERANCE = 1e-10
_RIDGE = 1e-12  # of the scaled information: what is not observable gets a variance of 1e12
_GATE = 5.0  # times the median deviation of a sensor's scans


class ScanVelocities(NamedTuple):
    """Velocities of the sensors at n scans, by their static targets.

    If the sensor moves with u (m/s, along the vehicle's axes) and is mounted as stated, the squares
    of the scan's Doppler residuals over their standard deviations add up to
    square - 2 projection' u + u' information u.
    """

    sensor: NDArray[np.int64]  # (n,)
    place: Array  # (n, 2), m, of the sensor
    time: Array  # (n,), s
    information: Array  # (n, 2, 2)
    projection: Array  # (n, 2)
    square: Array  # (n,)
    targets: NDArray[np.int64]  # (n,), number of static ones

    @property
    def sensors(self) -> int:
        """Number of sensors."""
        return int(self.sensor.max()) + 1


def scan_velocities(views: Iterable[tuple[Iterable[RadarScan], Mounting]]) -> ScanVelocities:
    """The static targets of every scan that has targets, from its own Doppler velocities alone."""
    rows = [
        (s, (mounting.x, mounting.y), scan.time, *_quadratic(*level(scan, mounting)))
        for s, (scans, mounting) in enumerate(views)
        for scan in scans
        if scan.size
    ]
    return ScanVelocities(*(np.array(column) for column in zip(*rows, strict=True)))


def _quadratic(scan: RadarScan, mounting: Mounting) -> tuple[Array, Array, float, int]:
    """Coefficients of the sum of squares of a scan's static targets, and their number."""
    motion = doppler_ego_motion([(scan, mounting)])
    static = motion.inliers[0]
    gain, slope = doppler_gradients(scan.azimuth[static], mounting)
    sigma = np.hypot(
        scan.sigma_doppler[static], scan.sigma_azimuth[static] * (slope @ motion.theta)
    )
    direction = gain[:, :2] / sigma[:, None]
    doppler = scan.doppler[static] / sigma
    return direction.T @ direction, direction.T @ doppler, float(doppler @ doppler), len(sigma)


@dataclass(frozen=True, eq=False)
class CalibrationModel:
    """A model of sensors that move as a corrected reference says.

    The parameters are [lag, speed, coefficients c_j, yaw of each sensor, bias]: at a time t, the
    vehicle moves with v_x (1 + speed) and v_y = sum_j c_j v_x^(p_j) omega, where v_x is that of the
    reference at t - lag and omega its yaw rate there less the bias (rad/s), and each yaw (rad) is
    added to the angle of a mounting.
    """

    velocities: ScanVelocities
    references: Sequence[Reference]  # one for each sensor; its v_y is not used
    powers: tuple[int, ...]  # the p_j
    start: Array  # (P,), the parameters to begin with
    free: NDArray[np.bool_]  # (P,), which of them are fitted
    used: NDArray[np.bool_]  # (n,), which scans count

    @classmethod
    def of(
        cls, velocities: ScanVelocities, references: Sequence[Reference], powers: tuple[int, ...]
    ) -> "CalibrationModel":
        """The model of all scans with all parameters free, started at zero."""
        count = 3 + len(powers) + velocities.sensors
        scans = np.ones(len(velocities.time), dtype=np.bool_)
        return cls(velocities, references, powers, np.zeros(count), np.ones(count, np.bool_), scans)

    def predicted(self, parameters: Array) -> tuple[Array, Array]:
        """Velocities (n, 2) that sensors measure if mounted as stated; derivatives (n, 2, P).

        Nan where unknown.  The derivatives in the lag are left at zero.
        """
        sensor, place, time, *_ = self.velocities
        v, omega = np.full((2, len(time)), np.nan)
        for s, reference in enumerate(self.references):
            own = sensor == s
            for row, column in ((v, 0), (omega, 2)):
                known = reference.times, reference.theta[:, column]
                row[own] = np.interp(time[own] - parameters[0], *known, left=np.nan, right=np.nan)
        omega -= parameters[-1]
        powers = np.array([v**power for power in self.powers])
        of_yaw = 2 + len(self.powers) + sensor
        ahead = place[:, 0] + parameters[2 : 2 + len(powers)] @ powers
        velocity = np.stack([v * (1.0 + parameters[1]) - omega * place[:, 1], omega * ahead])
        # the vehicle's axes, as such a sensor sees them
        cosine, sine = np.cos(parameters[of_yaw]), np.sin(parameters[of_yaw])
        forward, left = np.stack([cosine, -sine], axis=-1), np.stack([sine, cosine], axis=-1)
        predicted = forward * velocity[0, :, None] + left * velocity[1, :, None]
        derivatives = np.zeros((*predicted.shape, len(parameters)))
        derivatives[..., 1] = forward * v[:, None]
        derivatives[..., 2 : 2 + len(powers)] = left[..., None] * (powers * omega).T[:, None]
        derivatives[..., -1] = forward * place[:, 1:] - left * ahead[:, None]
        turned = np.stack([predicted[:, 1], -predicted[:, 0]], axis=-1)
        derivatives[np.arange(len(v)), :, of_yaw] = turned
        return predicted, derivatives

    def gradients(self, predicted: Array) -> Array:
        """Derivatives (n, 2) of each scan's log-likelihood in its velocity (n, 2)."""
        data = self.velocities
        return np.asarray(data.projection - np.einsum("kij,kj->ki", data.information, predicted))


class Fit(NamedTuple):
    """The parameters that fit best, at a given lag or at the best one."""

    parameters: Array  # (P,), see `CalibrationModel`
    mean_square: float  # of the static targets' residuals over their standard deviations
    known: NDArray[np.bool_]  # (n,): scans that count and have a reference

    @property
    def lag(self) -> float:
        """The first of the parameters, in s."""
        return float(self.parameters[0])


def fit_at(model: CalibrationModel, lag: float) -> Fit:
    """The best other parameters at one lag, by Gauss-Newton steps."""
    parameters, free = model.start.copy(), model.free.copy()
    parameters[0], free[0] = lag, False
    for _ in range(_MAX_ITERATIONS):
        predicted, derivatives, _ = _where_known(model, parameters)
        scores, information = _normal_equations(model, predicted, derivatives[..., free])
        scale = _scale(information)
        relative = information / np.outer(scale, scale)
        step = np.linalg.lstsq(relative, scores.sum(axis=0) / scale, rcond=_RIDGE)[0] / scale
        parameters[free] += step
        if np.abs(step).max() < _TOLERANCE:
            break
    predicted, _, known = _where_known(model, parameters)
    # square - 2 projection' u + u' information u
    both = model.velocities.projection + model.gradients(predicted)
    squares = (model.velocities.square - np.einsum("ki,ki->k", predicted, both))[known]
    count = model.velocities.targets[known].sum()
    return Fit(parameters, float(squares.sum() / count), known)


def fit(model: CalibrationModel, low: float, high: float) -> Fit:
    """The best parameters at the best lag from ``low`` to ``high`` (s), the bounds included.

    A lag that is not free stays at its start.
    """
    if not model.free[0]:
        return fit_at(model, float(model.start[0]))
    grid = np.linspace(low, high, max(2, round((high - low) / _STEP)) + 1)
    coarse = [fit_at(model, float(lag)) for lag in grid]
    best = int(np.argmin([found.mean_square for found in coarse]))
    refined = scipy.optimize.minimize_scalar(
        lambda lag: fit_at(model, lag).mean_square,
        bounds=(grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]),
        method="bounded",
        options={"xatol": 1e-5},
    )
    return min(fit_at(model, float(refined.x)), coarse[best], key=lambda found: found.mean_square)


def agreeing(model: CalibrationModel, found: Fit) -> NDArray[np.bool_]:
    """Mask (n,) of scans whose residual passes the gate, see `calibrate`.

    They are compared with the median of their sensor, because errors of the reference add to all.
    """
    residual = model.gradients(model.predicted(found.parameters)[0])
    inverse = np.linalg.pinv(model.velocities.information, rcond=1e-9, hermitian=True)
    deviation = np.sqrt(np.einsum("ki,kij,kj->k", residual, inverse, residual))
    agree = np.zeros(len(deviation), dtype=np.bool_)
    for s in range(model.velocities.sensors):
        own = (model.velocities.sensor == s) & np.isfinite(deviation)
        agree[own] = deviation[own] <= _GATE * np.median(deviation[own]) if own.any() else False
    return agree


def covariance(model: CalibrationModel, found: Fit) -> tuple[Array, float]:
    """Covariance (P, P) of the parameters, and the length of its blocks in s.

    It is nan for parameters that are not free, and never less than for independent targets.
    `calibrate` says why the scans' influences depend on each other.
    """
    predicted, derivatives, known = _where_known(model, found.parameters)
    shift = np.zeros(len(found.parameters))
    shift[0] = _HALF_DIFFERENCE
    later, earlier = (model.predicted(found.parameters + by)[0] for by in (shift, -shift))
    slope = np.nan_to_num((later - earlier) / (2.0 * _HALF_DIFFERENCE))
    derivatives[known, :, 0] = slope[known]
    scores, information = _normal_equations(model, predicted, derivatives[..., model.free])
    scale = _scale(information)
    ridge = _RIDGE * np.eye(len(scale))
    inverse = np.linalg.inv(information / np.outer(scale, scale) + ridge) / np.outer(scale, scale)
    series, interval = _in_time(model.velocities, known, scores[known] @ inverse)
    of_each_sensor = len(scale) - (model.velocities.sensors - 1)
    sandwich, block = covariance_of_sum(series, parameters=of_each_sensor)
    least = found.mean_square * np.diag(inverse)
    placed = np.full((len(model.free), len(model.free)), np.nan)
    added = np.diag(np.maximum(least - np.diag(sandwich), 0.0))
    placed[np.ix_(model.free, model.free)] = sandwich + added
    return placed, block * interval


def _where_known(
    model: CalibrationModel, parameters: Array
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Predictions and derivatives, zero for scans that do not count or have no reference."""
    predicted, derivatives = model.predicted(parameters)
    known = model.used & np.isfinite(predicted).all(axis=1)
    if not known.any():
        raise ValueError(
            "the references of recordings must cover the times of the scans, but cover none at a "
            f"lag of {parameters[0]:+.3f} s; is max_lag longer than the drive?"
        )
    predicted[~known], derivatives[~known] = 0.0, 0.0
    return predicted, derivatives, known


def _normal_equations(
    model: CalibrationModel, predicted: Array, derivatives: Array
) -> tuple[Array, Array]:
    """The scores (n, P) of each scan, and the information (P, P) of all."""
    scores = np.einsum("kia,ki->ka", derivatives, model.gradients(predicted))
    weighted = np.einsum("kij,kja->kia", model.velocities.information, derivatives)
    return scores, np.tensordot(derivatives, weighted, axes=([0, 1], [0, 1]))


def _scale(information: Array) -> Array:
    """Column scales: square roots of the diagonal, 1 for empty columns."""
    scale = np.sqrt(np.diag(information))
    return np.where(scale > 0.0, scale, 1.0)


def _in_time(
    data: ScanVelocities, known: NDArray[np.bool_], influences: Array
) -> tuple[Array, float]:
    """Sums of the influences over successive intervals, and the length of an interval in s.

    It is the usual time between two scans of a sensor.
    """
    times, sensor = data.time[known], data.sensor[known]
    gaps = [np.diff(np.sort(times[sensor == s])) for s in range(data.sensors)]
    interval = float(np.median(np.concatenate(gaps)))
    _, row = np.unique(np.floor((times - times.min()) / interval), return_inverse=True)
    series = np.zeros((row.max() + 1, influences.shape[1]))
    np.add.at(series, row, influences)
    return series, interval
