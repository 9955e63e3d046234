"""Ego-motion of one round after the other, each started where the one before leads."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from d2d._types import Array
from d2d.problem import Estimate, Problem
from d2d.radar.motion.covariance import apply_budget
from d2d.radar.motion.doppler import doppler_acceleration, doppler_starts
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

# Mean inlier probability: at the wide outlier component's own optimum, all targets are outliers.
_MIN_INLIER_SHARE = 0.1
# Sum of the inlier probabilities: three components fit hardly more targets by accident.
_MIN_AGREEING = 4.0
_MAX_TURN = float(np.pi)  # rad; after a full circle, scans of one place fit at any speed
_GOOD_INLIER_SHARE = 0.6  # of a wrong optimum it is rarely more than half (chapter 11)


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
    velocity: Array | None  # where a search starts that no filter predicts, if known
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
        row = self.failed(current, current.reason)
        if current.pairs:
            try:
                row = self._estimated(row, current, rate)
            # numbers for which there is no float64, or no inverse; anything else is our mistake
            except (np.linalg.LinAlgError, ArithmeticError):
                row = row._replace(reason="a scan that cannot be used")
        if row.converged or self.guessed is None:
            return row
        self.guessed = guess(self.guessed, current.time)
        if rate is not None:
            self.guessed = update_yaw_rate(self.guessed, rate)
        return row._replace(theta=self.guessed.mean[:3], errors=self.guessed.errors)

    def failed(self, current: Round, reason: str) -> VelocityEstimate:
        """The row of a round of which nothing is known."""
        unknown, span = np.full((3, 3), np.nan), (current.time, current.interval)
        return VelocityEstimate(*span, self._near, unknown, reason, 0, np.nan, None, None)

    def filtered(self, row: VelocityEstimate, belief: Mixture) -> VelocityEstimate:
        """The row with the velocity of a belief, which may rest on later estimates too."""
        errors = belief.errors
        covariance = errors[1, :3, :3].copy()
        if self.budget is not None and belief.rate is None:  # a gyro sees the sway
            covariance[2, 2] += self.budget.sway**2
        return row._replace(theta=belief.mean[:3], covariance=covariance, errors=errors)

    @property
    def _near(self) -> Array:
        """The velocity (3,) that was accepted last, or zero."""
        return np.zeros(3) if self.velocity is None else self.velocity

    def _estimated(
        self, row: VelocityEstimate, current: Round, rate: MeanRate | None
    ) -> VelocityEstimate:
        """The row of a round with pairs, with an estimate or the reason why there is none."""
        pairs, near, time = current.pairs, self._near, current.time
        predicted = None if self.belief is None else predict(self.belief, time)
        if predicted is not None and rate is not None:
            predicted = update_yaw_rate(predicted, rate)
        acceleration, start = np.zeros(3), self.velocity
        if predicted is not None:
            start, acceleration = predicted.mean[:6].reshape(2, 3)
            start = start + (middle_of(pairs) - time) * acceleration
        elif self.budget is not None:
            first = doppler_acceleration(pairs if self.model.doppler else (), UNKNOWN)
            acceleration = first.value
        problem = problem_of(pairs, self.model, acceleration, near)
        estimate = self._optimum(problem, start, pairs, acceleration)
        targets = sum(pair.current.size for pair in pairs)
        row = row._replace(targets=targets, inliers=float(estimate.inliers))
        row = row._replace(reason=_objection(estimate, row, pairs))
        if row.reason:
            return row
        theta, covariance, raw = estimate.theta, estimate.covariance, None
        if self.budget is not None:
            found = apply_budget(problem, estimate, pairs, self.budget, time, near)
            # the columns of the slow errors in the places of their sensors
            numbers, slow = current.sensors, np.zeros((3, 2 * self.sensors + 2))
            slow[:, [*numbers, *(self.sensors + n for n in numbers), -2, -1]] = found.slow
            if any(constant := (self.budget.v_x, self.budget.v_y, self.budget.omega)):
                slow = np.column_stack([slow, np.diag(constant)])
            velocity = theta + found.step - found.lead @ acceleration
            raw = FilterInput(velocity, found.white, found.delay, slow, self.budget.lag)
            theta, covariance = velocity - raw.delay @ acceleration, raw.covariance
        state = State(time, theta, covariance)
        if not np.isfinite(covariance).all():
            return row._replace(reason="a covariance that is not finite")
        if self.limits is not None and (reason := self.limits.exceeded(state, self.last)):
            return row._replace(reason=reason)
        row = row._replace(theta=theta, covariance=covariance)
        if raw is not None:
            if predicted is not None:
                belief = update(predicted, raw)
            else:
                bias = None if self.guessed is None else bias_of(self.guessed)
                if self.rates is not None and bias is None:
                    bias = 0.0, self.rates.gyro.bias**2
                belief = begin(time, raw, first, bias)
                belief = belief if rate is None else update_yaw_rate(belief, rate)
            self.belief = self.guessed = belief
            row = self.filtered(row._replace(filter_input=raw), belief)
            if self.records is not None:
                self.records.append(belief)
        self.last, self.velocity = state, estimate.theta
        return row

    def _optimum(
        self, problem: Problem, start: Array | None, pairs: Sequence[ScanPair], acceleration: Array
    ) -> Estimate:
        """The optimum near the start; where that is doubtful or missing, the better of two."""
        near = None
        if start is not None:
            near = estimate_velocity(problem, start, self.scales)
            if near.converged and not float(near.inliers) < _GOOD_INLIER_SHARE:
                return near
        # sensors that measure at different times show different velocities while it changes: start
        # by those at the time of the problem
        time, views = middle_of(pairs), []
        for _, scan, mounting in pairs:
            gain, _ = doppler_gradients(scan.azimuth, mounting)
            gained = gain @ ((scan.time - time) * acceleration)
            views.append((replace(scan, doppler=scan.doppler - gained), mounting))
        anew = estimate_velocity(problem, doppler_starts(views), self.scales)
        if near is None:
            return anew
        return min(near, anew, key=lambda each: (not _is_good(each), float(each.value)))


def _is_good(estimate: Estimate) -> bool:
    """Whether an estimate is an optimum that does not reject nearly all targets."""
    return bool(estimate.converged) and not float(estimate.inliers) < _MIN_INLIER_SHARE


def _objection(estimate: Estimate, row: VelocityEstimate, pairs: Sequence[ScanPair]) -> str:
    """Why an estimate is not accepted, whatever its covariance; empty if nothing is against it."""
    if not estimate.converged:
        return "no optimum near the start"
    if not _is_good(estimate):
        return f"an optimum that rejects {1.0 - row.inliers:.0%} of the targets"
    # without an outlier model, the share of inliers is not known: all of them count
    agreeing = row.targets * (1.0 if math.isnan(row.inliers) else row.inliers)
    if agreeing < _MIN_AGREEING:
        return f"an optimum that rests on {agreeing:.1f} targets"
    turn = abs(float(estimate.theta[2])) * max(pair.interval for pair in pairs)
    if turn > _MAX_TURN:
        return f"a turn of {np.rad2deg(turn):.0f} deg between scans"
    return ""
