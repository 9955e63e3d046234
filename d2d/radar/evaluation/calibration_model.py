"""Clock, speed, slip and mountings with which a reference fits Doppler velocities best."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from d2d._types import Array
from d2d.bootstrap import covariance_of_sum
from d2d.radar.motion.doppler import doppler_ego_motion
from d2d.radar.scans.reference import Reference
from d2d.radar.scans.scan import Mounting, RadarScan, doppler_gradients, level

_STEP = 0.02  # s, of the search for the lag before it is refined
_LATER = 0.05  # s, for derivatives in the lag: references jitter from row to row
_MAX_ITERATIONS = 10  # Gauss-Newton steps; the angles are small, so that three are enough
_TOLERANCE = 1e-10
_RIDGE = 1e-10  # of the scaled information: what is not observable gets a variance of 1e10
_GATE = 5.0  # times the median deviation of a sensor's scans


class ScanVelocities(NamedTuple):
    """Velocities of the sensors at n scans, by their static targets.

    If a sensor moves with u (m/s, along the vehicle's axes), the squares of its Doppler residuals
    over their standard deviations have the same sum as those of triangle [-u, 1].
    """

    sensor: NDArray[np.int64]  # (n,), in ascending order
    place: NDArray[np.complex128]  # (n,), x + iy of the sensor in m
    time: Array  # (n,), s
    triangle: Array  # (n, 3, 3), upper triangular
    targets: NDArray[np.int64]  # (n,), number of static ones


def scan_velocities(views: Iterable[tuple[Iterable[RadarScan], Mounting]]) -> ScanVelocities:
    """The static targets of every scan that has targets, from its own Doppler velocities alone."""
    rows = [
        (s, complex(mounting.x, mounting.y), scan.time, *_triangle(*level(scan, mounting)))
        for s, (scans, mounting) in enumerate(views)
        for scan in scans
        if scan.size
    ]
    return ScanVelocities(*(np.array(column) for column in zip(*rows, strict=True)))


def _triangle(scan: RadarScan, mounting: Mounting) -> tuple[Array, int]:
    """The triangle (3, 3) of a scan's static targets, and their number."""
    motion = doppler_ego_motion([(scan, mounting)])
    gain, slope = doppler_gradients(scan.azimuth, mounting)
    sigma = np.hypot(scan.sigma_doppler, scan.sigma_azimuth * (slope @ motion.theta))
    rows = (np.column_stack([gain[:, :2], scan.doppler]) / sigma[:, None])[motion.inliers[0]]
    whole = np.concatenate([rows, np.zeros((3, 3))])
    return np.asarray(np.linalg.qr(whole, mode="r")), len(rows)


@dataclass(frozen=True, eq=False)
class CalibrationModel:
    """A model of sensors that move as a corrected reference says.

    The parameters are [lag, speed, coefficients cⱼ, yaw of each sensor, bias]: at a time t, the
    vehicle moves with v_x (1 + speed) and v_y = ∑ⱼ cⱼ v_x^(pⱼ) omega, where v_x is that of the
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
        count = 3 + len(powers) + len(references)
        scans = np.ones(len(velocities.time), dtype=np.bool_)
        return cls(velocities, references, powers, np.zeros(count), np.ones(count, np.bool_), scans)

    def motion(self, lag: float) -> Array:
        """The reference's v_x and yaw rate (2, n), a lag before the scans; nan if unknown."""
        parts = []
        for s, reference in enumerate(self.references):
            times = self.velocities.time[self.velocities.sensor == s] - lag
            columns = reference.theta[:, 0], reference.theta[:, 2]
            parts.append([np.interp(times, reference.times, c, np.nan, np.nan) for c in columns])
        return np.concatenate(parts, axis=1)

    def residuals(self, parameters: Array, motion: Array) -> tuple[Array, Array]:
        """Residuals (3, n) over sigma in a `motion`, and slopes (3, P, n), zero for the lag."""
        (v, rate), (sensor, place, _, triangle, _) = motion, self.velocities
        slip, yaw = np.split(parameters[2:-1], [len(self.powers)])
        turn, omega = np.exp(-1.0j * yaw[sensor]), rate - parameters[-1]
        powers = np.array([v**power for power in self.powers])
        arm = 1.0j * (place + slip @ powers)
        velocity = turn * (v * (1.0 + parameters[1]) + omega * arm)  # x + iy, as the sensors see it
        of_yaw = -1.0j * velocity * (sensor == np.arange(len(yaw))[:, None])
        rows = [velocity, 0.0 * v, v * turn, *(1.0j * omega * turn * powers), *of_yaw, -arm * turn]
        parts = np.array(rows)
        along, across, measured = np.ascontiguousarray(triangle.T)  # (3, n) each
        found = -(along[:, None] * parts.real + across[:, None] * parts.imag)
        return found[:, 0] + measured, found[:, 1:]


class Fit(NamedTuple):
    """The parameters that fit best, at a given lag or at the best one."""

    parameters: Array  # (P,), see `CalibrationModel`
    mean_square: float  # of the static targets' residuals over their standard deviations
    known: NDArray[np.bool_]  # (n,): scans that count and have a reference


def fit_at(model: CalibrationModel, lag: float) -> Fit:
    """The best other parameters at one lag, by Gauss-Newton steps."""
    motion = model.motion(lag)
    known = model.used & np.isfinite(motion).all(axis=0)
    if not known.any():
        raise ValueError(
            "the references of recordings must cover the times of the scans, but cover none at a "
            f"lag of {lag:+.3f} s; is max_lag longer than the drive?"
        )
    seen: Any = (column[known] for column in model.velocities)
    model, motion = replace(model, velocities=ScanVelocities(*seen)), motion[:, known]
    parameters, free = model.start.copy(), model.free.copy()
    parameters[0], free[0] = lag, False
    for _ in range(_MAX_ITERATIONS):
        residuals, slopes = model.residuals(parameters, motion)
        rows = slopes[:, free].swapaxes(0, 1).reshape(free.sum(), -1)
        step = -_inverse_information(rows) @ (rows @ residuals.ravel())
        parameters[free] += step
        if np.abs(step).max() < _TOLERANCE:
            break
    mean = (residuals**2).sum() / model.velocities.targets.sum()
    return Fit(parameters, float(mean), known)


def fit(model: CalibrationModel, low: float, high: float) -> Fit:
    """The best parameters at the best lag from ``low`` to ``high`` (s), or at one that is held."""
    if not model.free[0]:
        return fit_at(model, float(model.start[0]))
    grid = np.linspace(low, high, max(2, round((high - low) / _STEP)) + 1)
    coarse = [fit_at(model, float(lag)) for lag in grid]
    best = int(np.argmin([found.mean_square for found in coarse]))
    model = replace(model, start=coarse[best].parameters)
    refined = scipy.optimize.minimize_scalar(
        lambda lag: fit_at(model, lag).mean_square,
        bounds=(grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]),
        method="bounded",
        options={"xatol": 1e-5},
    )
    return min(fit_at(model, float(refined.x)), coarse[best], key=lambda found: found.mean_square)


def agreeing(model: CalibrationModel, found: Fit) -> NDArray[np.bool_]:
    """Mask (n,) of scans that deviate by at most five times the median of their sensor."""
    residuals, _ = model.residuals(found.parameters, model.motion(found.parameters[0]))
    deviation = np.linalg.norm(residuals[:2], axis=0)
    agree = np.zeros(len(deviation), dtype=np.bool_)
    for s in range(len(model.references)):
        own = (model.velocities.sensor == s) & np.isfinite(deviation)
        agree[own] = deviation[own] <= _GATE * np.median(deviation[own]) if own.any() else False
    return agree


def covariance(model: CalibrationModel, found: Fit) -> tuple[Array, float]:
    """Covariance (P, P) of the parameters, nan if held, and the length of its blocks in s."""
    motions = [model.motion(found.parameters[0] + late) for late in (0.0, _LATER, -_LATER)]
    (residuals, slopes), (later, _), (earlier, _) = (
        model.residuals(found.parameters, each) for each in motions
    )
    slopes[:, 0] = np.nan_to_num((later - earlier) / (2.0 * _LATER))  # edges of a reference
    slopes = slopes[:, model.free][..., found.known].swapaxes(0, 1)
    inverse = _inverse_information(slopes.reshape(len(slopes), -1))
    influences = -np.einsum("aik,ik->ka", slopes, residuals[:, found.known]) @ inverse
    # sums over successive intervals, each as long as the usual one between scans of a sensor
    times, sensor = model.velocities.time[found.known], model.velocities.sensor[found.known]
    order = np.lexsort([times, sensor])
    interval = float(np.median(np.diff(times[order])[np.diff(sensor[order]) == 0]))
    _, row = np.unique(np.floor((times - times.min()) / interval), return_inverse=True)
    series = np.zeros((row.max() + 1, len(inverse)))
    np.add.at(series, row, influences)
    of_each_sensor = len(inverse) - (len(model.references) - 1)
    sandwich, block = covariance_of_sum(series, parameters=of_each_sensor)
    least = found.mean_square * np.diag(inverse)  # of independent targets
    placed = np.full((len(model.free), len(model.free)), np.nan)
    added = np.diag(np.maximum(least - np.diag(sandwich), 0.0))
    placed[np.ix_(model.free, model.free)] = sandwich + added
    return placed, block * interval


def _inverse_information(slopes: Array) -> Array:
    """The inverse (P, P) of the information of residuals with these slopes (P, m)."""
    scale = np.linalg.norm(slopes, axis=1)
    scale[scale == 0.0] = 1.0
    units = np.outer(scale, scale)
    ridge = _RIDGE * np.eye(len(scale))
    return np.asarray(np.linalg.inv(slopes @ slopes.T / units + ridge) / units)
