"""The covariance of an ego-motion estimate, propagated from the sensor's errors.

By the implicit function theorem (Censi 2007) an optimum moves by -H^-1 f_theta,z per unit of a
measured value z.  A scan that is in several pairs moves it by the sum of its influences f_theta,z
on these pairs, which are added up first and squared afterwards.  The effect of an error that
targets share is the sum of their influences, times the error.
"""

from collections.abc import Iterable, Sequence
from itertools import chain
from typing import NamedTuple, Unpack

import numpy as np

from d2d import rigid
from d2d._checks import check_instance, check_shape
from d2d._kernel.errors import add_dependence, add_positions
from d2d._types import Array
from d2d.covariance import check_estimate, in_coordinates
from d2d.point_set import PointSet
from d2d.problem import Estimate, Pair, Problem
from d2d.radar.motion.model import EgoMotionModel, ModelOptions
from d2d.radar.motion.pairs import ScanPair, following, middle_of, problem_of, scan_pairs
from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.scans.scan import Mounting, RadarScan, cross_range


def propagate_ego_motion(
    estimate: Estimate,
    previous: RadarScan | Iterable[RadarScan],
    current: RadarScan | Iterable[RadarScan],
    mounting: Mounting | Iterable[Mounting],
    *,
    shared_azimuth: bool = True,
    **options: Unpack[ModelOptions],
) -> Array:
    """Covariance of an ego-motion estimate by propagating range, azimuth and Doppler errors.

    Returns a matrix (3, 3); nan if the estimate did not converge.  Raises a ``ValueError`` if an
    argument is invalid, as in `estimate_ego_motion` and `d2d.propagate_covariance`.

    Parameters
    ----------
    estimate : Estimate
        A single result of `estimate_ego_motion` with the same scans, mountings and options.
    previous, current, mounting
        As for `estimate_ego_motion`.  A scan can be in several pairs: scans with the same content
        and mounting are the same scan.  The inverse Hessian treats the pairs as independent.
    shared_azimuth : bool
        Whether a single azimuth error of each current target both rotates its position about the
        sensor and changes its predicted Doppler velocity, as in a real sensor.  Otherwise two
        independent errors do, as in the cost (thesis eq. 7.14).  A shared one correlates the errors
        of the sensor's transverse velocity and of omega, unless the Doppler error that the azimuth
        causes is small.
    **options
        The fields of `EgoMotionModel`.
    """
    check_instance("estimate", estimate, Estimate)
    check_shape("estimate.theta", estimate.theta, "(3,)")
    pairs = scan_pairs(previous, current, mounting)
    problem = problem_of(pairs, EgoMotionModel(**options))
    check_estimate(estimate, problem, problem.bind(rigid.motion("estimate", estimate.theta, 2)))
    noise = np.diag(problem.prior)
    for each in of_scans(chain.from_iterable(influences(problem, estimate, pairs))):
        add_noise(each, shared_azimuth, noise)
    return in_coordinates(estimate.covariance, noise)


class Influence(NamedTuple):
    """Derivatives of the cost's gradient in the measured values of one scan's K targets.

    Those in Doppler velocities are zero for the previous scan of a pair, and without ``doppler``.
    """

    scan: RadarScan
    mounting: Mounting
    points: PointSet  # the positions, with their covariances as the cost has them
    position: Array  # (K, 3, 2) per m, in the vehicle frame
    doppler: Array  # (K, 3) per m/s
    prediction: Array  # (K, 3) per rad of azimuth, by the predicted Doppler velocity alone


def influences(
    problem: Problem, estimate: Estimate, pairs: Sequence[ScanPair]
) -> list[tuple[Influence, Influence]]:
    """The influences of the previous and the current scan of each pair at an optimum (3,)."""
    cross = problem.cross_derivatives(problem.bind(estimate.theta), 0, 1)
    found, fixed, moving = [], 0, 0
    for pair, (previous, current, mounting) in zip(problem.pairs, pairs, strict=True):
        of_fixed = slice(fixed, fixed := fixed + pair.fixed.size)
        of_moving = slice(moving, moving := moving + pair.moving.size)
        none = np.zeros((pair.fixed.size, 3))
        before = Influence(previous, mounting, pair.fixed, cross.fixed[0, of_fixed], none, none)
        now = (each[0, of_moving] for each in cross[1:])
        found.append((before, Influence(current, mounting, pair.moving, *now)))
    return found


def of_scans(found: Iterable[Influence]) -> Iterable[Influence]:
    """The influences of each scan, added up over the pairs that it is in.

    Scans are the same if all that they hold is the same, and the mounting.
    """
    total: dict[tuple[object, ...], Influence] = {}
    for each in found:
        arrays = (value for value in vars(each.scan).values() if isinstance(value, np.ndarray))
        key = (each.mounting, each.scan.time, *(array.tobytes() for array in arrays))
        before = total.get(key)
        added = each if before is None else Influence(*each[:3], *map(np.add, before[3:], each[3:]))
        total[key] = added
    return total.values()


def add_noise(own: Influence, shared_azimuth: bool, noise: Array) -> None:
    """Add the covariance (3, 3) of the gradient due to the targets' own, independent errors.

    With ``shared_azimuth``, a single azimuth error of each target turns its position and changes
    its predicted Doppler velocity; else two independent ones do.  The rest of the positions'
    covariances, range and extent, belongs to the positions alone.
    """
    add_positions(own.position[None], own.points.covariances[None], noise[None])
    if own.doppler.any():
        doppler = own.scan.sigma_doppler[:, None] * own.doppler
        turned = own.scan.sigma_azimuth[:, None] * own.prediction
        noise += doppler.T @ doppler + turned.T @ turned
        if shared_azimuth:  # the positions' covariances hold the square of their own part
            across = own.scan.sigma_azimuth[:, None] * cross_range(own.scan, own.mounting)
            both = turned.T @ np.einsum("kij,kj->ki", own.position, across)
            noise += both + both.T


# Of a budget's standard deviations.  0.1 to 0.3 raise the mean log score of seven drives by 0.03 to
# 0.06; all of them lower it by 0.8: then positions, whose targets share errors too, weigh too much.
_MARGINALISED = 0.2


def marginalise_shared(
    now: Influence, pair: Pair, theta: Array, inliers: Array, budget: ErrorBudget
) -> tuple[Influence, Array, Array]:
    """Take shared errors into the weights of a scan's Doppler velocities.

    The cost has independent errors, which make these velocities too sure, of omega above all.  With
    shared errors B s beside them, s ~ N(0, I), the weights W of the targets become

        (W^-1 + B B')^-1 = W - W B (I + B' W B)^-1 B' W

    Returns the influence of the scan at the velocity ``theta`` (3,), and what is lost of Hessian
    (3, 3) and gradient (3,).
    """
    measured = pair.measurement
    if measured is None or not inliers.any():
        return now, np.zeros((3, 3)), np.zeros(3)
    motion, gain = pair.interval * theta, pair.interval * measured.gain
    turned = measured.slope @ motion  # m/s per rad of azimuth
    sigmas = _MARGINALISED * np.array([budget.doppler, budget.azimuth])
    common = np.column_stack([np.ones_like(turned), turned]) * sigmas
    weights = inliers / (measured.sigma**2 + (measured.sigma_input * turned) ** 2)
    weighted = weights[:, None] * common
    lost = weighted @ np.linalg.solve(np.eye(2) + common.T @ weighted, weighted.T @ gain)
    less = now._replace(
        doppler=now.doppler + lost, prediction=now.prediction - turned[:, None] * lost
    )
    return less, gain.T @ lost, (measured.gain @ motion - measured.value) @ lost


class Budgeted(NamedTuple):
    """Covariance contributions of a budget to a velocity from P pairs of scans, without the lag.

    The step leads from the estimate to the velocity with the weights of `marginalise_shared`.  The
    delay, times the acceleration, is how far this is from the velocity at a common time: positions
    give the mean velocity over an interval, and Doppler velocities belong to the later scan.  The
    lead, times an acceleration, is how far the estimate moves if `problem_of` gets that.
    """

    step: Array  # (3,)
    white: Array  # (3, 3), by independent errors and what neighbouring targets share
    # (3, 2 P + 2), changes of the velocity by one standard deviation of each pair's azimuth error,
    # of each pair's Doppler error, of the scale error and of the side slip
    slow: Array
    delay: Array  # (3, 3) s
    lead: Array  # (3, 3) s


def apply_budget(
    problem: Problem,
    estimate: Estimate,
    pairs: Sequence[ScanPair],
    budget: ErrorBudget,
    time: float,
    near: Array,
) -> Budgeted:
    """Apply a budget to a velocity, whose delay is that to ``time``.

    ``pairs`` and ``near`` are those of the problem; each pair is of another sensor.
    """
    found, hessian, gradient = influences(problem, estimate, pairs), estimate.hessian, np.zeros(3)
    seen, inliers = 0, np.zeros(problem.targets)
    if budget.azimuth or budget.doppler:  # else nothing is shared
        inliers = problem.inlier_shares(problem.bind(estimate.theta))
    noise, delayed, led = np.zeros((3, 3, 3))
    common = middle_of(pairs)
    v_x, v_y, omega = estimate.theta.tolist()
    bracket = np.array([[0.0, -omega, v_y], [omega, 0.0, -v_x], [0.0, 0.0, 0.0]])
    columns = []  # of each pair (3, 3): by its azimuth, its Doppler and the scale error
    for given, pair, (before, now) in zip(pairs, problem.pairs, found, strict=True):
        own = inliers[seen : (seen := seen + pair.moving.size)]
        now, lost, pull = marginalise_shared(now, pair, estimate.theta, own, budget)
        hessian, gradient = hessian - lost, gradient - pull
        shared, turned = np.zeros((3, 3)), np.zeros((2, 3))
        for each, total in zip((before, now), turned, strict=True):
            add_noise(each, True, noise)
            across = cross_range(each.scan, each.mounting)
            total += np.einsum("kij,kj->i", each.position, across)
            if budget.neighbours:
                means, covariances = each.points.means, each.points.covariances
                order, memory = means[:, 0].argsort(kind="stable"), np.empty((9, len(means)))
                length = budget.neighbours
                add_dependence(each.position, covariances, means, order, length, memory, noise)
        shared[0] = turned.sum(axis=0)
        # the gradient's derivative in a small motion that follows the pair's own
        moved = np.empty((3, 3))
        moved[:, :2] = now.position.sum(axis=0)
        moved[:, 2] = turned[1] + moved[:, :2] @ [-now.mounting.y, now.mounting.x]
        share = -pair.interval * moved
        # with [., .] the bracket of SE(2), a constant acceleration a moves a vehicle that turns by
        # exp(tau (theta + tau^2 / 12 [theta, a])), theta that in the middle (Magnus 1954)
        mean = pair.interval**2 / 12.0 * bracket
        late = (given.middle - time) * np.eye(3) + mean
        delayed += share @ following(pair.interval * estimate.theta) @ late
        led -= (given.middle - common) * share @ following(pair.interval * near)
        if pair.measurement is not None:
            shared[0] += now.prediction.sum(axis=0)
            shared[1] += now.doppler.sum(axis=0)
            shared[2] += now.scan.doppler @ now.doppler
            share = pair.interval * (now.doppler.T @ pair.measurement.gain)
            delayed += (now.scan.time - time) * share
            led -= (now.scan.time - common) * share
        columns.append(shared)
    azimuth, doppler, scale = np.array(columns).swapaxes(0, 1)
    slip = [0.0, np.sqrt(problem.prior[1]), 0.0]  # of v_y, the only one that has a prior
    slow = np.vstack(
        [budget.azimuth * azimuth, budget.doppler * doppler, budget.scale * scale.sum(axis=0), slip]
    )
    covariance = np.asarray(np.linalg.inv(hessian), dtype=np.float64)
    white, gain = in_coordinates(covariance, noise), -covariance
    return Budgeted(gain @ gradient, white, gain @ slow.T, gain @ delayed, gain @ led)
