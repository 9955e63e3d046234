"""Ego-motion from successive radar scans."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from d2d import rigid
from d2d._checks import Array, finite
from d2d.cost import CorruptedGaussian, OutlierModel, RegistrationCost
from d2d.measurement import LinearMeasurement
from d2d.point_set import PointSet
from d2d.radar.doppler import doppler_starts
from d2d.radar.scan import Mounting, RadarScan
from d2d.registration import Estimate, multi_start, register

# thesis sec. 7.3: 0.2 of the targets are outliers, spread by 10 m along both axes
DEFAULT_OUTLIER = CorruptedGaussian(0.2, 100.0 * np.eye(2))


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
        an optimum) in these units.

    Raises
    ------
    ValueError
        Naming the argument: scans out of time order, a scan without targets, a wrong ``initial``.
    """
    start = doppler_starts(current, mounting) if initial is None else finite("initial", initial)
    if initial is not None and start.shape != (3,):
        raise ValueError(f"initial must have the shape (3,), but has {start.shape}")
    pair = _pair(previous, current, mounting, doppler, first_order)
    solve = register if start.ndim == 1 else multi_start
    estimate = solve(
        pair.fixed,
        pair.moving,
        RegistrationCost(outlier=outlier),
        pair.motion(start),
        scales,
        measurement=pair.measurement,
    )
    return _as_velocity(estimate, pair.interval, first_order)


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
    pair = _pair(previous, current, mounting, doppler, first_order)
    return RegistrationCost(outlier=outlier).inlier_probabilities(
        pair.motion(rigid.motion("theta", theta, 2)),
        pair.fixed,
        pair.moving,
        measurement=pair.measurement,
    )


class _Pair(NamedTuple):
    """Two scans of one sensor as a registration problem."""

    fixed: PointSet
    moving: PointSet
    measurement: LinearMeasurement | None
    interval: float
    first_order: bool

    def motion(self, theta: Array) -> Array:
        """The motion over the interval at the velocity theta."""
        twist = theta * self.interval
        return twist if self.first_order else rigid.exponential(twist)


def _pair(
    previous: RadarScan, current: RadarScan, mounting: Mounting, doppler: bool, first_order: bool
) -> _Pair:
    interval = current.time - previous.time
    if not interval > 0:
        raise ValueError(
            f"current must be later than previous, but is at {current.time:.6f} s after "
            f"{previous.time:.6f} s"
        )
    for name, scan in (("previous", previous), ("current", current)):
        if not scan.size:
            raise ValueError(f"{name} holds no targets")
    measurement = current.doppler_measurement(mounting, interval, of_twist=not first_order)
    return _Pair(
        previous.point_set(mounting),
        current.point_set(mounting),
        measurement if doppler else None,
        interval,
        first_order,
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
    yaw = first[2] + np.concatenate([[0.0], np.cumsum(steps[:, 2])])
    moved = np.einsum("nij,nj->ni", rigid.rotation(yaw[:-1]), steps[:, :2])
    position = first[:2] + np.concatenate([np.zeros((1, 2)), np.cumsum(moved, axis=0)])
    return np.column_stack([position, yaw])


def track(scans: Sequence[RadarScan], mounting: Mounting, **options: Any) -> Track:
    """Ego-motion over a whole drive, each pair started at the last converged velocity.

    Parameters
    ----------
    scans : sequence of RadarScan
        At least two, in strictly increasing time.
    mounting : Mounting
    **options
        Of `estimate_ego_motion`; ``initial`` is the start of the first pair.

    Returns
    -------
    Track
        A pair that cannot be estimated, because a scan is empty or the cost has no optimum near,
        is marked as not converged and does not end the drive.

    Raises
    ------
    ValueError
        Fewer than two scans, or scans out of time order.
    """
    if len(scans) < 2:
        raise ValueError(f"scans must hold at least two scans, but holds {len(scans)}")
    times = np.array([scan.time for scan in scans])
    intervals = np.diff(times)
    if not (intervals > 0).all():
        late = int(np.argmin(intervals > 0)) + 1
        raise ValueError(
            f"scans must be in strictly increasing time, but scan {late} is at {times[late]:.6f} s "
            f"after {times[late - 1]:.6f} s"
        )
    velocity = options.pop("initial", None)
    pairs = len(intervals)
    theta, covariance = np.zeros((pairs, 3)), np.full((pairs, 3, 3), np.nan)
    converged = np.zeros(pairs, dtype=np.bool_)
    for i, (previous, current) in enumerate(pairwise(scans)):
        if previous.size and current.size:
            estimate = estimate_ego_motion(previous, current, mounting, initial=velocity, **options)
            if estimate.converged:
                velocity = estimate.theta
                covariance[i], converged[i] = estimate.covariance, True
        theta[i] = 0.0 if velocity is None else velocity
    return Track(times[1:], intervals, theta, covariance, converged)
