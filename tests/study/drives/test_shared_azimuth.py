"""Three covariances of the estimates of a drive, each against the plain call it stands for."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d.radar import estimate_ego_motion, propagate_ego_motion, simulate_drive, track
from d2d.study.drives.shared_azimuth import COVARIANCES, on_a_drive


@pytest.fixture(scope="module")
def drive():
    return simulate_drive(np.random.default_rng(2), 2.0)


def test_the_covariances_are_those_of_each_pair(drive):
    """Breaks if a covariance is lost on the way, or belongs to another pair or another kind."""
    driven, pairs = track(drive), [0, 2, 5, 16]
    found = on_a_drive(drive, driven, pairs)
    for number, i in enumerate(pairs):
        pair = drive.scans[i], drive.scans[i + 1], drive.mounting
        estimate = estimate_ego_motion(*pair, initial=driven.theta[i])
        error = estimate.theta - drive.truth.theta[i + 1]
        covariances = (
            estimate.covariance,
            propagate_ego_motion(estimate, *pair, shared_azimuth=False),
            propagate_ego_motion(estimate, *pair),
        )
        for name, covariance in zip(COVARIANCES, covariances, strict=True):
            nees = error @ np.linalg.solve(covariance, error)
            assert_allclose(found.credibility(name).nees[number], nees, err_msg=name)
    _, apart, shared = found.covariances.values()
    assert not np.allclose(shared, apart, rtol=1e-3)
