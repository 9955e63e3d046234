"""Velocity from Doppler profiles alone, of one sensor (Kellner et al. 2013) or several (2014)."""

from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from d2d._checks import check_flag, check_instance, check_rows
from d2d._kernel.compile import read_only
from d2d._kernel.consensus import find_consensus
from d2d._types import Array
from d2d.radar.scans.scan import Mounting, RadarScan, doppler_gradients, level

View = tuple[RadarScan, Mounting]

_MAX_HYPOTHESES = 200  # of a sensor's velocity, each from two targets
_GATE = 3.0  # standard deviations within which a target agrees with a hypothesis
_MAX_ITERATIONS = 20  # of fitting, weighting and selecting
_TOLERANCE = 1e-6  # m/s, m/s, rad/s: a smaller change ends the iteration
_SPARSE = 10  # targets of a sensor on average, below which a joint velocity may be accidental
_MIN_SEEN = 5  # targets of a sensor that agree, before a change of its velocity is believed
_CONTRADICTING = 4.0  # standard deviations
_MIN_RATIO = 1e-3  # of a singular value to the largest, for an observable direction


def sensor_velocity(scan: RadarScan, mounting: Mounting) -> Array:
    r"""Velocity (2,) of the sensor along the vehicle's axes, in m/s.

    Static targets lie on :math:`v = -(u_x \cos\phi + u_y \sin\phi)`.  Every pair of targets of a
    fixed set (random in Kellner et al. 2013) gives a hypothesis of u; the one that most targets
    agree with, or if none do, all targets, are fitted by weighted least squares.  A component that
    is not observable is zero.  Raises a ``ValueError`` if an argument is of another kind.
    """
    check_instance("scan", scan, RadarScan)
    check_instance("mounting", mounting, Mounting)
    return _sensor_fit(*level(scan, mounting))[0]


def _sensor_fit(scan: RadarScan, mounting: Mounting) -> tuple[Array, Array]:
    """The velocity (2,) of a sensor, and the derivatives (K, 2) over sigma of its inliers."""
    if not scan.size:
        return np.zeros(2), np.empty((0, 2))
    sight = doppler_gradients(scan.azimuth, mounting)[0][:, :2]
    inliers = _agreeing(scan, sight)
    # targets closer together than the uncertainty of their azimuths show one direction only
    spread = max(1e-6, _GATE * float(np.median(scan.sigma_azimuth)))
    system, values, sigma = sight[inliers], scan.doppler[inliers], scan.sigma_doppler[inliers]
    velocity = np.linalg.lstsq(system / sigma[:, None], values / sigma, rcond=spread)[0]
    # a turned line of sight sees the component of the velocity across it
    turned = system @ [[0.0, -1.0], [1.0, 0.0]] @ velocity * scan.sigma_azimuth[inliers]
    return np.asarray(velocity), system / np.hypot(sigma, turned)[:, None]


class Acceleration(NamedTuple):
    """An acceleration (3,) in m/s², m/s², rad/s², with its covariance (3, 3)."""

    value: Array
    covariance: Array


def doppler_acceleration(
    changes: Iterable[tuple[RadarScan, RadarScan, Mounting]], before: Array
) -> Acceleration:
    """The vehicle's acceleration from the Doppler velocities of earlier and later scans.

    The velocity of each sensor is fitted in both of its scans as in `sensor_velocity`.  ``before``
    (3, 3) is the covariance of the acceleration about zero before any is seen.  A sensor that
    contradicts it by more than four standard deviations is left out: it has seen another vehicle.
    """
    value, covariance = np.zeros(3), before
    for previous, current, mounting in changes:
        first, seen = _sensor_fit(previous, mounting)
        second, seen_later = _sensor_fit(current, mounting)
        if min(len(seen), len(seen_later)) < _MIN_SEEN:
            continue
        interval = current.time - previous.time
        to = np.array([[1.0, 0.0, -mounting.y], [0.0, 1.0, mounting.x]])
        spread = sum(np.linalg.pinv(own.T @ own, 1e-6) for own in (seen, seen_later))
        expected = to @ covariance @ to.T + spread / interval**2
        gain = np.linalg.solve(expected, to @ covariance).T
        difference = (second - first) / interval - to @ value
        if difference @ np.linalg.solve(expected, difference) < _CONTRADICTING**2:
            value = value + gain @ difference
            covariance = covariance - gain @ to @ covariance
            covariance = 0.5 * (covariance + covariance.T)
    return Acceleration(value, covariance)


class DopplerMotion(NamedTuple):
    """The vehicle's velocity from the Doppler velocities of one instant.

    It is zero along directions that are not observable.
    """

    theta: Array  # (3,) in m/s, m/s, rad/s
    covariance: Array  # (3, 3); nan unless all estimated components were observable
    inliers: tuple[NDArray[np.bool_], ...]  # which targets (K,) of each scan were taken as static


def doppler_ego_motion(views: Iterable[View], *, side_slip: bool = True) -> DopplerMotion:
    r"""The vehicle's velocity from the Doppler velocities of one or several sensors.

    Static targets are found by `sensor_velocity`, and :math:`V_k = h_k^{\mathsf T} \theta` fitted
    to them with the variances :math:`\sigma_v^2 + \sigma_\phi^2 (\partial V/\partial\phi)^2`.  Each
    fit gives the weights of the next, and its targets: those within three standard deviations.
    Sensors at different positions make the yaw rate observable (Kellner et al. 2014).  Raises a
    ``ValueError`` if an argument is of another kind, or ``views`` is empty.

    Parameters
    ----------
    views : iterable of (RadarScan, Mounting)
        Scans at (nearly) the same time; they may be empty.
    side_slip : bool
        Whether v_y is estimated.  If not, it is zero, and a single sensor ahead of or behind the
        origin is enough (Kellner et al. 2013).
    """
    views = check_rows("views", views, RadarScan, Mounting)
    if not views:
        raise ValueError("views must hold at least one scan with its mounting, but is empty")
    views = [level(*view) for view in views]
    edges = np.cumsum([scan.size for scan, _ in views])[:-1]
    rows = []  # of each scan: gains, slopes, measured values and who agrees
    for scan, at in views:
        gain, slope = doppler_gradients(scan.azimuth, at)
        measured = scan.doppler, scan.sigma_doppler, scan.sigma_azimuth
        rows.append((gain, slope, *measured, _agreeing(scan, gain[:, :2])))
    gains, slopes, doppler, sigma_doppler, sigma_azimuth, inliers = map(
        np.concatenate, zip(*rows, strict=True)
    )
    free = np.array([True, check_flag("side_slip", side_slip), True])
    theta, covariance, rank = np.zeros(3), np.full((3, 3), np.nan), 0
    sigma, columns = sigma_doppler, gains[:, free]
    for _ in range(_MAX_ITERATIONS if inliers.any() else 0):
        weights = inliers / sigma
        system = columns * weights[:, None]
        scale = np.sqrt(np.einsum("ki,ki->i", system, system)) + 1e-300
        solution, _, rank, _ = np.linalg.lstsq(system / scale, doppler * weights, rcond=_MIN_RATIO)
        moved = np.abs(theta[free] - solution / scale).max()
        theta[free] = solution / scale
        sigma = np.hypot(sigma_doppler, sigma_azimuth * (slopes @ theta))
        agree = np.abs(doppler - gains @ theta) < _GATE * sigma
        if not agree.any() or (moved < _TOLERANCE and (agree == inliers).all()):
            break
        inliers = agree
    if rank == free.sum():
        covariance = np.zeros((3, 3))
        covariance[np.ix_(free, free)] = np.linalg.inv(system.T @ system)
    return DopplerMotion(theta, covariance, tuple(np.split(inliers, edges)))


def doppler_starts(views: Sequence[View]) -> Array:
    """Starts (S, 3) [v_x, v_y, omega] for a registration, near the Doppler velocities.

    If the sensors do not determine the whole velocity, or see few targets, each gives its own
    starts, as `estimate_ego_motion` says of its ``initial``.
    """
    if len({mounting for _, mounting in views}) > 1:
        motion = doppler_ego_motion(views)
        if np.isfinite(motion.covariance).all():
            sparse = sum(scan.size for scan, _ in views) < _SPARSE * len(views)
            alone = [_starts_alone(*view) for view in views if sparse and view[0].size]
            return np.concatenate([motion.theta[np.newaxis], *alone])
    return np.concatenate([_starts_alone(*view) for view in views if view[0].size])


def _starts_alone(scan: RadarScan, mounting: Mounting) -> Array:
    """Starts (S, 3) by the velocity of one sensor."""
    along, across = sensor_velocity(scan, mounting)
    starts = [[along, across, 0.0]]
    if mounting.x != 0.0:
        turn = across / mounting.x
        starts.append([along + turn * mounting.y, 0.0, turn])
    return np.array(starts)


def _agreeing(scan: RadarScan, sight: Array) -> NDArray[np.bool_]:
    """Mask (K,) of the targets that agree with the best-supported hypothesis; all if none do."""
    agree = np.ones(scan.size, dtype=np.bool_)
    if scan.size <= 2:
        return agree
    # which of two hypotheses that are equally good is found must not depend on the targets' order
    order = np.lexsort([scan.range, scan.doppler, scan.azimuth])
    sigmas = np.stack([scan.sigma_doppler, scan.sigma_azimuth])[:, order]
    found = agree.copy()
    find_consensus(sight[order], scan.doppler[order], sigmas, _hypotheses(scan.size), _GATE, found)
    agree[order] = found
    return agree if agree.any() else np.ones_like(agree)


@lru_cache(maxsize=256)
def _hypotheses(size: int) -> NDArray[np.int64]:
    """Pairs (2, H) of ``size`` targets, one for each hypothesis, spread evenly over all pairs."""
    ends = np.cumsum(np.arange(size - 1, 0, -1))  # of the pairs of each first target
    chosen = np.linspace(0, ends[-1] - 1, min(_MAX_HYPOTHESES, ends[-1])).astype(np.int64)
    first = np.searchsorted(ends, chosen, side="right")
    return read_only(np.stack([first, size + chosen - ends[first]]), 2, -1)
