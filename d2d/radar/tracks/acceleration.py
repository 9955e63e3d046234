"""The acceleration of a vehicle, by which each estimate is carried to its time.

Positions give the mean velocity over the interval of a pair, which lags behind while the vehicle
accelerates.  How far is known: the estimate z of a round is

    z = theta + D a + e

with the velocity theta and the acceleration a at the round's time, the delay D in s, and the errors
e of the targets.  A Kalman filter of [theta, a], in which the acceleration is a random walk, learns
a from the estimates; carried to its time, an estimate is z - D a.

The acceleration that carries an estimate comes from other estimates only: from those before it, or,
once a log is complete, from all others.  Its error is then independent of e, and the covariance
after the carry is that of e plus D A D' with the covariance A of the acceleration.  Velocities that
the filter itself gives would be smoother, but each would contain the errors of many rounds, and a
vehicle that drives evenly would have far smaller errors than stated.

Errors are still smaller than stated where a vehicle never accelerates, because A covers what it
might do.  If the acceleration changes as the filter assumes, the ANEES is 1.0; at a constant
velocity it is 0.85 at a horizon of 0.3 s and 0.65 at 0.5 s (one radar of 10 Hz), mostly in omega.
"""

from typing import NamedTuple

import numpy as np

from d2d._types import Array
from d2d.radar.motion.doppler import Acceleration

# Of a car, along x and y in m/s^2 and about z in rad/s^2: standard deviations of the acceleration
# where nothing is known of it, and by how much it changes in a second.  The rear axle of a car
# hardly slides: lateral velocities change slowly, and so tell yaw rates from side slip.
UNKNOWN = np.diag(np.square([3.0, 0.3, 0.12]))
JERK = np.diag(np.square([1.0, 0.015, 0.025]))  # variances per s

_FORGOTTEN = 2.0  # s


class Step(NamedTuple):
    """One estimate's step of the filter, from which the smoother goes back."""

    transition: Array | None  # (6, 6) from the step before; None where the filter began anew
    predicted: tuple[Array, Array]  # the state (6,) of [theta, a] and its covariance (6, 6)
    updated: tuple[Array, Array]
    to: Array  # (3, 6), of the state to the estimate
    estimate: Array  # (3,)
    noise: Array  # (3, 3)


class AccelerationFilter:
    """Learns the acceleration from one estimate after the other.

    It begins anew after a gap, when it would know no more of the acceleration than at first.
    """

    def __init__(self) -> None:
        self._time = 0.0
        self._state: tuple[Array, Array] | None = None

    def predict(self, time: float) -> Acceleration | None:
        """The acceleration at a time in s, from all estimates so far; None if it begins anew."""
        predicted, _ = self._predicted(time)
        if predicted is None:
            return None
        state, covariance = predicted
        return Acceleration(state[3:], covariance[3:, 3:])

    def update(
        self, time: float, estimate: Array, delay: Array, noise: Array, carried_by: Acceleration
    ) -> Step:
        """Learn from an estimate (3,) with its delay (3, 3) in s and the covariance of its errors.

        Of these, only those that differ from one estimate to the next count: what all have in
        common does not change an acceleration.  Where the filter begins anew, it begins with the
        acceleration by which the estimate was carried.
        """
        to = np.hstack([np.eye(3), delay])
        predicted, transition = self._predicted(time)
        if predicted is None:
            value, own = carried_by
            late = delay @ own
            covariance = np.block([[noise + late @ delay.T, -late], [-late.T, own]])
            state = np.concatenate([estimate - delay @ value, value])
            predicted = updated = state, covariance
        else:
            updated = _updated(*predicted, to, estimate, noise)
        self._time, self._state = time, updated
        return Step(transition, predicted, updated, to, estimate, noise)

    def _predicted(self, time: float) -> tuple[tuple[Array, Array] | None, Array | None]:
        """The state at a time, and the transition to it; None for both if it is to begin anew."""
        passed = time - self._time
        if self._state is None or passed > _FORGOTTEN:
            return None, None
        transition = np.eye(6)
        transition.flat[3:21:7] = passed
        state, covariance = self._state
        covariance = transition @ covariance @ transition.T
        covariance[3:, 3:] += passed * JERK
        covariance[:3, 3:] += passed**2 / 2.0 * JERK
        covariance[3:, :3] += passed**2 / 2.0 * JERK
        covariance[:3, :3] += passed**3 / 3.0 * JERK
        return (transition @ state, covariance), transition


def accelerations_of_others(steps: list[Step]) -> list[Acceleration]:
    """The acceleration at each estimate, from all others before and after it.

    A smoother goes back over the steps (Rauch, Tung & Striebel 1965); then each estimate's own
    contribution is taken out of the state at its time, as a measurement of negative covariance.
    """
    found: list[Acceleration] = []
    after: tuple[Array, Array] | None = None
    for step, later in zip(reversed(steps), [None, *reversed(steps)], strict=False):
        state, covariance = step.updated
        if later is not None and later.transition is not None and after is not None:
            gain = np.linalg.solve(later.predicted[1], later.transition @ covariance).T
            state = state + gain @ (after[0] - later.predicted[0])
            covariance = covariance + gain @ (after[1] - later.predicted[1]) @ gain.T
        after = state, covariance
        alone = later is None or later.transition is None
        if alone and step.transition is None:
            found.append(Acceleration(state[3:], covariance[3:, 3:]))
            continue
        spread = step.to @ covariance @ step.to.T - step.noise
        gain = np.linalg.solve(spread, step.to @ covariance).T
        value = state + gain @ (step.estimate - step.to @ state)
        rest = covariance - gain @ spread @ gain.T
        rest = 0.5 * (rest + rest.T)[3:, 3:]
        if np.linalg.eigvalsh(rest)[0] > 0.0:
            found.append(Acceleration(value[3:], rest))
        else:  # the difference is lost in rounding; those before are others, too
            found.append(Acceleration(step.predicted[0][3:], step.predicted[1][3:, 3:]))
    return found[::-1]


def _updated(
    state: Array, covariance: Array, to: Array, value: Array, noise: Array
) -> tuple[Array, Array]:
    """State and covariance after a measurement, in the form that stays definite (Joseph)."""
    gain = np.linalg.solve(to @ covariance @ to.T + noise, to @ covariance).T
    kept = np.eye(len(state)) - gain @ to
    updated = kept @ covariance @ kept.T + gain @ noise @ gain.T
    return state + gain @ (value - to @ state), updated
