"""Ego-motion over a whole drive."""

from collections.abc import Iterable, Sequence
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike

from d2d._checks import check_members, check_positive_scalar
from d2d._types import Array
from d2d.radar.motion.doppler import doppler_starts
from d2d.radar.motion.model import EstimationOptions, split_options
from d2d.radar.motion.pairs import check_separation, scan_before, scan_pair
from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.scans.scan import Mounting, RadarScan
from d2d.radar.tracks.limits import VehicleLimits
from d2d.radar.tracks.track import Track, integrate
from d2d.radar.tracks.tracking import (
    DEFAULT_LIMITS,
    MIN_EXPLAINED,
    Interval,
    Search,
    check_tracking,
    follow,
)

__all__ = [
    "MAX_INTERVAL",
    "MIN_EXPLAINED",
    "Track",
    "check_intervals",
    "increasing",
    "integrate",
    "track",
]

# Times between two scans that are longer than this are taken to be in another unit.
MAX_INTERVAL = 60.0  # s


def track(
    scans: Iterable[RadarScan],
    mounting: Mounting,
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
    horizon : float, s, optional
        The same as a time: each scan is registered with the one whose time is nearest to this long
        before.  On the road the covariance was most credible at 0.3 s, or close to it, and the yaw
        rate became more accurate up to 0.5 s (chapter 8b).
    initial : (3,) array, optional
        Start [v_x, v_y, omega] of the first estimate.
    max_interval : float, s
        Longest time between two scans.  Times in milli- or microseconds exceed it; a recording
        with longer gaps needs a larger one.
    budget : ErrorBudget, optional
        Errors that the targets share.  With a budget, also an empty one, the covariance is
        propagated from the targets' errors and contains the budget's, and the velocities are those
        at the track's times; see `ErrorBudget`.  Without one, the covariance is the inverse
        Hessian.
    limits : VehicleLimits, optional
        What the vehicle can do; None accepts any motion.
    progress : bool, optional
        Whether a bar on the standard error counts the estimates, for which tqdm must be installed.
        By default, one appears after two seconds if that is a terminal; not in a notebook.
    **options
        ``doppler``, ``outlier``, ``doppler_width``, ``slips``, ``first_order`` and ``scales``, as
        for `estimate_ego_motion`.

    Returns
    -------
    Track
        An estimate fails if a scan is empty or repeats an earlier one target by target while the
        sensor moves, the cost has no optimum near the start, the optimum rejects nearly all targets
        (mean inlier probability below 0.1) or turns the vehicle by more than half a turn between
        two scans, or no vehicle could move like that.  It is then marked as not converged, with the
        reason, and the track goes on.  If the estimate from the last velocity would fail or does
        not explain most of the targets (mean inlier probability below 0.6), the pair is estimated
        once more without it; of two acceptable optima the lower wins.

    Warns
    -----
    UserWarning
        If in most intervals the positions alone fit another velocity clearly better than the one
        that the Doppler velocities give: the opposite one (a wrong sign), one 3.6 times slower
        (km/h), or a faster one (velocities already compensated for the ego-motion).

    Raises
    ------
    ValueError
        If there are fewer than two scans, the scans are out of time order or farther apart than
        ``max_interval``, ``baseline`` is below 1, ``horizon`` is given beside it, or another
        argument is invalid; the message names the argument.

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
    check_separation(baseline, horizon)
    check_tracking(budget, limits, progress)
    times = increasing("scans", scans, max_interval)
    model, scales = split_options(options)
    limits = None if limits is None else limits.for_doppler(model.doppler)

    def bind(i: int) -> Interval | None:
        previous, current = scan_before(scans, i + 1, baseline, horizon), scans[i + 1]
        if not (previous.size and current.size):
            return None
        pairs = [(previous, current, mounting)]
        return Interval(model.problem([scan_pair(*pairs[0], model)]), pairs)

    def begin(i: int) -> Array:
        return doppler_starts(scans[i + 1], mounting)

    return follow(times, Search(bind, begin, scales), initial, budget, limits, progress)


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
    longest = check_positive_scalar("max_interval", max_interval)
    intervals = np.diff(times)
    if (intervals > longest).any():
        far = int(np.argmax(intervals))
        raise ValueError(
            f"{name} must have times in seconds (s), at most max_interval = {longest:g} apart, but "
            f"{times[far + 1]:.6f} comes after {times[far]:.6f}; are these milli- or microseconds?"
        )
