"""Ego-motion from successive radar scans."""

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from d2d import rigid
from d2d._checks import Array, as_path, count, finite, members
from d2d.cost import CorruptedGaussian, OutlierModel, RegistrationCost
from d2d.radar.doppler import doppler_starts
from d2d.radar.pair import Pair
from d2d.radar.scan import Mounting, RadarScan
from d2d.registration import Estimate, multi_start, register

# thesis sec. 7.3: 0.2 of the targets are outliers, spread by 10 m along both axes
DEFAULT_OUTLIER = CorruptedGaussian(0.2, 100.0 * np.eye(2))

# The wide outlier components have an optimum of their own, far from where the scans overlap: all
# targets are outliers there, and the Hessian is positive definite.  An optimum whose targets have
# a mean inlier probability below this is not taken for the vehicle's motion along a track.
LOST = 0.1
# A wrong optimum rarely explains more than half of the targets (chapter 9). One that explains more
# than this is not doubted.
SURE = 0.6


def estimate_ego_motion(
    previous: RadarScan,
    current: RadarScan,
    mounting: Mounting,
    *,
    doppler: bool = True,
    outlier: OutlierModel | None = DEFAULT_OUTLIER,
    initial: ArrayLike | None = None,
    scales: Sequence[float] = (1.0,),
    first_order: bool = False,
) -> Estimate:
    """The vehicle's velocity between two scans of one sensor.

    Registers the current scan with the previous one by the D2D likelihood; with ``doppler`` each
    target's inlier density is multiplied by that of its Doppler velocity before the outlier
    component is mixed in, prod_k ((1 - alpha) inlier_k Doppler_k + alpha outlier_k) (thesis
    eq. 7.13).

    Parameters
    ----------
    previous, current : RadarScan
        In time order, each with at least one target.
    mounting : Mounting
        Of the sensor in the vehicle frame.
    doppler : bool
        Whether the Doppler velocities enter the cost.
    outlier : UniformOutlier, CorruptedGaussian or None
        The thesis's alpha = 0.2 and (10 m)^2 unless given.
    initial : (3,) array, optional
        Start [v_x, v_y, omega].  Unless given, the velocity of the sensor is fitted to the current
        scan's Doppler velocities (also where ``doppler`` is False), and taken for that of a
        vehicle that does not turn and of one that does not slip; the lower optimum wins.
    scales : sequence of positive numbers
        Inflation schedule of all standard deviations, see `d2d.register`.
    first_order : bool
        Whether v tau is taken for the translation over the interval tau (thesis eq. 7.2), instead
        of that of the SE(2) exponential, which a turning vehicle at constant velocity moves by.

    Returns
    -------
    Estimate
        theta = [v_x, v_y, omega] in m/s, m/s, rad/s, with covariance, gradient and Hessian (at
        an optimum) in these units.  ``converged`` says that it is an optimum, which may be one that
        rejects nearly all targets: `inlier_probabilities` tells, and `track` looks there.

    Raises
    ------
    ValueError
        Naming the argument: scans out of time order, a scan without targets, a wrong ``initial``.
    """
    pair = Pair.of(previous, current, mounting, doppler, first_order)
    start = doppler_starts(current, mounting) if initial is None else finite("initial", initial)
    if initial is not None and start.shape != (3,):
        raise ValueError(f"initial must have the shape (3,), but has {start.shape}")
    return _estimate(pair, start, RegistrationCost(outlier=outlier), scales)


def _estimate(
    pair: Pair, start: Array, cost: RegistrationCost, scales: Sequence[float]
) -> Estimate:
    """From the velocity ``start`` (3,), or from the best of several (S, 3)."""
    solve = register if start.ndim == 1 else multi_start
    estimate = solve(
        pair.fixed, pair.moving, cost, pair.motion(start), scales, measurement=pair.measurement
    )
    return _as_velocity(estimate, pair.interval, pair.first_order)


def inlier_probabilities(
    theta: ArrayLike,
    previous: RadarScan,
    current: RadarScan,
    mounting: Mounting,
    *,
    doppler: bool = True,
    outlier: OutlierModel | None = DEFAULT_OUTLIER,
    first_order: bool = False,
) -> Array:
    """Probability (..., K) that each target of the current scan is an inlier under ``theta``.

    ``theta`` (..., 3) is the vehicle's velocity [v_x, v_y, omega] in m/s, m/s, rad/s; the other
    arguments, and what they raise, are those of `estimate_ego_motion`.  A target that moves on its
    own, or that has no counterpart in the previous scan, comes out low.
    """
    pair = Pair.of(previous, current, mounting, doppler, first_order)
    return pair.inlier_probabilities(
        rigid.motion("theta", theta, 2), RegistrationCost(outlier=outlier)
    )


def _as_velocity(estimate: Estimate, interval: float, first_order: bool) -> Estimate:
    """The estimated motion over the interval as the body velocity that causes it."""
    motion = estimate.theta
    twist = motion if first_order else rigid.logarithm(motion)
    inner = np.eye(3) if first_order else rigid.logarithm_jacobian(motion)
    jacobian = inner / interval  # d velocity / d motion
    back = np.linalg.inv(jacobian)
    return replace(
        estimate,
        theta=twist / interval,
        covariance=jacobian @ estimate.covariance @ jacobian.T,
        gradient=back.T @ estimate.gradient,
        hessian=back.T @ estimate.hessian @ back,
    )


@dataclass(frozen=True, eq=False)
class Track:
    """The motion along a drive, one row for each pair of successive scans.

    Attributes
    ----------
    times : (n,) array, s
        Of each pair's current scan.
    intervals : (n,) array, s
        Between the scans of each pair.
    theta : (n, 3) array
        [v_x, v_y, omega] in m/s, m/s, rad/s; the constant-velocity prediction where not converged.
    covariance : (n, 3, 3) array
        nan where not converged.
    converged : (n,) array of bool
    """

    times: Array
    intervals: Array
    theta: Array
    covariance: Array
    converged: NDArray[np.bool_]

    def poses(self, start: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
        """The driven path: (n + 1, 3) poses [x, y, yaw] in m, m, rad, beginning at ``start``.

        Pose i + 1 is pose i followed by the motion of pair i, exp(tau theta).
        """
        return integrate(self.theta, self.intervals, start)

    def write_tum(self, path: str | os.PathLike[str], start: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """Write the poses as a TUM trajectory file: a line "t x y z qx qy qz qw" for each.

        The format that `evo` and others read; t in s, the vehicle in the plane z = 0.

        Parameters
        ----------
        path : path
            Of the file, which is overwritten if there is one; ``~`` stands for the home folder.
        start : (3,) array, m, m, rad
            The first pose, as for `poses`.

        Raises
        ------
        ValueError
            Naming the argument that is no path or no pose.
        OSError
            If the file cannot be written.
        """
        x, y, yaw = self.poses(start).T
        first = self.times[:1] - self.intervals[:1]
        zero = np.zeros_like(x)
        turn = np.sin(0.5 * yaw), np.cos(0.5 * yaw)
        columns = [np.concatenate([first, self.times]), x, y, zero, zero, zero, *turn]
        np.savetxt(as_path("path", path), np.column_stack(columns), "%.9f")


def integrate(theta: ArrayLike, intervals: ArrayLike, start: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """Chain the motions intervals (n,) x theta (n, 3) to poses (n + 1, 3) [x, y, yaw]."""
    velocities, times = rigid.motion("theta", theta, 2), finite("intervals", intervals)
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
    doppler: bool = True,
    outlier: OutlierModel | None = DEFAULT_OUTLIER,
    initial: ArrayLike | None = None,
    scales: Sequence[float] = (1.0,),
    first_order: bool = False,
) -> Track:
    """Ego-motion over a whole drive, each pair started at the last converged velocity.

    Parameters
    ----------
    scans : iterable of RadarScan
        At least two, in strictly increasing time.
    mounting : Mounting
    baseline : int
        How many scans back the scan lies that each scan is registered with (the first scans: with
        the first one).  Over a longer time the same error of the positions is a smaller one of
        the velocity, as long as the velocity is constant and the targets stay in view.
    initial : (3,) array, optional
        Start of the first pair.
    doppler, outlier, scales, first_order
        As for `estimate_ego_motion`.

    Returns
    -------
    Track
        A pair that cannot be estimated, because a scan is empty, the cost has no optimum near or
        the optimum rejects nearly all targets (`LOST`), is marked as not converged and does not
        end the drive.  Before that, and where the optimum does not explain most of the targets
        (`SURE`), it is tried once more without the last velocity; the lower optimum wins.

    Raises
    ------
    ValueError
        Fewer than two scans, scans out of time order, a ``baseline`` below 1; otherwise naming the
        argument that does not fit.

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
    scans = members("scans", scans, RadarScan)
    if len(scans) < 2:
        raise ValueError(f"scans must hold at least two scans, but holds {len(scans)}")
    count("baseline", baseline)
    times = increasing("scans", scans)
    cost = RegistrationCost(outlier=outlier)

    def solve(i: int, start: Array | None) -> Attempt | None:
        previous, current = scans[max(i + 1 - baseline, 0)], scans[i + 1]
        if not (previous.size and current.size):
            return None
        pair = Pair.of(previous, current, mounting, doppler, first_order)
        begin = doppler_starts(current, mounting) if start is None else start
        estimate = _estimate(pair, begin, cost, scales)
        return Attempt(estimate, float(pair.inlier_probabilities(estimate.theta, cost).mean()))

    return follow(times, solve, initial)


def increasing(name: str, scans: Sequence[RadarScan]) -> Array:
    """The scans' times (n,); a ValueError naming the argument where they do not increase."""
    times = np.array([scan.time for scan in scans])
    intervals = np.diff(times)
    if not (intervals > 0).all():
        late = int(np.argmin(intervals > 0)) + 1
        raise ValueError(
            f"{name} must be in strictly increasing time, but scan {late} is at "
            f"{times[late]:.6f} s after {times[late - 1]:.6f} s"
        )
    return times


class Attempt(NamedTuple):
    """An estimate of one interval, and whether to believe it."""

    estimate: Estimate
    trusted: float  # mean inlier probability of the targets

    @property
    def good(self) -> bool:
        """Whether it is an optimum that does not reject nearly all targets."""
        return bool(self.estimate.converged) and self.trusted >= LOST

    @property
    def sure(self) -> bool:
        """Whether so many targets agree that another optimum need not be looked for."""
        return bool(self.estimate.converged) and self.trusted >= SURE


def follow(
    times: Array,
    solve: Callable[[int, Array | None], Attempt | None],
    initial: ArrayLike | None,
) -> Track:
    """Estimate the n - 1 intervals between n times in turn, each from the last good velocity.

    ``solve(i, start)`` estimates interval i, or gives None if there is nothing to estimate; without
    a start it finds one itself.
    """
    velocity = None if initial is None else finite("initial", initial)
    if velocity is not None and velocity.shape != (3,):
        raise ValueError(f"initial must have the shape (3,), but has {velocity.shape}")
    pairs = len(times) - 1
    theta, covariance = np.zeros((pairs, 3)), np.full((pairs, 3, 3), np.nan)
    converged = np.zeros(pairs, dtype=np.bool_)
    for i in range(pairs):
        found = solve(i, velocity)
        if found is not None and velocity is not None and not found.sure:
            again = solve(i, None)
            if again is not None:
                found = min(found, again, key=lambda a: (not a.good, float(a.estimate.value)))
        if found is not None and found.good:
            velocity = found.estimate.theta
            covariance[i], converged[i] = found.estimate.covariance, True
        theta[i] = 0.0 if velocity is None else velocity
    return Track(times[1:], np.diff(times), theta, covariance, converged)
