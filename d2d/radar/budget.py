"""Errors that the targets of a scan share, which their standard deviations do not contain."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from d2d import _kernel
from d2d._checks import check_angle, check_scalar
from d2d._types import Array
from d2d.problem import Problem
from d2d.radar.scan import directions
from d2d.radar.scan_pair import ScanPair
from d2d.registration import Estimate

# s to either side, over which an acceleration is fitted; a little more than half a second, so that
# the rounding of times does not decide which estimates of a radar with steps of 0.1 s count
_SLOPE_SPAN = 0.5 + 1e-6
_LARGEST = 1e3  # in any unit: beyond it a covariance holds nothing but the budget, or overflows
_LOWER = [1, 2, 2], [0, 0, 1]  # rows and columns below the diagonal of a matrix (3, 3)
_NOTHING = np.empty((0, 3))
_IDENTITY = np.eye(3)


@dataclass(frozen=True)
class ErrorBudget:
    """Standard deviations of the errors that many targets share.

    The inverse Hessian takes the errors of all targets as independent, so it becomes ever smaller
    with their number.  Errors that they share do not average out.  With a budget, the covariance of
    a track is the propagated noise of the single targets plus the effect of the shared errors,
    each of which acts through the sum of the influences of the targets that share it.

    With a budget, even an empty one, a track's estimates are the velocities at its times: positions
    give the mean velocity over their interval; when the vehicle accelerates, this lags by half an
    interval, which is corrected with the acceleration estimated from the track itself.

    Attributes
    ----------
    azimuth : float, rad
        Of an azimuth bias of each sensor, the error of its mounting angle included.
    doppler : float, m/s
        Of an error of all Doppler velocities of a sensor's scan: rounding that its static targets
        share, drift of the oscillator, multipath.
    scale : float
        Of a relative error of the Doppler velocities of all sensors, or of the speed of what they
        are compared with.
    lag : float, s
        Of the time to which an estimate belongs; its effect is the vehicle's acceleration times it.
    neighbours : float, m
        Length over which the position errors of neighbouring targets are correlated, as
        exp(-distance / length).  Reflections of one object shift together.
    source : str
        Where the numbers come from.

    Raises
    ------
    ValueError
        If a number is negative, nan or above 1000, or the azimuth's above 2 pi; the message names
        it.

    Examples
    --------
    >>> import numpy as np
    >>> from d2d.radar import ErrorBudget, simulate_drive, track
    >>> drive = simulate_drive(np.random.default_rng(0), duration=2.0)
    >>> budget = ErrorBudget(azimuth=np.deg2rad(0.1), doppler=0.02, source="data sheet")
    >>> driven = track(drive.scans, drive.mounting, budget=budget)
    >>> bool((driven.parts.total == driven.covariance).all())
    True
    """

    azimuth: float = 0.0
    doppler: float = 0.0
    scale: float = 0.0
    lag: float = 0.0
    neighbours: float = 0.0
    source: str = ""

    def __post_init__(self) -> None:
        for field in fields(self):
            if field.name == "source":
                continue
            value = check_scalar(field.name, getattr(self, field.name))
            if value < 0.0:
                raise ValueError(f"{field.name} must not be negative, but is {value:g}")
            if value > _LARGEST:
                raise ValueError(f"{field.name} must be at most {_LARGEST:g}, but is {value:g}")
            object.__setattr__(self, field.name, float(value))
        check_angle("azimuth", self.azimuth)
        if not isinstance(self.source, str):
            raise ValueError(f"source must be a str, but is a {type(self.source).__name__}")


class CovarianceParts(NamedTuple):
    """The parts of a track's covariances, each (n, 3, 3) in m/s, m/s, rad/s.

    A filter may take the first two as white noise.  The systematic part changes slowly: it belongs
    in the filter's state, or the filter's steps must be far enough apart.

    Attributes
    ----------
    noise : (n, 3, 3) array
        Of the errors of each target, independent of all others.
    dependence : (n, 3, 3) array
        What the correlation of neighbouring targets adds.
    systematic : (n, 3, 3) array
        Of the errors that all targets of a scan, or all sensors, share, and of the prior on the
        side slip.
    """

    noise: Array
    dependence: Array
    systematic: Array

    @property
    def total(self) -> Array:
        """The sum of the parts."""
        return self.noise + self.dependence + self.systematic


def apply_budget(
    problem: Problem,
    estimate: Estimate,
    pairs: Sequence[ScanPair],
    budget: ErrorBudget,
    time: float,
) -> tuple[CovarianceParts, Array]:
    """The parts (3, 3) of a velocity's covariance, without the lag's, and its delay (3, 3) in s.

    ``pairs`` are those of the problem; no scan is in two of them.  The delay times the acceleration
    is how far the estimate is from the velocity at ``time``: positions give the mean velocity over
    their interval, and each sensor's Doppler velocities belong to its own scan.
    """
    cross = problem.cross_derivatives(problem.bind(estimate.theta), 0, 1)
    gain = -estimate.covariance
    noise, dependence, systematic = parts = np.zeros((3, 3, 3))
    scaled, doppler_share, doppler_delay = np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3))
    sigmas = np.array([[budget.azimuth], [budget.doppler]])
    fixed = moving = 0
    for pair, (previous, current, mounting) in zip(problem.pairs, pairs, strict=True):
        of_fixed = slice(fixed, fixed := fixed + pair.fixed.size)
        of_moving = slice(moving, moving := moving + pair.moving.size)
        measured = cross.measured[0, of_moving]
        shared = np.zeros((3, 3))
        for scan, points, position, in_velocity in (
            (previous, pair.fixed, cross.fixed[0, of_fixed], (_NOTHING, _NOTHING)),
            (
                current,
                pair.moving,
                cross.moving[0, of_moving],
                (measured, cross.input[0, of_moving]),
            ),
        ):
            polar = scan.range, *directions(scan, mounting)
            velocity = scan.doppler, scan.sigma_doppler, scan.sigma_azimuth
            _kernel.add_errors(
                position, in_velocity, points.covariances, polar, velocity, noise, shared
            )
            if budget.neighbours:
                order = np.argsort(points.means[:, 0], kind="stable")
                rows = np.empty((9, points.size))
                _kernel.add_dependence(
                    position, points.means, order, budget.neighbours, rows, dependence
                )
        scaled += shared[2]
        biases = sigmas * shared[:2]
        systematic += biases.T @ biases
        if pair.measurement is not None:
            share = pair.interval * (measured.T @ pair.measurement.gain)
            doppler_share += share
            doppler_delay += (current.time - time) * share
    systematic += budget.scale**2 * scaled[:, None] * scaled
    systematic.flat[::4] += problem.prior  # the diagonal
    parts[:, *_LOWER] = parts[:, *_LOWER[::-1]]
    middle = sum(previous.time + current.time for previous, current, _ in pairs) / len(pairs) / 2.0
    delay = gain @ doppler_delay + (middle - time) * (_IDENTITY - gain @ doppler_share)
    moved = gain @ parts @ gain
    return CovarianceParts(*(0.5 * (moved + np.swapaxes(moved, 1, 2)))), delay


def with_lag(parts: CovarianceParts, acceleration: Array, lag: float) -> CovarianceParts:
    """The parts (n, 3, 3) with a lag (s) times the acceleration (n, 3) in the systematic one."""
    moved = lag * acceleration
    added = moved[:, :, None] * moved[:, None, :]
    return parts._replace(systematic=parts.systematic + added)


def accelerations(times: Array, theta: Array) -> Array:
    """Slope (n, 3) of velocities (n, 3), by least squares within half a second to either side."""
    place = np.arange(len(times))
    first = np.searchsorted(times, times - _SLOPE_SPAN, side="left") - place
    last = np.searchsorted(times, times + _SLOPE_SPAN, side="right") - place
    sums = np.zeros((len(times), 9))
    # relative to each estimate: sums over the whole drive lose the digits that a slope needs
    for shift in range(int(first.min(initial=0)), int(last.max(initial=0))):
        near = np.flatnonzero((first <= shift) & (shift < last))
        t = (times[near + shift] - times[near])[:, None]
        value = theta[near + shift] - theta[near]
        sums[near] += np.hstack([np.ones_like(t), t, t**2, value, t * value])
    count, time, square, value, product = np.split(sums, [1, 2, 3, 6], axis=1)
    spread = square - time**2 / count
    enough = count > 1.0  # a single estimate has no slope
    return np.where(enough, (product - time * value / count) / np.where(enough, spread, 1.0), 0.0)
