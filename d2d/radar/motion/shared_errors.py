"""What the errors that targets share do to an estimate."""

from collections.abc import Sequence

import numpy as np

from d2d import _kernel
from d2d._types import Array
from d2d.problem import Problem
from d2d.radar.motion.pairs import ScanPair
from d2d.radar.scans.budget import CovarianceParts, ErrorBudget
from d2d.radar.scans.scan import directions
from d2d.registration import Estimate

# s to either side, over which an acceleration is fitted; a little more than half a second, so that
# the rounding of times does not decide which estimates of a radar with steps of 0.1 s count
_SLOPE_SPAN = 0.5 + 1e-6
_LOWER = [1, 2, 2], [0, 0, 1]  # rows and columns below the diagonal of a matrix (3, 3)
_NOTHING = np.empty((0, 3))
_IDENTITY = np.eye(3)


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
