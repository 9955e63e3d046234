"""Both covariances, each against the plain call that it stands for."""

import numpy as np
from numpy.testing import assert_allclose

from d2d import credibility, propagate_covariance, register
from d2d.radar import estimate_ego_motion, propagate_ego_motion, simulate_drive, track
from d2d.study import scenarios
from d2d.study.beyond.both_covariances import both_covariances, drive_covariances
from d2d.study.plane.evaluation import ROBUST, same_draws


def test_both_covariances_are_those_of_the_same_errors() -> None:
    """Breaks if the two are computed from different draws, or change places."""
    found = both_covariances(scenarios.OVERLAPPED, "robust", 200)
    fixed, moving = same_draws(scenarios.OVERLAPPED, 200)
    estimate = register(fixed, moving, ROBUST, scenarios.OVERLAPPED.theta)
    errors = estimate.theta - scenarios.OVERLAPPED.theta
    propagated = propagate_covariance(estimate, fixed, moving, ROBUST)
    assert_allclose(found.fisher.nees, credibility(errors, estimate.covariance).nees)
    assert_allclose(found.propagated.nees, credibility(errors, propagated).nees)


def test_drive_covariances_are_those_of_each_pair() -> None:
    """Breaks if a covariance is lost on the way, or belongs to another pair or another kind."""
    drive = simulate_drive(np.random.default_rng(2), 2.0)
    found = drive_covariances(drive, doppler=True, step=2)
    followed = track(drive)
    for number, i in enumerate(range(0, len(drive.scans) - 1, 2)):
        pair = drive.scans[i], drive.scans[i + 1], drive.mounting
        estimate = estimate_ego_motion(*pair, initial=followed.theta[i])
        error = estimate.theta - drive.truth.theta[i + 1]
        covariances = {
            "fisher": estimate.covariance,
            "independent": propagate_ego_motion(estimate, *pair, shared_azimuth=False),
            "shared": propagate_ego_motion(estimate, *pair),
        }
        for name, covariance in covariances.items():
            nees = error @ np.linalg.solve(covariance, error)
            assert_allclose(getattr(found, name).nees[number], nees, err_msg=name)
    assert not np.allclose(found.shared.nees, found.independent.nees, rtol=1e-3)


def test_without_doppler_there_is_no_azimuth_to_share() -> None:
    """Breaks if Doppler velocities are used unasked."""
    drive = simulate_drive(np.random.default_rng(2), 2.0)
    without = drive_covariances(drive, doppler=False, step=2)
    assert_allclose(without.shared.nees, without.independent.nees)
