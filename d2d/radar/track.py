"""Ego-motion over a whole drive."""

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from d2d import rigid
from d2d._checks import (
    check_count,
    check_finite,
    check_members,
    check_path,
    check_positive,
    check_scalar,
)
from d2d._types import Array
from d2d.problem import Problem
from d2d.radar.doppler import doppler_starts
from d2d.radar.ego_motion import check_velocity, estimate_velocity
from d2d.radar.options import EstimationOptions, split_options
from d2d.radar.scan import Mounting, RadarScan
from d2d.radar.scan_pair import scan_pair
from d2d.registration import Estimate

# The wide outlier component has an optimum of its own, far from where the scans overlap: all
# targets are outliers there, and the Hessian is positive definite.  An optimum at which the mean
# inlier probability of the targets is below this is not accepted as the vehicle's motion.
MIN_EXPLAINED = 0.1
# Times between two scans that are longer than this are taken to be in another unit.
MAX_INTERVAL = 60.0  # s
# A wrong optimum rarely explains more than half of the targets (chapter 9).  One that explains at
# least this fraction is accepted without looking for another.
WELL_EXPLAINED = 0.6


@dataclass(frozen=True, eq=False)
class Track:
    """The motion along a drive, one row for each scan (or round of scans) after the first.

    Attributes
    ----------
    times : (n,) array, s
        Time of each current scan.
    intervals : (n,) array, s
        Time since the scan before.
    theta : (n, 3) array
        Velocity [v_x, v_y, omega] in m/s, m/s, rad/s.  Where not converged, it is the last
        converged one or, before any has converged, the initial velocity or zero.
    covariance : (n, 3, 3) array
        Covariance of ``theta``; nan where not converged.
    converged : (n,) array of bool
        Whether an optimum was found and accepted.
    """

    times: Array
    intervals: Array
    theta: Array
    covariance: Array
    converged: NDArray[np.bool_]

    def poses(self, start: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
        """The path driven: (n + 1, 3) poses [x, y, yaw] in m, m, rad, beginning at ``start``.

        Pose i + 1 is pose i followed by the motion of pair i, exp(tau theta).
        """
        return integrate(self.theta, self.intervals, start)

    def write_tum(self, path: str | os.PathLike[str], start: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """Write the poses as a TUM trajectory file, one line "t x y z qx qy qz qw" per pose.

        `evo` and other tools read this format; t is in s, and the vehicle stays in the plane z = 0.

        Parameters
        ----------
        path : path
            Path of the file; an existing file is overwritten, and a leading ``~`` is replaced by
            the home folder.
        start : (3,) array, m, m, rad
            The first pose, as for `poses`.

        Raises
        ------
        ValueError
            If ``path`` is not a path or ``start`` is not a pose; the message names the argument.
        OSError
            If the file cannot be written.
        """
        x, y, yaw = self.poses(start).T
        first = self.times[:1] - self.intervals[:1]
        zero = np.zeros_like(x)
        turn = np.sin(0.5 * yaw), np.cos(0.5 * yaw)
        columns = [np.concatenate([first, self.times]), x, y, zero, zero, zero, *turn]
        np.savetxt(check_path("path", path), np.column_stack(columns), "%.9f")


def integrate(theta: ArrayLike, intervals: ArrayLike, start: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """Chain the motions at theta (n, 3) over intervals (n,) to poses (n + 1, 3) [x, y, yaw]."""
    velocities, times = rigid.motion("theta", theta, 2), check_finite("intervals", intervals)
    if velocities.ndim != 2 or times.shape != velocities.shape[:1]:
        raise ValueError(
            f"theta and intervals must have the shapes (n, 3) and (n,), but have "
            f"{velocities.shape} and {times.shape}"
        )
    twists = velocities * times[:, np.newaxis]
    steps = rigid.exponential(twists)
    first = rigid.motion("start", start, 2)
    if first.shape != (3,):
        raise ValueError(f"start must have the shape (3,), but has {first.shape}")
    yaw = first[2] + np.concatenate([[0.0], np.cumsum(steps[:, 2])])
    moved = np.einsum("nij,nj->ni", rigid.rotation(yaw[:-1]), steps[:, :2])
    position = first[:2] + np.concatenate([np.zeros((1, 2)), np.cumsum(moved, axis=0)])
    return np.column_stack([position, yaw])


def track(
    scans: Iterable[RadarScan],
    mounting: Mounting,
    *,
    baseline: int = 1,
    initial: ArrayLike | None = None,
    max_interval: float = MAX_INTERVAL,
    **options: Unpack[EstimationOptions],
) -> Track:
    """Ego-motion over a whole drive, with each estimate started at the last converged velocity.

    Parameters
    ----------
    scans : iterable of RadarScan
        At least two scans, in strictly increasing time.
    mounting : Mounting
    baseline : int
        Each scan is registered with the one this many scans before, or with the first scan.  Over a
        longer interval, the same position error causes a smaller velocity error, as long as the
        velocity is constant and the targets stay in view.
    initial : (3,) array, optional
        Start [v_x, v_y, omega] of the first estimate.
    max_interval : float, s
        Longest time between two scans.  Times in milli- or microseconds exceed it; a recording
        with longer gaps needs a larger one.
    **options
        ``doppler``, ``outlier``, ``first_order`` and ``scales``, as for `estimate_ego_motion`.

    Returns
    -------
    Track
        An estimate fails if a scan is empty, the cost has no optimum near the start, or the optimum
        rejects nearly all targets (mean inlier probability below 0.1).  It is then marked as not
        converged, and the track goes on.  If the estimate from the last velocity would fail or does
        not explain most of the targets (mean inlier probability below 0.6), the pair is estimated
        once more without it; of two acceptable optima the lower wins.

    Raises
    ------
    ValueError
        If there are fewer than two scans, the scans are out of time order or farther apart than
        ``max_interval``, ``baseline`` is below 1 or another argument is invalid; the message names
        the argument.

    Examples
    --------
    >>> import numpy as np
    >>> from d2d.radar import simulate_drive, track
    >>> drive = simulate_drive(np.random.default_rng(0), duration=2.0)
    >>> driven = track(drive.scans, drive.mounting)
    >>> bool(driven.converged.all()), driven.theta.shape
    (True, (20, 3))
    >>> float(driven.poses()[-1, 0].round(1))  # m ahead
    6.2
    """
    scans = check_members("scans", scans, RadarScan)
    if len(scans) < 2:
        raise ValueError(f"scans must hold at least two scans, but holds {len(scans)}")
    check_count("baseline", baseline)
    times = increasing("scans", scans, max_interval)
    model, scales = split_options(options)

    def solve(i: int, start: Array | None) -> Attempt | None:
        previous, current = scans[max(i + 1 - baseline, 0)], scans[i + 1]
        if not (previous.size and current.size):
            return None
        problem = model.problem([scan_pair(previous, current, mounting, model)])
        begin = doppler_starts(current, mounting) if start is None else start
        return attempt_at(problem, begin, scales)

    return follow(times, solve, initial)


def increasing(name: str, scans: Sequence[RadarScan], max_interval: float) -> Array:
    """The scans' times (n,) in s, strictly increasing and at most ``max_interval`` apart.

    Raises a ValueError if they are not.
    """
    times = np.array([scan.time for scan in scans])
    intervals = np.diff(times)
    if not (intervals > 0).all():
        late = int(np.argmin(intervals > 0)) + 1
        raise ValueError(
            f"{name} must be in strictly increasing time, but scan {late} is at "
            f"{times[late]:.6f} s after {times[late - 1]:.6f} s"
        )
    check_intervals(name, times, max_interval)
    return times


def check_intervals(name: str, times: Array, max_interval: float) -> None:
    """Raise a ValueError if times (n,) in s are farther apart than ``max_interval``."""
    longest = float(check_positive("max_interval", check_scalar("max_interval", max_interval)))
    intervals = np.diff(times)
    if (intervals > longest).any():
        far = int(np.argmax(intervals))
        raise ValueError(
            f"{name} must have times in seconds (s), at most max_interval = {longest:g} apart, but "
            f"{times[far + 1]:.6f} comes after {times[far]:.6f}; are these milli- or microseconds?"
        )


class Attempt(NamedTuple):
    """An estimate for one interval, and how well it explains the targets."""

    estimate: Estimate
    explained: float  # mean inlier probability of the targets

    @property
    def good(self) -> bool:
        """Whether the estimate is an optimum that does not reject nearly all targets."""
        return bool(self.estimate.converged) and self.explained >= MIN_EXPLAINED

    @property
    def convincing(self) -> bool:
        """Whether the estimate explains so many targets that no other optimum is looked for."""
        return bool(self.estimate.converged) and self.explained >= WELL_EXPLAINED


def attempt_at(problem: Problem, start: Array, scales: Sequence[float]) -> Attempt:
    """Estimate an interval from one velocity, or from several, and see how many targets agree."""
    estimate = estimate_velocity(problem, start, scales)
    return Attempt(estimate, float(estimate.inliers))


def follow(
    times: Array,
    solve: Callable[[int, Array | None], Attempt | None],
    initial: ArrayLike | None,
) -> Track:
    """Estimate the n - 1 intervals between n times in turn, each from the last good velocity.

    ``solve(i, start)`` estimates interval i, or returns None if there is nothing to estimate; if
    ``start`` is None, it finds a start itself.
    """
    velocity = None if initial is None else check_velocity(initial)
    pairs = len(times) - 1
    theta, covariance = np.zeros((pairs, 3)), np.full((pairs, 3, 3), np.nan)
    converged = np.zeros(pairs, dtype=np.bool_)
    for i in range(pairs):
        attempt = solve(i, velocity)
        if attempt is not None and velocity is not None and not attempt.convincing:
            second = solve(i, None)
            if second is not None:
                attempt = min(attempt, second, key=lambda a: (not a.good, float(a.estimate.value)))
        if attempt is not None and attempt.good:
            velocity = attempt.estimate.theta
            covariance[i], converged[i] = attempt.estimate.covariance, True
        theta[i] = 0.0 if velocity is None else velocity
    return Track(times[1:], np.diff(times), theta, covariance, converged)
