"""The Kalman filter of a track, which does not learn the errors that the targets share.

Its state x = [v, a] is the velocity of the vehicle, along its axes, and the acceleration, a random
walk.  The estimate of a round is a `FilterInput`,

    z = v + (delay - lag s_lag) a + slow s + n    =: H x + G s + n

with white noise n and the budget's slow errors s, each of which has the variance one and a
correlation that falls to 1/e within `PERSISTENCE`.  Learnt, they would soak up what the vehicle
does in a bend.  So they are *considered* (Schmidt 1966): the covariance P of x and its covariance C
with s are those of the errors in truth, but s is never estimated.  With S = H P H' + H C G' +
G C' H' + G G' + R, an estimate changes

    K = (P H' + C G') S^-1      x + K (z - H x)      P - K S K'      C - K (H C + G)

and a time dt, with k = exp(-dt / PERSISTENCE),

    F x      F P F' + Q      k F C

Positions show the mean velocity over an interval h, which the delay of h / 2 explains for an even
acceleration.  A jerk adds its variance times h^3 / 20, which lasts for 5 h / 9: to estimates that
are nearer together it adds more.  A smoother knows the jerk; an even one acts like the acceleration
at h / 3 before the end of the interval.

How fast the acceleration changes depends on the road.  Three such filters run side by side; each
weighs as much as it predicts the estimates, and what they know is mixed before each prediction, as
the driver may have changed the mode (interacting multiple models: Blom & Bar-Shalom 1988).
"""

from typing import NamedTuple

import numpy as np

from d2d._types import Array
from d2d.radar.motion.doppler import Acceleration
from d2d.radar.tracks.filter_input import FilterInput
from d2d.radar.tracks.gyro import MeanRate

# Of a car, along x and y in m/s^2 and about z in rad/s^2: standard deviations of the acceleration
# where nothing is known of it (twice the RMS on seven drives), and of its change in a second of
# even driving.  The rear axle hardly slides, which tells yaw rates from side slip.
UNKNOWN = np.diag(np.square([1.3, 0.09, 0.12]))
UNSEEN = Acceleration(np.zeros(3), UNKNOWN)
JERK = np.diag(np.square([1.5, 0.0225, 0.0375]))  # variances per s

# Evenly, in bends, at corners: times JERK.  One alone loses 0.05 of the seven drives' log score.
JERK_SCALES = np.array([1.0, 10.0, 100.0])
_MODE_DURATION = 5.0  # s on average; 2 to 60 s are as good
PERSISTENCE = 15.0  # s: errors of v_x on a RadarScenes drive correlate by 0.54 after 7.5 s
MEMORY = 2.0  # s, after which an acceleration is forgotten
_GUESSED = 2.0  # s, for which acceleration, side slip and yaw rate last without an estimate
USUAL = np.diag(np.square([0.0, 0.1, 0.1]))  # of side slip in m/s and yaw rate in rad/s, on a road
Bias = tuple[float, float]  # of a gyro, its mean and variance
_IMPLAUSIBLE = 12.0  # standard deviations, by which no estimate of a vehicle surprises


class Belief(NamedTuple):
    """The Gaussian errors of a state with k considered errors; leading axes are modes."""

    mean: Array  # (..., n) of [v, a], and of a gyro's bias: n is 6 or 7
    covariance: Array  # (..., n, n)
    cross: Array  # (..., n, k), covariance with the slow errors

    @property
    def remainder(self) -> Array:
        """The covariance (..., n, n) of the state if the slow errors were known."""
        return self.covariance - self.cross @ self.cross.swapaxes(-1, -2)

    def combined(self, shares: Array) -> "Belief":
        """The moments of mixtures of the m modes with the shares (..., m)."""
        mean = (shares[..., None, :] @ self.mean)[..., 0, :]
        apart = self.mean - mean[..., None, :]
        covariance = _weighted(shares, self.covariance)
        covariance += (shares[..., None] * apart).swapaxes(-1, -2) @ apart
        covariance = 0.5 * (covariance + covariance.swapaxes(-1, -2))
        return Belief(mean, covariance, _weighted(shares, self.cross))


def _weighted(shares: Array, matrices: Array) -> Array:
    """Means of matrices (..., m, i, j) with the shares (..., m)."""
    return np.asarray(np.einsum("...m,...mij->...ij", shares, matrices))


class Mixture(NamedTuple):
    """The belief of each of m modes after an estimate, or before the next one."""

    time: float  # s
    shares: Array  # (m,) probabilities of the modes
    modes: Belief
    predicted: Array | None = None  # (m,) those before the estimate; None where the filter begins
    passed: float = 0.0  # s, since the estimate before
    transition: Array | None = None  # (n, n + k) of errors, from the estimate before to this one
    given: FilterInput | None = None  # the estimate, and the gyro's yaw rate before it
    rate: MeanRate | None = None

    @property
    def mean(self) -> Array:
        """The mean (n,) of all modes together."""
        return np.asarray(self.shares @ self.modes.mean)

    @property
    def whole(self) -> Belief:
        """The moments of all modes together."""
        return self.modes.combined(self.shares)

    @property
    def errors(self) -> Array:
        """The transition of the state's errors, and their covariances [P, C], (2, n, n + k)."""
        _, covariance, cross = self.whole
        transition = self.transition
        if transition is None:  # at the beginning, nothing but the slow errors is left
            transition = np.hstack([np.zeros_like(covariance), cross])
        return np.stack([transition, np.hstack([covariance, cross])])


def begin(
    time: float, given: FilterInput, acceleration: Acceleration = UNSEEN, bias: Bias | None = None
) -> Mixture:
    """The belief after a first estimate, given what is known of the acceleration.

    With the mean and the variance of a gyro's bias, this is a further state.
    """
    value, own = acceleration
    slow = np.column_stack([given.slow, -given.lag * value])
    late = given.delay @ own
    of_velocity = given.white + slow @ slow.T + late @ given.delay.T
    covariance = np.block([[of_velocity, -late], [-late.T, own]])
    mean = np.concatenate([given.velocity - given.delay @ value, value])
    cross = np.vstack([-slow, np.zeros_like(slow)])
    if bias is not None:
        mean, cross = np.append(mean, bias[0]), np.pad(cross, [(0, 1), (0, 0)])
        covariance = np.pad(covariance, (0, 1))
        covariance[6, 6] = bias[1]
    count = len(JERK_SCALES)
    modes = Belief(*(np.stack([each] * count) for each in (mean, covariance, cross)))
    return Mixture(time, np.full(count, 1.0 / count), modes, given=given)


def bias_of(mixture: Mixture) -> Bias | None:
    """The mean and the variance of a gyro's bias, if it is a state."""
    mean, covariance, _ = mixture.whole
    return (float(mean[6]), float(covariance[6, 6])) if len(mean) > 6 else None


def predict(before: Mixture, time: float) -> Mixture | None:
    """The belief at a later time in s; None if what was learnt is forgotten by then."""
    passed = time - before.time
    if passed > MEMORY:
        return None
    changes = _mode_changes(passed)
    shares = before.shares @ changes
    mixed = before.modes.combined((before.shares[:, None] * changes / shares).T)
    modes = _moved(mixed, passed)
    move = _transition(passed, modes.mean.shape[-1])
    transition = np.hstack([move, np.zeros_like(modes.cross[0])])
    return Mixture(time, shares, modes, shares, passed, transition)


def _mode_changes(passed: float) -> Array:
    """Probabilities (m, m) that the mode in a row is the one in a column after a time in s."""
    count = len(JERK_SCALES)
    lasts = np.exp(-passed / _MODE_DURATION)
    return np.asarray(lasts * np.eye(count) + (1.0 - lasts) / count)


def update(predicted: Mixture, given: FilterInput) -> Mixture:
    """The belief after an estimate at the predicted time, anew where no mode explains it."""
    means = predicted.modes.mean
    to = np.eye(3, means.shape[-1])
    to[:, 3:6] = given.delay
    slow = np.empty((len(means), 3, given.slow.shape[1] + 1))
    slow[..., :-1], slow[..., -1] = given.slow, -given.lag * means[:, 3:6]
    interval = 2.0 * abs(given.delay[2, 2])
    uneven = max(interval / 5.0, interval**2 / (9.0 * predicted.passed))
    uneven *= given.delay @ JERK @ given.delay.T
    white = given.white + JERK_SCALES[:, None, None] * uneven
    found, squares = _updated(predicted, given.velocity, to, slow, white)
    if squares > _IMPLAUSIBLE**2:
        return begin(predicted.time, given, bias=bias_of(predicted))
    return found._replace(given=given)


def update_yaw_rate(predicted: Mixture, given: MeanRate) -> Mixture:
    """The belief after the yaw rate of a gyro, of which the state holds the bias."""
    to = np.array([[0.0, 0.0, 1.0, 0.0, 0.0, given.delay, 1.0]])
    slow = np.zeros((len(predicted.shares), 1, predicted.modes.cross.shape[-1]))
    spread = np.array([[given.variance]])
    return _updated(predicted, np.array([given.value]), to, slow, spread)[0]._replace(rate=given)


def _updated(
    predicted: Mixture, value: Array, to: Array, slow: Array, white: Array
) -> tuple[Mixture, float]:
    """The belief after a measurement (r,) with the matrices H, G of each mode and R.

    Also by how many standard deviations, squared, it differs from the nearest mode's prediction.
    """
    mean, covariance, cross = predicted.modes
    with_state = to @ covariance + slow @ cross.swapaxes(-1, -2)  # (m, r, n), of the measurement
    with_slow = to @ cross + slow  # (m, r, k)
    spread = with_state @ to.T + with_slow @ slow.swapaxes(-1, -2) + white
    innovation = value - mean @ to.T
    given = np.concatenate([with_state, innovation[..., None]], axis=-1)
    solved = np.linalg.solve(spread, given)
    gain = solved[..., :-1].swapaxes(-1, -2)
    squares = (innovation * solved[..., -1]).sum(axis=-1)
    log_likelihood = -0.5 * (squares + np.linalg.slogdet(spread)[1])
    weights = predicted.shares * np.exp(log_likelihood - log_likelihood.max())
    shares = weights / weights.sum()
    covariance = covariance - gain @ with_state
    modes = Belief(
        mean + (gain @ innovation[..., None])[..., 0],
        0.5 * (covariance + covariance.swapaxes(-1, -2)),
        cross - gain @ with_slow,
    )
    found = predicted._replace(shares=shares, modes=modes)
    if predicted.transition is not None:  # the means over the modes of (I - K H) F and -k K G
        size = mean.shape[-1]
        moved = (np.eye(size) - _weighted(shares, gain) @ to) @ predicted.transition
        faded = np.exp(-predicted.passed / PERSISTENCE)
        moved[:, size:] -= faded * _weighted(shares, gain @ slow)
        found = found._replace(transition=moved)
    return found, float(squares.min())


def _moved(belief: Belief, passed: float) -> Belief:
    """The belief of each mode after a time in s."""
    move = _transition(passed, belief.mean.shape[-1])
    walk = np.zeros_like(move)
    walk[:3, :3], walk[3:6, 3:6] = passed**3 / 3.0 * JERK, passed * JERK
    walk[:3, 3:6] = walk[3:6, :3] = passed**2 / 2.0 * JERK
    return Belief(
        belief.mean @ move.T,
        move @ belief.covariance @ move.T + JERK_SCALES[:, None, None] * walk,
        np.exp(-passed / PERSISTENCE) * move @ belief.cross,
    )


def _transition(passed: float, size: int) -> Array:
    """The matrix (size, size) by which a state moves on over a time in s."""
    move = np.eye(size)
    move[[0, 1, 2], [3, 4, 5]] = passed
    return move


def guess(before: Mixture, time: float) -> Mixture:
    """The belief at a later time in s at which nothing was estimated.

    Nobody brakes or turns for long: acceleration, side slip and yaw rate decay and are renewed
    (first-order Gauss-Markov processes).  A vehicle that has slowed down to nothing stands.
    """
    passed = time - before.time
    kept, whole = np.exp(-passed / _GUESSED), before.whole
    move, added = np.eye(len(whole.mean)), np.zeros_like(whole.covariance)
    move[1:3, 1:3] = kept * np.eye(2)
    move[:3, 3:6], move[3:6, 3:6] = _GUESSED * (1.0 - kept) * np.eye(3), kept * np.eye(3)
    moved = _GUESSED**2 * (2.0 * passed / _GUESSED - 4.0 * (1.0 - kept) + 1.0 - kept**2)
    added[:3, :3] = moved * UNKNOWN + (1.0 - kept**2) * USUAL
    added[:3, 3:6] = added[3:6, :3] = _GUESSED * (1.0 - kept) ** 2 * UNKNOWN
    added[3:6, 3:6] = (1.0 - kept**2) * UNKNOWN
    mean = move @ whole.mean
    if mean[0] * whole.mean[0] <= 0.0:
        mean[:6] = 0.0
    cross = np.exp(-passed / PERSISTENCE) * move @ whole.cross
    modes = Belief(mean[None], (move @ whole.covariance @ move.T + added)[None], cross[None])
    transition = np.hstack([move, np.zeros_like(cross)])
    return Mixture(time, np.ones(1), modes, np.ones(1), passed, transition)


def smooth_twice(filtered: list[Mixture]) -> list[Mixture]:
    """The beliefs from all estimates, which are filtered again with the jerks that these show."""
    smoothed, again = smooth_mixtures(filtered), filtered.copy()
    for i, own in enumerate(filtered):
        predicted = None if own.predicted is None else predict(again[i - 1], own.time)
        if predicted is None or own.given is None:
            continue
        if own.rate is not None:
            predicted = update_yaw_rate(predicted, own.rate)
        jerk = (smoothed[i].mean - smoothed[i - 1].mean)[3:6] / own.passed
        uneven = 2.0 / 3.0 * abs(own.given.delay[2, 2]) * own.given.delay @ jerk
        again[i] = update(predicted, own.given._replace(velocity=own.given.velocity + uneven))
    return smooth_mixtures(again)


def smooth_mixtures(filtered: list[Mixture]) -> list[Mixture]:
    """The beliefs from all estimates, before and after each, from those after each.

    The smoother of Rauch, Tung & Striebel (1965) for each pair of successive modes, weighted by how
    probable it is after all (Kim 1994).  Its gains are those for known slow errors (P - C C').
    """
    smoothed = filtered.copy()
    for i in reversed(range(len(filtered) - 1)):
        now, later = filtered[i], smoothed[i + 1]
        if later.predicted is None:
            continue
        changes = _mode_changes(later.passed)
        of_pairs = now.shares[:, None] * changes * (later.shares / later.predicted)
        of_pairs /= of_pairs.sum()
        shares = of_pairs.sum(axis=1)
        before = Belief(*(each[:, None] for each in now.modes))
        ahead = _moved(before, later.passed)
        move = _transition(later.passed, len(now.mean))
        gain = np.linalg.solve(ahead.remainder, move @ before.remainder)
        modes = _smoothed(before, ahead, later.modes, np.asarray(gain.swapaxes(-1, -2)))
        smoothed[i] = now._replace(shares=shares, modes=modes.combined(of_pairs / shares[:, None]))
        back = np.einsum("jk,jkab->ab", of_pairs, gain)
        smoothed[i + 1] = later._replace(transition=_forward(smoothed[i], later, back))
    return smoothed


def _smoothed(now: Belief, ahead: Belief, later: Belief, gain: Array) -> Belief:
    """The beliefs (m, 1) of modes, improved by those (m,) of later ones, for each pair."""
    cross = now.cross + gain @ (later.cross - ahead.cross)
    rest = now.remainder + gain @ (later.remainder - ahead.remainder) @ gain.swapaxes(-1, -2)
    return Belief(
        now.mean + (gain @ (later.mean - ahead.mean)[..., None])[..., 0],
        0.5 * (rest + rest.swapaxes(-1, -2)) + cross @ cross.swapaxes(-1, -2),
        cross,
    )


def _forward(now: Mixture, later: Mixture, back: Array) -> Array:
    """The transition (n, n + k) of the errors of smoothed beliefs, for a transposed gain (n, n)."""
    first, second = now.whole, later.whole
    own = np.linalg.solve(first.remainder, back.T @ second.remainder).T
    kept = np.exp((now.time - later.time) / PERSISTENCE)
    return np.hstack([own, kept * second.cross - own @ first.cross])
