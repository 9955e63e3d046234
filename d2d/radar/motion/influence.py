"""How an ego-motion estimate moves with each measured value of the scans that it was made from.

By the implicit function theorem (Censi 2007) an optimum moves by -H^-1 f_theta,z per unit of a
measured value z.  A scan that is in several pairs, with several baselines or as the current scan of
one pair and the previous scan of another, moves it by the sum over these pairs.  So the effects of
one target are added up first and squared afterwards.

Errors that targets share are sums of these influences: an azimuth bias b of a sensor moves the
estimate by b times the sum of ``azimuth`` over the targets of its scans, a Doppler scale error s by
s times the sum of ``doppler`` times the Doppler velocities.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from d2d._types import Array
from d2d.problem import Problem
from d2d.radar.scans.scan import Mounting, RadarScan, directions
from d2d.registration import Estimate

View = tuple[RadarScan, Mounting]


class Influence(NamedTuple):
    """Derivatives of a velocity [v_x, v_y, omega] in the measured values of one scan's K targets.

    Rows of v_x and v_y are in m/s, those of omega in rad/s, per unit of the measured value.
    """

    scan: RadarScan
    mounting: Mounting
    covariances: Array  # (K, 2, 2) m^2: of the positions, as the cost has them
    position: Array  # (K, 3, 2) per m, in the vehicle frame
    doppler: Array  # (K, 3) per m/s
    prediction: Array  # (K, 3) per rad of azimuth, by the predicted Doppler velocity alone
    azimuth: Array  # (K, 3) per rad of azimuth, by position and prediction together


def distinct_views(
    pairs: Sequence[tuple[RadarScan, RadarScan, Mounting]],
) -> tuple[list[View], list[tuple[int, int]]]:
    """The scans of all pairs, each once, and which two of them each pair has.

    Scans are the same if all that they hold is the same, and the mounting.
    """
    numbers: dict[tuple[object, ...], int] = {}
    views: list[View] = []
    sides = []
    for previous, current, mounting in pairs:
        both = []
        for scan in (previous, current):
            arrays = (value for value in vars(scan).values() if isinstance(value, np.ndarray))
            key = (mounting, scan.time, *(array.tobytes() for array in arrays))
            if key not in numbers:
                numbers[key] = len(views)
                views.append((scan, mounting))
            both.append(numbers[key])
        sides.append((both[0], both[1]))
    return views, sides


def influences(
    problem: Problem,
    estimate: Estimate,
    views: Sequence[View],
    sides: Sequence[tuple[int, int]],
) -> list[Influence]:
    """The influence of each view on a velocity (3,), the optimum of a problem of scan pairs.

    ``sides`` holds for each pair of the problem which view is its fixed set, the previous scan, and
    which its moving set.  Each view is of at least one pair.  All is nan if the estimate did not
    converge.
    """
    bound = problem.bind(estimate.theta)
    cross = problem.cross_derivatives(bound, 0, 1)
    position = [np.zeros((scan.size, 3, 2)) for scan, _ in views]
    doppler, prediction = ([np.zeros((scan.size, 3)) for scan, _ in views] for _ in range(2))
    covariances = [np.empty(0)] * len(views)
    fixed_start = moving_start = 0
    for pair, (previous, current) in zip(problem.pairs, sides, strict=True):
        fixed = slice(fixed_start, fixed_start + pair.fixed.size)
        moving = slice(moving_start, moving_start + pair.moving.size)
        position[previous] += cross.fixed[0, fixed]
        position[current] += cross.moving[0, moving]
        doppler[current] += cross.measured[0, moving]
        prediction[current] += cross.input[0, moving]
        covariances[previous] = pair.fixed.covariances
        covariances[current] = pair.moving.covariances
        fixed_start, moving_start = fixed.stop, moving.stop
    gain = -estimate.covariance
    found = []
    for number, (scan, mounting) in enumerate(views):
        columns = np.swapaxes(position[number], 1, 2).reshape(-1, 3) @ gain
        moved = np.swapaxes(columns.reshape(-1, 2, 3), 1, 2)
        predicted = prediction[number] @ gain
        slope = cross_range(scan, mounting)
        turned = moved[..., 0] * slope[:, :1] + moved[..., 1] * slope[:, 1:]
        found.append(
            Influence(
                scan,
                mounting,
                covariances[number],
                moved,
                doppler[number] @ gain,
                predicted,
                turned + predicted,
            )
        )
    return found


def noise_covariance(found: Sequence[Influence], *, shared_azimuth: bool = True) -> Array:
    """Covariance (3, 3) of a velocity due to the targets' own errors, which are independent.

    With ``shared_azimuth``, a single azimuth error of each target turns its position and changes
    its predicted Doppler velocity; else two independent ones do.  The rest of the positions'
    covariances, range and extent, belongs to the positions alone.
    """
    total = np.zeros((3, 3))
    for each in found:
        by_x, by_y = each.position[:, :, 0], each.position[:, :, 1]
        xx, xy, yy = (each.covariances[:, i, j, None] for i, j in ((0, 0), (0, 1), (1, 1)))
        total += by_x.T @ (xx * by_x + xy * by_y) + by_y.T @ (xy * by_x + yy * by_y)
        total += _gram(each.doppler * each.scan.sigma_doppler[:, None])
        sigma = each.scan.sigma_azimuth[:, None]
        predicted = each.prediction * sigma
        total += _gram(predicted)
        if shared_azimuth:  # the positions' covariances already contain the square of this rotation
            both = predicted.T @ ((each.azimuth - each.prediction) * sigma)
            total += both + both.T
    return 0.5 * (total + total.T)


def cross_range(scan: RadarScan, mounting: Mounting) -> Array:
    """Derivative (K, 2) of each target's position in its azimuth, in m/rad in the vehicle frame."""
    cosine, sine = directions(scan, mounting)
    return np.asarray(scan.range[:, None] * np.stack([-sine, cosine], axis=-1))


def _gram(rows: Array) -> Array:
    """A' A (3, 3) of the rows (K, 3)."""
    return np.asarray(rows.T @ rows)
