"""The effect of treating the azimuth error in a target's position and Doppler as two errors."""

from collections.abc import Iterable

import numpy as np

from d2d.radar import Drive, Track, estimate_ego_motion, propagate_ego_motion
from d2d.study.runs import StatedCovariances

COVARIANCES = ("inverse Hessian", "propagated, errors apart", "propagated, error shared")


def on_a_drive(
    drive: Drive, driven: Track, pairs: Iterable[int], *, doppler: bool = True
) -> StatedCovariances:
    """Three covariances on these pairs of scans of a drive, started at its track."""
    errors, covariances = [], []
    for i in pairs:
        pair = drive.scans[i], drive.scans[i + 1], drive.mounting
        estimate = estimate_ego_motion(*pair, doppler=doppler, initial=driven.theta[i])
        propagated = [
            propagate_ego_motion(estimate, *pair, doppler=doppler, shared_azimuth=shared)
            for shared in (False, True)
        ]
        errors.append(estimate.theta - drive.truth.theta[i + 1])
        covariances.append([estimate.covariance, *propagated])
    error, covariance = np.array(errors), np.array(covariances)
    good = np.isfinite(covariance).all(axis=(1, 2, 3))
    by_name = zip(COVARIANCES, np.swapaxes(covariance[good], 0, 1), strict=True)
    return StatedCovariances(error[good], dict(by_name))
