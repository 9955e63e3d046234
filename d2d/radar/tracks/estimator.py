"""Ego-motion of one round after the other, each started at the last accepted velocity."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from d2d._types import Array
from d2d.problem import Estimate, Problem
from d2d.radar.motion.covariance import Budgeted, apply_budget
from d2d.radar.motion.doppler import View, doppler_acceleration, doppler_starts
from d2d.radar.motion.estimate import estimate_velocity
from d2d.radar.motion.model import EgoMotionModel
from d2d.radar.motion.pairs import ScanPair, middle_of, problem_of
from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.scans.scan import doppler_gradients
from d2d.radar.tracks.filter import (
    UNKNOWN,
    Mixture,
    begin,
    bias_of,
    guess,
    predict,
    update,
    update_yaw_rate,
)
from d2d.radar.tracks.filter_input import FilterInput
from d2d.radar.tracks.gyro import GyroRates, MeanRate
from d2d.radar.tracks.limits import State, VehicleLimits
from d2d.radar.tracks.rounds import Round

# The wide outlier component has a separate optimum, far from where the scans overlap: all
# targets are outliers there, and the Hessian is positive definite.  An optimum at which the mean
# inlier probability of the targets is below this is not accepted as the vehicle's motion.
MIN_INLIER_SHARE = 0.1
# A velocity has three components.  An optimum that rests on hardly more targets is accidental,
# however large a share of the scan they are.
_MIN_AGREEING = 4.0  # sum of the inlier probabilities
# rad; a vehicle that drives in a circle between two scans is back where it was: scans of one place
# then fit at any speed, as they do where times are in another unit
_MAX_TURN = float(np.pi)
# A wrong optimum rarely explains more than half of the targets (chapter 11).  One that explains at
# least this fraction is accepted without looking for another.
_GOOD_INLIER_SHARE = 0.6


class VelocityEstimate(NamedTuple):
    """The velocity of a vehicle at the time of one round of scans: a row of a `Track`."""

    time: float  # s, the mean of the scans' times
    interval: float  # s, since the round before; nan if the clock has stepped back since
    theta: Array  # (3,) in m/s, m/s, rad/s; the last accepted one if this one is not
    covariance: Array  # (3, 3); nan if not accepted
    reason: str  # why it is not accepted; empty if it is
    targets: int  # of the round's scans
    inliers: float  # mean inlier probability of the targets, nan if there was nothing to estimate
    filter_input: FilterInput | None  # if it is accepted and filtered
    errors: Array | None  # (2, 6, 6 + k) of the filter's state, as `Track.errors`

    @property
    def converged(self) -> bool:
        """Whether an optimum was found and accepted."""
        return not self.reason


@dataclass
class OdometryEstimator:
    """Estimates the velocity of one round after the other, and remembers the last accepted one.

    Nothing that it needs is later than the round, so that rounds can come as they are measured.
    """

    model: EgoMotionModel
    scales: Sequence[float]
    velocity: Array | None  # at which the next search starts, if it is known
    budget: ErrorBudget | None  # without one, the estimates are not filtered
    limits: VehicleLimits | None
    sensors: int  # how many
    last: State | None = None
    belief: Mixture | None = None  # of the filter after the last accepted round
    guessed: Mixture | None = None  # the same since then
    rates: GyroRates | None = None
    records: list[Mixture] | None = None  # of the accepted rounds, for a smoother

    def step(self, current: Round) -> VelocityEstimate:
        """Estimate the velocity at the time of a round; a failure leaves all else as it was."""
        if math.isnan(current.interval):  # its clock is another
            self.last = self.belief = self.guessed = None
        rate = None if self.rates is None else self.rates.before(current.time)
        if not current.pairs:
            return self._rejected(current, rate, current.reason)
        try:
            return self._accepted(current, rate)
        except (ValueError, ArithmeticError):  # numbers for which there is no float64
            return self._rejected(current, rate, "a scan that cannot be used")

    def _accepted(self, current: Round, rate: MeanRate | None) -> VelocityEstimate:
        """The estimate of a round with pairs, or the reason for which it is not accepted."""
        pairs = current.pairs
        predicted = None if self.belief is None else predict(self.belief, current.time)
        if predicted is not None and rate is not None:
            predicted = update_yaw_rate(predicted, rate)
        acceleration = np.zeros(3)
        if predicted is not None:
            acceleration = predicted.whole.mean[3:6]
        elif self.budget is not None:
            first = doppler_acceleration(pairs if self.model.doppler else (), UNKNOWN)
            acceleration = first.value
        near = np.zeros(3) if self.velocity is None else self.velocity
        problem = problem_of(pairs, self.model, acceleration, near)
        estimate = self._estimate(problem, _time_aligned_scans(pairs, acceleration))
        seen = sum(pair.current.size for pair in pairs), float(estimate.inliers)
        reason = _objection(estimate, pairs)
        if reason:
            return self._rejected(current, rate, reason, *seen)
        theta, covariance, raw, errors = estimate.theta, estimate.covariance, None, None
        if self.budget is not None:
            found = apply_budget(problem, estimate, pairs, self.budget, current.time, near)
            raw = self._filter_input(found, theta - found.lead @ acceleration, current.sensors)
            theta, covariance = raw.velocity - raw.delay @ acceleration, raw.parts.total
        state = State(current.time, theta, covariance)
        if not np.isfinite(covariance).all():
            reason = "a covariance that is not finite"
        elif self.limits is not None:
            reason = self.limits.exceeded(state, self.last)
        if reason:
            return self._rejected(current, rate, reason, *seen)
        if raw is not None:
            if predicted is not None:
                belief = update(predicted, raw)
            else:
                belief = begin(current.time, raw, first, self._bias)
                belief = belief if rate is None else update_yaw_rate(belief, rate)
            theta, errors, self.belief = belief.whole.mean[:3], belief.errors, belief
            covariance = errors[1, :3, :3]
            self.guessed = belief
            if self.records is not None:
                self.records.append(belief)
        self.last, self.velocity = state, estimate.theta
        return VelocityEstimate(
            current.time, current.interval, theta, covariance, "", *seen, raw, errors
        )

    @property
    def _bias(self) -> tuple[float, float] | None:
        """The mean and the variance of the gyro's bias, if there is one."""
        if self.rates is None:
            return None
        known = None if self.guessed is None else bias_of(self.guessed)
        return known or (0.0, self.rates.gyro.bias**2)

    def _filter_input(
        self, found: Budgeted, velocity: Array, sensors: Sequence[int]
    ) -> FilterInput:
        """The columns of the slow errors in the places of their sensors."""
        assert self.budget is not None
        slow = np.zeros((3, 2 * self.sensors + 2))
        slow[:, [*sensors, *(self.sensors + n for n in sensors), -2, -1]] = found.slow
        if (constant := np.sqrt(self.budget.constant)).any():
            slow = np.column_stack([slow, constant])
        return FilterInput(velocity, found.parts, found.delay, slow, self.budget.lag)

    def _rejected(
        self,
        current: Round,
        rate: MeanRate | None,
        reason: str,
        targets: int = 0,
        inliers: float = np.nan,
    ) -> VelocityEstimate:
        """The row of a round that gives no estimate."""
        theta, errors = np.zeros(3) if self.velocity is None else self.velocity, None
        if self.guessed is not None:
            self.guessed = guess(self.guessed, current.time)
            if rate is not None:
                self.guessed = update_yaw_rate(self.guessed, rate)
            theta, errors = self.guessed.whole.mean[:3], self.guessed.errors
        unknown, seen = np.full((3, 3), np.nan), (targets, inliers)
        return VelocityEstimate(
            current.time, current.interval, theta, unknown, reason, *seen, None, errors
        )

    def _estimate(self, problem: Problem, views: Iterable[View]) -> Estimate:
        """The optimum near the last velocity; where it is doubtful, the better of two."""
        near = None
        if self.velocity is not None:
            near = estimate_velocity(problem, self.velocity, self.scales)
            if near.converged and not float(near.inliers) < _GOOD_INLIER_SHARE:
                return near
        anew = estimate_velocity(problem, doppler_starts([*views]), self.scales)
        if near is None:
            return anew
        return min(near, anew, key=lambda each: (not _is_good(each), float(each.value)))


def _time_aligned_scans(pairs: Sequence[ScanPair], acceleration: Array) -> Iterator[View]:
    """The later scans with the Doppler velocities that they would have at the time of `problem_of`.

    Sensors that measure at different times show different velocities while the vehicle accelerates.
    """
    time = middle_of(pairs)
    for _, scan, mounting in pairs:
        gain, _ = doppler_gradients(scan.azimuth, mounting)
        gained = gain @ ((scan.time - time) * acceleration)
        yield replace(scan, doppler=scan.doppler - gained), mounting


def _is_good(estimate: Estimate) -> bool:
    """Whether an estimate is an optimum that does not reject nearly all targets."""
    return bool(estimate.converged) and not float(estimate.inliers) < MIN_INLIER_SHARE


def _objection(estimate: Estimate, pairs: Sequence[ScanPair]) -> str:
    """Why an estimate is not accepted, whatever its covariance; empty if nothing is against it."""
    if not estimate.converged:
        return "no optimum near the start"
    if not _is_good(estimate):
        return f"an optimum that rejects {1.0 - float(estimate.inliers):.0%} of the targets"
    share = float(estimate.inliers)  # without an outlier model, not known: all of them count
    agreeing = sum(pair.current.size for pair in pairs) * (1.0 if math.isnan(share) else share)
    if agreeing < _MIN_AGREEING:
        return f"an optimum that rests on {agreeing:.1f} targets"
    turn = abs(float(estimate.theta[2])) * max(pair.interval for pair in pairs)
    if turn > _MAX_TURN:
        return f"a turn of {np.rad2deg(turn):.0f} deg between scans"
    return ""
