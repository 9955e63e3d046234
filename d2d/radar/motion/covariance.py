"""The covariance of an ego-motion estimate, propagated from the sensor's errors.

By the implicit function theorem (Censi 2007) an optimum moves by -H⁻¹ f_θz per unit of a
measured value z.  A scan that is in several pairs moves it by the sum of its influences f_theta,z
on these pairs, which are added up first and squared afterwards.  The effect of an error that
targets share is the sum of their influences, times the error.
"""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple, Unpack

import numpy as np
from numpy.typing import NDArray

from d2d import rigid
from d2d._checks import check_instance, check_shape
from d2d._kernel import layout
from d2d._kernel.errors import add_dependence, add_positions
from d2d._types import Array
from d2d.covariance import check_estimate, propagated
from d2d.problem import Bound, Estimate, Problem
from d2d.radar.motion.model import EgoMotionModel, ModelOptions
from d2d.radar.motion.pairs import ScanPair, middle_of, problem_of, right_jacobian, scan_pairs
from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.scans.scan import Mounting, RadarScan


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
    bound = problem.bind(rigid.motion("estimate", estimate.theta, 2))
    check_estimate(estimate, problem, bound)
    noise = np.diag(problem.prior)
    add_noise(of_scans(influences(problem, bound, pairs), pairs), shared_azimuth, noise)
    return propagated(estimate.covariance, noise)


class Influence(NamedTuple):
    """Derivatives of the cost's gradient in the measured values of K targets, and their errors.

    The targets are those of the previous scans of all pairs, then those of the current ones.
    Derivatives in Doppler velocities are zero for previous scans, and without ``doppler``.
    """

    position: Array  # (K, 3, 2) per m, in the vehicle frame
    azimuth: Array  # (K, 3) per rad of azimuth, by the position alone
    doppler: Array  # (K, 3) per m/s
    prediction: Array  # (K, 3) per rad of azimuth, by the predicted Doppler velocity alone
    share: Array  # (K,) of the inliers in the density of current targets
    means: Array  # (K, 2), the positions
    covariances: Array  # (K, 2, 2) of the positions, as the cost has them
    sigma_azimuth: Array  # (K,)
    sigma_doppler: Array  # (K,)
    edges: NDArray[Any]  # (2 P + 1,) where the targets of each scan begin, and K


def influences(problem: Problem, bound: Bound, pairs: Sequence[ScanPair]) -> Influence:
    """The influences of all scans of P pairs at the optimum to which their problem is bound."""
    cross = problem.cross_derivatives(bound)
    scans = [(pair.previous, pair.mounting) for pair in pairs]
    scans += [(pair.current, pair.mounting) for pair in pairs]
    sets, sizes = [scan.point_set(at) for scan, at in scans], [scan.size for scan, _ in scans]
    means = np.concatenate([points.means for points in sets])
    away = means - np.repeat([(at.x, at.y) for _, at in scans], sizes, axis=0)
    none = np.zeros((cross.fixed.shape[1], 3))
    position = np.concatenate([cross.fixed[0], cross.moving[0]])
    return Influence(
        position,
        position[..., 1] * away[:, :1] - position[..., 0] * away[:, 1:],
        np.concatenate([none, cross.measured[0]]),
        np.concatenate([none, cross.input[0]]),
        np.concatenate([none[:, 0], cross.share[0]]),
        means,
        np.concatenate([points.covariances for points in sets]),
        np.concatenate([scan.sigma_azimuth for scan, _ in scans]),
        np.concatenate([scan.sigma_doppler for scan, _ in scans]),
        np.cumsum([0, *sizes]),
    )


def of_scans(found: Influence, pairs: Sequence[ScanPair]) -> Influence:
    """The influences of each scan, added up over the pairs that it is in.

    Scans are the same if all that they hold is the same, and the mounting.
    """
    firsts: dict[tuple[object, ...], int] = {}
    places = []  # of each target, where those of the same scan begin
    scans = [pair.previous for pair in pairs] + [pair.current for pair in pairs]
    for scan, pair, start in zip(scans, [*pairs, *pairs], found.edges[:-1].tolist(), strict=True):
        arrays = (value for value in vars(scan).values() if isinstance(value, np.ndarray))
        key = (pair.mounting, scan.time, *(array.tobytes() for array in arrays))
        places.append(firsts.setdefault(key, start) + np.arange(scan.size))
    which, sums = np.concatenate(places), [np.zeros_like(each) for each in found[:4]]
    for total, each in zip(sums, found[:4], strict=True):
        np.add.at(total, which, each)
    return found._replace(**dict(zip(found._fields, sums, strict=False)))


def add_noise(own: Influence, shared_azimuth: bool, noise: Array, first: int = 0) -> None:
    """Add the covariance (3, 3) of the gradient due to the targets' own, independent errors.

    Doppler velocities of targets before the ``first`` have no influence.
    With ``shared_azimuth``, a single azimuth error of each target turns its position and changes
    its predicted Doppler velocity; else two independent ones do.  The rest of the positions'
    covariances, range and extent, belongs to the positions alone.
    """
    add_positions(own.position[None], own.covariances[None], noise[None])
    sigma_azimuth = own.sigma_azimuth[first:, None]
    doppler = own.sigma_doppler[first:, None] * own.doppler[first:]
    turned = sigma_azimuth * own.prediction[first:]
    noise += doppler.T @ doppler + turned.T @ turned
    if shared_azimuth:  # the positions' covariances hold the square of their own part
        both = turned.T @ (sigma_azimuth * own.azimuth[first:])
        noise += both + both.T


# Of a budget's standard deviations.  0.1 to 0.3 raise the mean log score of seven drives by 0.03 to
# 0.06; all of them lower it by 0.8: then positions, whose targets share errors too, weigh too much.
_MARGINALISED = 0.2


class _Measured(NamedTuple):
    """The Doppler velocities of K current targets as measurements of the common velocity."""

    value: Array  # (K,) m/s
    gain: Array  # (K, 3), derivatives of the predicted value in the velocity
    turned: Array  # (K,) m/s per rad, its derivative in the azimuth
    variance: Array  # (K,)

    @classmethod
    def of(cls, factors: Array, theta: Array, intervals: Array) -> "_Measured":
        """The measurements (K, 9) at a velocity (3,), for the intervals (K,) of their pairs."""
        gain = intervals[:, None] * factors[:, layout.GAIN : layout.GAIN + 3]
        turned = intervals * (factors[:, layout.SLOPE : layout.SLOPE + 3] @ theta)
        variance = factors[:, layout.VARIANCE] + factors[:, layout.INPUT_VARIANCE] * turned**2
        return cls(factors[:, layout.VALUE], gain, turned, variance)

    def marginalised(self, share: Array, budget: ErrorBudget, scans: Sequence[slice]) -> Array:
        """The loss of the targets' weights to shared errors, times their gains (K, 3).

        The cost has independent errors, which make Doppler velocities too sure, of omega above all.
        With errors B s beside them that a scan shares, s ~ N(0, I), the weights W become

            (W⁻¹ + B Bᵀ)⁻¹ = W - W B (I + Bᵀ W B)⁻¹ Bᵀ W
        """
        both = np.empty((len(share), 5))  # B and the gains
        both[:, 0] = _MARGINALISED * budget.doppler
        both[:, 1] = _MARGINALISED * budget.azimuth * self.turned
        both[:, 2:] = self.gain
        weighted = (share / self.variance)[:, None] * both[:, :2]
        sums = np.array([weighted[scan].T @ both[scan] for scan in scans])
        pulls = np.linalg.solve(np.eye(2) + sums[..., :2], sums[..., 2:])
        losses = [weighted[scan] @ pull for scan, pull in zip(scans, pulls, strict=True)]
        return np.concatenate(losses)


class Budgeted(NamedTuple):
    """Covariance contributions of a budget to a velocity from P pairs of scans, without the lag.

    The step leads from the estimate to the velocity with the weights that shared errors leave.  The
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
    velocity: Array,
) -> Budgeted:
    """Apply a budget to a velocity, whose delay is that to ``time``.

    ``pairs`` and ``velocity`` are those of `problem_of`; each pair is of another sensor.
    """
    bound, count = problem.bind(estimate.theta), len(pairs)
    influence = influences(problem, bound, pairs)
    intervals = np.array([pair.interval for pair in pairs])
    times, common = np.array([pair.current.time for pair in pairs]), middle_of(pairs)
    starts, spans = influence.edges[:-1], [*pairwise(influence.edges.tolist())]  # of all scans
    first = spans[count][0]  # of the current targets
    scans = [slice(begin - first, end - first) for begin, end in spans[count:]]
    hessian, gradient = estimate.hessian, np.zeros(3)
    measured, doppler, scale = None, np.zeros((count, 3)), np.zeros(3)
    if problem.pairs[0].measurement is not None:
        of_targets = intervals.repeat([pair.current.size for pair in pairs])
        measured = _Measured.of(bound.batch.factors, estimate.theta, of_targets)
        if budget.azimuth or budget.doppler:  # else nothing is shared
            lost = measured.marginalised(influence.share[first:], budget, scans)
            influence.doppler[first:] += lost
            influence.prediction[first:] -= measured.turned[:, None] * lost
            hessian = hessian - measured.gain.T @ lost
            gradient = (measured.value - measured.gain @ estimate.theta) @ lost
    noise = np.zeros((3, 3))
    add_noise(influence, True, noise, first)
    if budget.neighbours:
        ends = influence.edges[1:].repeat(np.diff(influence.edges))
        order = [begin + influence.means[begin:end, 0].argsort() for begin, end in spans]
        targets = influence.position, influence.covariances, influence.means, ends
        memory = np.empty((9, len(ends)))
        add_dependence(*targets, np.concatenate(order), budget.neighbours, memory, noise)
    turned = np.add.reduceat(influence.azimuth, starts)
    azimuth = turned[:count] + turned[count:]
    # the gradient's derivatives in small motions that follow those of the pairs
    moved = np.empty((count, 3, 3))
    moved[..., :2] = np.add.reduceat(influence.position, starts[count:])
    levers = np.array([[-each.mounting.y, each.mounting.x] for each in pairs])
    moved[..., 2] = turned[count:] + np.einsum("pij,pj->pi", moved[..., :2], levers)
    # with [., .] the bracket of SE(2), a constant acceleration a moves a vehicle that turns by
    # exp(tau (theta + tau^2 / 12 [theta, a])), theta that in the middle (Magnus 1954)
    v_x, v_y, omega = estimate.theta.tolist()
    bracket = np.array([[0.0, -omega, v_y], [omega, 0.0, -v_x], [0.0, 0.0, 0.0]])
    delays, leads = np.empty((2, count, 3, 3))
    for number, pair in enumerate(pairs):
        late = (pair.middle - time) * np.eye(3) + pair.interval**2 / 12.0 * bracket
        share = -pair.interval * moved[number]
        delays[number] = share @ right_jacobian(pair.interval * estimate.theta) @ late
        leads[number] = (common - pair.middle) * share @ right_jacobian(pair.interval * velocity)
    if measured is not None:
        by_value = influence.doppler[first:]
        azimuth += np.add.reduceat(influence.prediction, starts[count:])
        doppler = np.add.reduceat(influence.doppler, starts[count:])
        scale = np.concatenate([each.current.doppler for each in pairs]) @ by_value
        gains = np.array([by_value[scan].T @ measured.gain[scan] for scan in scans])
        delays += (times - time)[:, None, None] * gains
        leads += (common - times)[:, None, None] * gains
    slip = [0.0, np.sqrt(problem.prior[1]), 0.0]  # of v_y, the only one that has a prior
    slow = np.empty((2 * count + 2, 3))
    slow[:count], slow[count:-2] = budget.azimuth * azimuth, budget.doppler * doppler
    slow[-2], slow[-1] = budget.scale * scale, slip
    covariance = np.asarray(np.linalg.inv(hessian), dtype=np.float64)
    white, gain = propagated(covariance, noise), -covariance
    delay, lead = gain @ delays.sum(axis=0), gain @ leads.sum(axis=0)
    return Budgeted(gain @ gradient, white, gain @ slow.T, delay, lead)
