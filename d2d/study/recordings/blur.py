"""The effect of a wide extent on a recording: which targets pull the velocity, and where to."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from d2d._types import Array
from d2d.radar import EgoMotionModel, Mounting, RadarScan, Recording, estimate_ego_motion
from d2d.radar.motion.pairs import scan_pair
from d2d.radar.scans.scan import doppler_gradients

_GATE = 3.0  # standard deviations of the Doppler velocity
_POSITIONS = EgoMotionModel(doppler=False)


def errors_with_extent(
    recording: Recording, extent: float, *, doppler: bool, every: int = 10
) -> Array:
    """Errors (n, 3) in m/s, m/s, rad/s of estimates that start at the reference.

    Every so many pairs of successive scans are registered with ``extent`` (m); those that do not
    converge are left out.
    """
    errors = []
    for i, theta in _known(recording, every):
        previous, current = (scan.with_extent(extent) for scan in recording.scans[i : i + 2])
        estimate = estimate_ego_motion(
            previous, current, recording.mounting, doppler=doppler, initial=theta
        )
        if estimate.converged:
            errors.append(estimate.theta - theta)
    return np.array(errors).reshape(-1, 3)


def pulls(recording: Recording, extent: float, *, apart: int = 1, every: int = 10) -> Array:
    """Slopes (n,), in s/m, of the positions' log-likelihoods in v_x at the reference.

    Only targets whose Doppler velocities are those of static ones count.  If nothing but the extent
    were wrong, the slopes would be zero on average; a negative mean pulls towards standing.  With
    ``apart`` above 1, the current scan is compared with the one that many scans before, as if it
    were the previous one: if they have no object in common, only what is constant relative to the
    sensor remains.
    """
    slopes = []
    for i, theta in _known(recording, every):
        if i + 1 < apart:
            continue
        current, other = recording.scans[i + 1], recording.scans[i + 1 - apart]
        then = recording.reference.theta[i + 1 - apart]
        if not np.isfinite(then).all():
            continue
        previous = replace(_static(other, then, recording.mounting), time=recording.scans[i].time)
        current = _static(current, theta, recording.mounting)
        if previous.size and current.size:
            pair = previous.with_extent(extent), current.with_extent(extent)
            problem = _POSITIONS.problem([scan_pair(*pair, recording.mounting, _POSITIONS)])
            _, gradient, _ = problem.derivatives(problem.bind(theta))
            slopes.append(-gradient[0, 0])
    return np.array(slopes)


def _known(recording: Recording, every: int) -> Iterator[tuple[int, Array]]:
    """Pairs (i, i + 1) of scans with targets whose motion the reference knows, and the motion."""
    theta = recording.reference.theta
    for i in range(0, len(recording.scans) - 1, every):
        mean = 0.5 * (theta[i] + theta[i + 1])
        if np.isfinite(mean).all() and recording.scans[i].size and recording.scans[i + 1].size:
            yield i, mean


def _static(scan: RadarScan, theta: Array, mounting: Mounting) -> RadarScan:
    """The targets whose Doppler velocities agree with the vehicle's."""
    gain, slope = doppler_gradients(scan.azimuth, mounting)
    sigma = np.hypot(scan.sigma_doppler, scan.sigma_azimuth * (slope @ theta))
    return scan[np.abs(scan.doppler - gain @ theta) < _GATE * sigma]
