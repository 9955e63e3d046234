"""The acceleration of a vehicle, by which each estimate is carried to its time.

Positions give the mean velocity over the interval of a pair, which lags behind while the vehicle
accelerates.  How far is known: the estimate z of a round is

    z = theta + D a + e

with the velocity theta and the acceleration a at the round's time, the delay D in s, and the errors
e of the targets.  A Kalman filter of [theta, a], in which the acceleration is a random walk, learns
a from the estimates; carried to its time, an estimate is z - D a.

How fast the acceleration changes depends on the road.  Three such filters run side by side, for
driving evenly, as usual, and through a town's corners; each weighs as much as it foretold the
estimates (interacting multiple models: Blom & Bar-Shalom 1988).

The acceleration that carries an estimate comes from other estimates only: from those before it, or,
once a log is complete, from all others.  Its error is then independent of e, and the covariance
after the carry is that of e plus D A D' with the covariance A of the acceleration.  Velocities that
the filter itself gives would be smoother, but each would contain the errors of many rounds, and a
vehicle that drives evenly would have far smaller errors than stated.

For a vehicle that never accelerates, the ANEES of the first, an inner and the last estimate of one
radar is 0.9 to 1.1 at 4 to 20 Hz, causal or smooth.  At 1 Hz it is 0.9 to 1.1 for the inner and the
last one, and 0.7 to 0.8 for the first: until much has been seen, it might have done more.
"""

from typing import NamedTuple

import numpy as np

from d2d._types import Array
from d2d.radar.motion.doppler import Acceleration

# Of a car, along x and y in m/s^2 and about z in rad/s^2: standard deviations of the acceleration
# where nothing is known of it (twice the RMS on seven drives), and by how much it usually changes
# in a second.  The rear axle of a car hardly slides: lateral velocities change slowly, and so tell
# yaw rates from side slip.
UNKNOWN = np.diag(np.square([1.3, 0.09, 0.12]))
JERK = np.diag(np.square([1.0, 0.015, 0.025]))  # variances per s

JERK_SCALES = np.array([0.0, 1.0, 10.0])  # of the modes: evenly, as usual, sharply; times JERK
MODE_PRIOR = np.array([0.45, 0.45, 0.1])  # of the time, where nothing is known
_MODE_DURATION = 600.0  # s, for which a mode lasts on average, as a kind of road does
_MEMORY = 2.0  # s
_IMPLAUSIBLE = 12.0  # standard deviations, by which no estimate of a vehicle surprises

State = tuple[Array, Array]  # mean (..., 6) of [theta, a] and covariance (..., 6, 6)


class FilterRecord(NamedTuple):
    """Record of one estimate for the smoother."""

    begun: State | None  # where the filter began anew, with what
    passed: float  # s, since the step before
    jerk_scale: float  # the mean over the modes, as the filter knows them up to here
    to: Array  # (3, 6), of the state to the estimate
    estimate: Array  # (3,)
    noise: Array  # (3, 3)


class AccelerationFilter:
    """Learns the acceleration from one estimate after the other.

    It begins anew after a gap, when it would know no more of the acceleration than at first, and
    where an estimate jumps.
    """

    def __init__(self) -> None:
        self._time = 0.0
        self._shares = MODE_PRIOR  # probabilities of the modes
        self._states: State | None = None  # one for each mode

    def predict(self, time: float) -> Acceleration | None:
        """The acceleration at a time in s, from all estimates so far; None if it begins anew."""
        if (found := self._predicted(time)) is None:
            return None
        state, covariance = _moment_match(*found)
        return Acceleration(state[3:], covariance[3:, 3:])

    def update(
        self, time: float, estimate: Array, delay: Array, noise: Array, carried_by: Acceleration
    ) -> FilterRecord:
        """Learn from an estimate (3,) with its delay (3, 3) in s and the covariance of its errors.

        Of these, only those that differ from one estimate to the next count: what all have in
        common does not change an acceleration.  Where the filter begins anew, it begins with the
        acceleration by which the estimate was carried; where no mode explains the estimate, with
        none.
        """
        to, passed, begun = np.hstack([np.eye(3), delay]), time - self._time, None
        if (found := self._predicted(time)) is not None:
            shares, predicted = found
            self._states, squares, log_likelihood = _updated(predicted, to, estimate, noise)
            weights = shares * np.exp(log_likelihood - log_likelihood.max())
            self._shares = weights / weights.sum()
            if squares.min() > _IMPLAUSIBLE**2:
                found, carried_by = None, Acceleration(np.zeros(3), UNKNOWN)
        if found is None:
            value, own = carried_by
            late = delay @ own
            covariance = np.block([[noise + late @ delay.T, -late], [-late.T, own]])
            begun = np.concatenate([estimate - delay @ value, value]), covariance
            self._shares = MODE_PRIOR
            self._states = (
                np.stack([begun[0]] * len(MODE_PRIOR)),
                np.stack([begun[1]] * len(MODE_PRIOR)),
            )
        self._time = time
        return FilterRecord(begun, passed, float(self._shares @ JERK_SCALES), to, estimate, noise)

    def _predicted(self, time: float) -> tuple[Array, State] | None:
        """Shares and states of the modes at a time, if what was learnt is not forgotten.

        The driver may have changed the mode since.
        """
        passed = time - self._time
        if self._states is None or passed > _MEMORY:
            return None
        lasts = np.exp(-passed / _MODE_DURATION)
        changes = lasts * np.eye(len(MODE_PRIOR)) + (1.0 - lasts) * MODE_PRIOR  # from, to
        shares = self._shares @ changes
        origins = (self._shares[:, None] * changes / shares).T
        mixed = _moment_match(origins, self._states)
        return shares, _predict(mixed, passed, JERK_SCALES[:, None, None] * JERK)


def accelerations_of_others(steps: list[FilterRecord]) -> list[Acceleration]:
    """The acceleration at each estimate, from all others before and after it.

    A filter with the mean jerk scale at each step goes forward, and a smoother goes back (Rauch,
    Tung & Striebel 1965); then each estimate's own contribution is taken out of the state at its
    time, as a measurement of negative covariance.
    """
    predicted: list[State] = []
    updated: list[State] = []
    for step in steps:
        if step.begun is not None:
            before = after = step.begun
        else:
            before = _predict(updated[-1], step.passed, step.jerk_scale * JERK)
            after, *_ = _updated(before, step.to, step.estimate, step.noise)
        predicted.append(before)
        updated.append(after)
    smoothed = updated.copy()
    for i in reversed(range(len(steps) - 1)):
        if steps[i + 1].begun is not None:
            continue
        (state, covariance), (expected, spread) = updated[i], predicted[i + 1]
        gain = np.linalg.solve(spread, _transition(steps[i + 1].passed) @ covariance).T
        later = smoothed[i + 1]
        smoothed[i] = (
            state + gain @ (later[0] - expected),
            covariance + gain @ (later[1] - spread) @ gain.T,
        )
    return [_without_own(*each) for each in zip(steps, predicted, smoothed, strict=True)]


def _without_own(step: FilterRecord, predicted: State, smoothed: State) -> Acceleration:
    """The acceleration of a smoothed state without what the step's own estimate says."""
    state, covariance = smoothed
    if step.begun is smoothed:  # there is no other
        return Acceleration(state[3:], covariance[3:, 3:])
    spread = step.to @ covariance @ step.to.T - step.noise
    gain = np.linalg.solve(spread, step.to @ covariance).T
    value = state + gain @ (step.estimate - step.to @ state)
    rest = covariance - gain @ spread @ gain.T
    rest = 0.5 * (rest + rest.T)[3:, 3:]
    if np.linalg.eigvalsh(rest)[0] > 0.0:
        return Acceleration(value[3:], rest)
    # the difference is lost in rounding; those before are others, too
    return Acceleration(predicted[0][3:], predicted[1][3:, 3:])


def _transition(passed: float) -> Array:
    """The matrix (6, 6) by which the state moves on over a time in s."""
    move = np.eye(6)
    move[:3, 3:] = passed * np.eye(3)
    return move


def _predict(states: State, passed: float, jerk: Array) -> State:
    """States (..., 6) after a time in s, in which the acceleration walks."""
    means, covariances = states
    move = _transition(passed)
    walk = [[passed**3 / 3.0, passed**2 / 2.0], [passed**2 / 2.0, passed]]
    return means @ move.T, move @ covariances @ move.T + np.kron(walk, jerk)


def _moment_match(shares: Array, states: State) -> State:
    """Mean and covariance of a mixture of m states, for shares (..., m)."""
    means, covariances = states
    mean = shares @ means
    apart = means - mean[..., None, :]
    spread = np.einsum("...k,...ki,...kj->...ij", shares, apart, apart)
    return mean, np.einsum("...k,kij->...ij", shares, covariances) + spread


def _updated(states: State, to: Array, value: Array, noise: Array) -> tuple[State, Array, Array]:
    """States (..., 6) after a measurement, in the form that stays definite (Joseph).

    Also by how many standard deviations, squared, each state differs from the measurement (...,),
    and the log density that it gave it, up to what all have in common.
    """
    means, covariances = states
    new, spread = value - means @ to.T, to @ covariances @ to.T + noise
    gain = np.linalg.solve(spread, to @ covariances).swapaxes(-1, -2)
    kept = np.eye(6) - gain @ to
    updated = kept @ covariances @ kept.swapaxes(-1, -2) + gain @ noise @ gain.swapaxes(-1, -2)
    squares = (new * np.linalg.solve(spread, new[..., None])[..., 0]).sum(axis=-1)
    log_likelihood = -0.5 * (squares + np.linalg.slogdet(spread)[1])
    return (means + (gain @ new[..., None])[..., 0], updated), squares, log_likelihood
