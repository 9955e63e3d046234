"""Ego-motion over a whole drive: round after round, each started at the last accepted velocity."""

import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TextIO, Unpack

import numpy as np
from numpy.typing import ArrayLike

from d2d._checks import check_instance
from d2d._types import Array
from d2d.problem import Problem
from d2d.radar.motion.covariance import apply_budget
from d2d.radar.motion.doppler import doppler_starts
from d2d.radar.motion.estimate import check_velocity, estimate_velocity
from d2d.radar.motion.model import EgoMotionModel, EstimationOptions, split_options
from d2d.radar.motion.pairs import ScanPair, problem_of
from d2d.radar.scans.budget import CovarianceParts, ErrorBudget
from d2d.radar.scans.scan import RadarScan
from d2d.radar.tracks.carry import accelerations
from d2d.radar.tracks.contradiction import warn_of_contradiction
from d2d.radar.tracks.limits import State, VehicleLimits
from d2d.radar.tracks.rounds import (
    MAX_INTERVAL,
    Sensors,
    check_intervals,
    check_sensors,
    check_separation,
    round_pairs,
    rounds,
)
from d2d.radar.tracks.track import Track
from d2d.registration import Estimate

DEFAULT_LIMITS = VehicleLimits()
# The wide outlier component has a separate optimum, far from where the scans overlap: all
# targets are outliers there, and the Hessian is positive definite.  An optimum at which the mean
# inlier probability of the targets is below this is not accepted as the vehicle's motion.
MIN_EXPLAINED = 0.1
# A velocity has three components.  An optimum that rests on fewer targets is accidental, however
# large a share of the scan they are.
_MIN_AGREEING = 2.5  # sum of the inlier probabilities
# rad; a vehicle that drives in a circle between two scans is back where it was: scans of one place
# then fit at any speed, as they do where times are in another unit
_MAX_TURN = float(np.pi)
# A wrong optimum rarely explains more than half of the targets (chapter 9).  One that explains at
# least this fraction is accepted without looking for another.
_WELL_EXPLAINED = 0.6
_MOVING = 0.5  # m/s; at a standstill a coarse radar may measure the same twice
_BAR_DELAY = 2.0  # s, so that short tracks show no progress bar


def track(
    sensors: Sensors,
    *,
    baseline: int = 1,
    horizon: float | None = None,
    initial: ArrayLike | None = None,
    max_interval: float = MAX_INTERVAL,
    budget: ErrorBudget | None = None,
    limits: VehicleLimits | None = DEFAULT_LIMITS,
    progress: bool | None = None,
    **options: Unpack[EstimationOptions],
) -> Track:
    """Ego-motion over a whole drive from one sensor, or from several that need not be synchronised.

    The scans of all sensors, in time order, are divided into rounds.  A new round begins whenever a
    sensor already has a scan in the current one; scans of the same time stay together.  With one
    sensor, each scan is a round.  Each round after the first gives one estimate, at the mean time
    of its scans.  Pairs with an empty scan are left out.

    An estimate fails if there is no pair left, a scan repeats an earlier one target by target while
    the sensor moves, the cost has no optimum near the start, the optimum rejects nearly all targets
    (mean inlier probability below 0.1) or turns the vehicle by more than half a turn between two
    scans, or no vehicle could move like that.  It is then marked as not converged, with the reason,
    and the track goes on.  The search starts at the last accepted velocity.  If that fails or does
    not explain most of the targets (mean inlier probability below 0.6), the round is estimated once
    more without it; of two acceptable optima the lower wins.

    Raises a ``ValueError`` if something is not a sensor, two have a scan in common, scans are out
    of time order or too far apart, there are fewer than two rounds, ``horizon`` is given beside
    ``baseline``, or another argument is invalid.

    Warns if in most intervals the positions alone fit another velocity clearly better than the one
    that the Doppler velocities give: the opposite one (a wrong sign), one 3.6 times slower (km/h),
    or a faster one (velocities already compensated for the ego-motion).

    Parameters
    ----------
    sensors : Recording, (scans, Mounting), or a sequence or mapping of them
        The sensor or sensors of the vehicle, each with its scans in strictly increasing time; a
        simulated `Drive` will do, too.  Error messages use the names of a mapping.
    baseline : int
        Each scan is registered with the one of its sensor this many scans before, or with the first
        one.  Over a longer interval, the same position error causes a smaller velocity error, as
        long as the velocity is constant and the targets stay in view.
    horizon : float, s, optional
        The same as a time: each scan is registered with the one whose time is nearest to this long
        before.  On the road the covariance was most credible at 0.3 s, or close to it, and the yaw
        rate became more accurate up to 0.5 s (chapter 8b).
    initial : (3,) array, optional
        Start [v_x, v_y, omega] of the first estimate.
    max_interval : float, s
        Longest time between two scans of a sensor, and between two rounds.  Times in milli- or
        microseconds exceed it; a recording with longer gaps needs a larger one.
    budget : ErrorBudget, optional
        Errors that the targets of a sensor share; each sensor has its own, of the same standard
        deviations.  With a budget, also an empty one, the covariance is propagated from the
        targets' errors, and the velocities are those at the track's times.  Without one, the
        covariance is the inverse Hessian.
    limits : VehicleLimits, optional
        What the vehicle can do; None accepts any motion.
    progress : bool, optional
        Whether a bar on the standard error counts the estimates, for which tqdm must be installed.
        By default, one appears after two seconds if that is a terminal; not in a notebook.
    **options
        As for `estimate_ego_motion`.

    Examples
    --------
    >>> import numpy as np
    >>> from d2d.radar import simulate_drive, track
    >>> drive = simulate_drive(np.random.default_rng(0), duration=2.0)
    >>> driven = track(drive)  # or track((drive.scans, drive.mounting))
    >>> bool(driven.converged.all()), driven.theta.shape
    (True, (20, 3))
    >>> float(driven.poses()[-1, 0].round(1))  # m ahead
    6.2
    """
    check_separation(baseline, horizon)
    if budget is not None:
        check_instance("budget", budget, ErrorBudget)
    model, scales = split_options(options)
    velocity = None if initial is None else check_velocity(initial)
    drives = check_sensors(sensors, max_interval)
    groups = rounds(scans for scans, _ in drives)
    if len(groups) < 2:
        raise ValueError(
            "sensors must have at least two rounds of scans (of one sensor: two scans), but have "
            f"{len(groups)}"
        )
    times = np.array([np.mean([drives[s][0][i].time for s, i in group]) for group in groups])
    check_intervals("the rounds of all sensors", times, max_interval)

    def pairs(i: int) -> list[ScanPair]:
        return round_pairs(drives, groups[i + 1], baseline, horizon)

    if limits is not None:
        limits = limits.for_doppler(model.doppler)
    follower = Follower(model, scales, velocity, budget, limits)
    counted = _counted(len(groups) - 1, progress)
    rows = [follower.follow(float(times[i + 1]), pairs(i)) for i in counted]
    reasons = np.array([row.reason for row in rows])
    driven = Track(
        times[1:],
        np.diff(times),
        np.array([row.theta for row in rows]),
        np.array([row.covariance for row in rows]),
        reasons == "",
        reasons,
        np.array([row.targets for row in rows]),
        np.array([row.inliers for row in rows]),
    )
    if model.doppler:
        accepted = np.flatnonzero(driven.converged)
        warn_of_contradiction(
            driven.theta[accepted], lambda i: problem_of(pairs(int(accepted[i])), model)
        )
    return driven if budget is None else _with_budget(driven, rows, budget.lag)


class Row(NamedTuple):
    """What a round adds to a track."""

    theta: Array  # (3,); the last accepted one if this one is not
    covariance: Array = np.full((3, 3), np.nan)
    reason: str = ""  # why it is not accepted
    targets: int = 0
    inliers: float = np.nan
    parts: Array = np.full((3, 3, 3), np.nan)  # of the covariance, if there is a budget
    delay: Array = np.zeros((3, 3))  # s; times the acceleration, how far theta is from its time


@dataclass
class Follower:
    """Estimates the velocity of one round after the other, and remembers the last accepted one.

    Nothing that it needs is later than the round, so that rounds can come as they are measured.
    """

    model: EgoMotionModel
    scales: Sequence[float]
    velocity: Array | None  # at which the next search starts, if it is known
    budget: ErrorBudget | None
    limits: VehicleLimits | None
    last: State | None = None

    def follow(self, time: float, pairs: Sequence[ScanPair]) -> Row:
        """The next row of a track, from the pairs of scans of a round at ``time``."""
        if not pairs:
            return self._held("a scan without targets")
        problem = problem_of(pairs, self.model)
        estimate = self._estimate(problem, pairs)
        seen = sum(pair.current.size for pair in pairs), float(estimate.inliers)
        reason = _doubt(estimate, pairs)
        if reason:
            return self._held(reason, *seen)
        row = Row(estimate.theta, estimate.covariance, "", *seen)
        if self.budget is not None:
            parts, delay = apply_budget(problem, estimate, pairs, self.budget, time)
            row = row._replace(covariance=parts.total, parts=np.stack(parts), delay=delay)
        state = State(time, row.theta, row.covariance)
        if not np.isfinite(state.covariance).all():
            reason = "a covariance that is not finite"
        elif self.limits is not None:
            reason = self.limits.exceeded(state, self.last)
        if reason:
            return self._held(reason, *seen)
        self.last, self.velocity = state, state.theta
        return row

    def _held(self, reason: str, targets: int = 0, inliers: float = np.nan) -> Row:
        """The row of a round that gives no estimate."""
        theta = np.zeros(3) if self.velocity is None else self.velocity
        return Row(theta, reason=reason, targets=targets, inliers=inliers)

    def _estimate(self, problem: Problem, pairs: Sequence[ScanPair]) -> Estimate:
        """The optimum near the last velocity; where it is doubtful, the better of two."""
        near = None
        if self.velocity is not None:
            near = estimate_velocity(problem, self.velocity, self.scales)
            if near.converged and float(near.inliers) >= _WELL_EXPLAINED:
                return near
        starts = doppler_starts([(pair.current, pair.mounting) for pair in pairs])
        anew = estimate_velocity(problem, starts, self.scales)
        if near is None:
            return anew
        return min(near, anew, key=lambda each: (not _is_good(each), float(each.value)))


def _is_good(estimate: Estimate) -> bool:
    """Whether an estimate is an optimum that does not reject nearly all targets."""
    return bool(estimate.converged) and float(estimate.inliers) >= MIN_EXPLAINED


def _doubt(estimate: Estimate, pairs: Sequence[ScanPair]) -> str:
    """Why an estimate is not accepted, whatever its covariance; empty if nothing is against it."""
    if any(_repeats(pair.previous, pair.current) for pair in pairs):
        return "a scan that repeats an earlier one"
    if not estimate.converged:
        return "no optimum near the start"
    if not _is_good(estimate):
        return f"an optimum that rejects {1.0 - float(estimate.inliers):.0%} of the targets"
    agreeing = sum(pair.current.size for pair in pairs) * float(estimate.inliers)
    if agreeing < _MIN_AGREEING:
        return f"an optimum that rests on {agreeing:.1f} targets"
    turn = abs(float(estimate.theta[2])) * max(pair.interval for pair in pairs)
    if turn > _MAX_TURN:
        return f"a turn of {np.rad2deg(turn):.0f} deg between scans"
    return ""


def _repeats(previous: RadarScan, current: RadarScan) -> bool:
    """Whether a scan has the targets of an earlier one although the sensor moves.

    A frozen sensor, or a message that is delivered twice, gets a new time: its positions say that
    the vehicle stands still.
    """
    measured = ("range", "azimuth", "doppler")
    return (
        all(np.array_equal(getattr(previous, name), getattr(current, name)) for name in measured)
        and float(np.median(np.abs(current.doppler))) > _MOVING
    )


def _with_budget(track: Track, rows: Sequence[Row], lag: float) -> Track:
    """The track with its velocities at its times, and the parts of the covariances with the lag."""
    good = track.converged
    delays = np.array([row.delay for row in rows])
    theta, slopes = track.theta.copy(), np.zeros_like(track.theta)
    # velocities that are held, or never began, show no acceleration
    times, shown = track.times[good], track.theta[good]
    theta[good] -= np.einsum("nij,nj->ni", delays[good], accelerations(times, shown))
    slopes[good] = accelerations(times, theta[good])
    last = np.maximum.accumulate(np.where(good, np.arange(len(good)), -1))
    held = ~good & (last >= 0)
    theta[held] = theta[last[held]]
    parts = CovarianceParts(*np.stack([row.parts for row in rows], axis=1))
    moved = lag * slopes
    late = parts.systematic + moved[:, :, None] * moved[:, None, :]
    parts = parts._replace(systematic=late)
    return replace(track, theta=theta, covariance=parts.total, parts=parts)


def _counted(count: int, progress: bool | None) -> Iterable[int]:
    """The numbers 0 to count - 1, with a progress bar on the standard error.

    True shows it at once, False never, and None after two seconds if that is a terminal and tqdm
    is installed.
    """
    steps = range(count)
    if progress is False or (progress is None and not _on_terminal()):
        return steps
    try:
        from tqdm import tqdm
    except ModuleNotFoundError:
        if progress is None:
            return steps
        raise ModuleNotFoundError(
            "progress=True needs tqdm, which is not installed: pip install tqdm"
        ) from None
    bar: Iterable[int] = tqdm(steps, unit="estimate", delay=0.0 if progress else _BAR_DELAY)
    return bar


def _on_terminal() -> bool:
    """Whether somebody may be watching; a program without a console has no standard error."""
    stream: TextIO | None = sys.stderr
    return stream is not None and stream.isatty()
