"""The intervals of a drive one after the other, each started at the last accepted velocity."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from d2d._checks import check_flag, check_instance
from d2d._types import Array
from d2d.problem import Problem
from d2d.radar.motion.covariance import apply_budget
from d2d.radar.motion.estimate import check_velocity, estimate_velocity
from d2d.radar.motion.pairs import ScanPair, repeats
from d2d.radar.scans.budget import CovarianceParts, ErrorBudget
from d2d.radar.tracks.carry import accelerations, with_lag
from d2d.radar.tracks.contradiction import warn_of_contradiction
from d2d.radar.tracks.limits import State, VehicleLimits
from d2d.radar.tracks.progress import counted
from d2d.radar.tracks.track import Track
from d2d.registration import Estimate

DEFAULT_LIMITS = VehicleLimits()
# The wide outlier component has a separate optimum, far from where the scans overlap: all
# targets are outliers there, and the Hessian is positive definite.  An optimum at which the mean
# inlier probability of the targets is below this is not accepted as the vehicle's motion.
MIN_EXPLAINED = 0.1
# A velocity has three components.  An optimum that rests on fewer targets is accidental, however
# large a share of the scan they are.
MIN_AGREEING = 2.5  # sum of the inlier probabilities
# rad; a vehicle that drives in a circle between two scans is back where it was: scans of one place
# then fit at any speed, as they do where times are in another unit
MAX_TURN = float(np.pi)
# A wrong optimum rarely explains more than half of the targets (chapter 9).  One that explains at
# least this fraction is accepted without looking for another.
WELL_EXPLAINED = 0.6


class Interval(NamedTuple):
    """The cost of one interval's velocity, and the pairs of scans that it sums."""

    problem: Problem
    pairs: Sequence[ScanPair]

    @property
    def targets(self) -> int:
        """Number of targets of the current scans."""
        return sum(current.size for _, current, _ in self.pairs)


class Search(NamedTuple):
    """How the intervals of a drive are bound and where their search begins.

    ``bind(i)`` gives interval i, or None if there is nothing to estimate; ``begin(i)`` gives starts
    (S, 3) that need no last velocity.
    """

    bind: Callable[[int], Interval | None]
    begin: Callable[[int], Array]
    scales: Sequence[float]


def check_tracking(
    budget: ErrorBudget | None, limits: VehicleLimits | None, progress: bool | None
) -> None:
    """Raise a ValueError unless the three are what their names say, or None."""
    if budget is not None:
        check_instance("budget", budget, ErrorBudget)
    if limits is not None:
        check_instance("limits", limits, VehicleLimits)
    if progress is not None:
        check_flag("progress", progress)


def is_good(estimate: Estimate) -> bool:
    """Whether an estimate is an optimum that does not reject nearly all targets."""
    return bool(estimate.converged) and float(estimate.inliers) >= MIN_EXPLAINED


def is_convincing(estimate: Estimate) -> bool:
    """Whether an estimate explains so many targets that no other optimum is looked for."""
    return bool(estimate.converged) and float(estimate.inliers) >= WELL_EXPLAINED


def follow(
    times: Array,
    search: Search,
    initial: ArrayLike | None,
    budget: ErrorBudget | None,
    limits: VehicleLimits | None,
    progress: bool | None,
) -> Track:
    """Estimate the n - 1 intervals between n times in turn."""
    velocity = None if initial is None else check_velocity(initial)
    last: State | None = None
    count = len(times) - 1
    theta, covariance = np.zeros((count, 3)), np.full((count, 3, 3), np.nan)
    parts, delays = np.full((3, count, 3, 3), np.nan), np.zeros((count, 3, 3))
    inliers, targets = np.full(count, np.nan), np.zeros(count, dtype=np.int64)
    reasons = [""] * count
    for i in counted(count, progress):
        interval = search.bind(i)
        if interval is None:
            reasons[i] = "a scan without targets"
        else:
            estimate = _estimate(search, i, interval.problem, velocity)
            inliers[i], targets[i] = float(estimate.inliers), interval.targets
            reasons[i] = _reason(estimate, interval)
        if interval is not None and not reasons[i]:
            stated = estimate.covariance
            if budget is not None:
                parts[:, i], delays[i] = apply_budget(
                    interval.problem, estimate, interval.pairs, budget, float(times[i + 1])
                )
                stated = parts[:, i].sum(axis=0)
            state = State(times[i + 1], estimate.theta, stated)
            if not np.isfinite(stated).all():
                reasons[i] = "a covariance that is not finite"
            elif limits is not None:
                reasons[i] = limits.exceeded(state, last)
            if not reasons[i]:
                last, velocity, covariance[i] = state, estimate.theta, stated
        theta[i] = 0.0 if velocity is None else velocity
    converged = np.array([not reason for reason in reasons])
    track = Track(
        times[1:], np.diff(times), theta, covariance, converged, np.array(reasons), targets, inliers
    )
    _check_positions(track, search)
    return track if budget is None else _with_budget(track, parts, delays, budget.lag)


def _estimate(search: Search, i: int, problem: Problem, velocity: Array | None) -> Estimate:
    """The optimum near the last velocity; where it is doubtful, the better of two."""
    start = search.begin(i) if velocity is None else velocity
    first = estimate_velocity(problem, start, search.scales)
    if velocity is None or is_convincing(first):
        return first
    second = estimate_velocity(problem, search.begin(i), search.scales)
    return min(first, second, key=lambda each: (not is_good(each), float(each.value)))


def _reason(estimate: Estimate, interval: Interval) -> str:
    """Why an estimate is not accepted; empty if nothing speaks against it."""
    if any(repeats(previous, current) for previous, current, _ in interval.pairs):
        return "a scan that repeats an earlier one"
    if not estimate.converged:
        return "no optimum near the start"
    if not is_good(estimate):
        return f"an optimum that rejects {1.0 - float(estimate.inliers):.0%} of the targets"
    agreeing = interval.targets * float(estimate.inliers)
    if agreeing < MIN_AGREEING:
        return f"an optimum that rests on {agreeing:.1f} targets"
    turn = abs(float(estimate.theta[2])) * max(pair.interval for pair in interval.problem.pairs)
    if turn > MAX_TURN:
        return f"a turn of {np.rad2deg(turn):.0f} deg between scans"
    return ""


def _with_budget(track: Track, parts: Array, delays: Array, lag: float) -> Track:
    """The track with its velocities at its times, and the parts of the covariances with the lag."""
    good = track.converged
    parts[:, ~good] = np.nan
    theta, slopes = track.theta.copy(), np.zeros_like(track.theta)
    # velocities that are held, or never began, show no acceleration
    times, shown = track.times[good], track.theta[good]
    theta[good] -= np.einsum("nij,nj->ni", delays[good], accelerations(times, shown))
    slopes[good] = accelerations(times, theta[good])
    last = np.maximum.accumulate(np.where(good, np.arange(len(good)), -1))
    held = ~good & (last >= 0)
    theta[held] = theta[last[held]]
    complete = with_lag(CovarianceParts(*parts), slopes, lag)
    return replace(track, theta=theta, covariance=complete.total, parts=complete)


def _check_positions(track: Track, search: Search) -> None:
    """Warn if the positions contradict the Doppler velocities of the accepted intervals."""
    accepted = np.flatnonzero(track.converged)

    def bind(i: int) -> Problem | None:
        interval = search.bind(int(accepted[i]))
        if interval is None or interval.problem.pairs[0].measurement is None:
            return None
        return interval.problem

    warn_of_contradiction(track.theta[accepted], bind)
