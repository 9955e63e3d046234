"""Both covariances of every cost in every scene: inverse Hessian and propagation."""

import time
from functools import cache
from typing import NamedTuple

import numpy as np

from d2d.cost import RegistrationCost
from d2d.covariance import propagate_covariance
from d2d.credibility import Credibility, credibility
from d2d.radar import Drive, estimate_ego_motion, propagate_ego_motion, track
from d2d.registration import register
from d2d.study.plane.evaluation import COSTS, same_draws
from d2d.study.plane.scenarios import Scenario
from d2d.study.runs import judged

ALL_COSTS = COSTS | {"P2D": RegistrationCost("p2d")}


class BothCovariances(NamedTuple):
    """How credible each covariance of the same errors is."""

    fisher: Credibility
    propagated: Credibility
    slowdown: float  # time of the propagation over that of the registration


@cache
def both_covariances(scenario: Scenario, cost: str, runs: int = 1000) -> BothCovariances:
    """Credibility of both covariances of a cost of `ALL_COSTS`, started at the true motion.

    The draws are those of `d2d.study.plane.evaluation.evaluated`.
    """
    fixed, moving = same_draws(scenario, runs)
    register(fixed[0], moving[0], ALL_COSTS[cost], scenario.theta)  # loads the compiled code
    begin = time.perf_counter()
    estimate = register(fixed, moving, ALL_COSTS[cost], scenario.theta)
    middle = time.perf_counter()
    propagated = propagate_covariance(estimate, fixed, moving, ALL_COSTS[cost])
    slowdown = (time.perf_counter() - middle) / (middle - begin)
    return BothCovariances(
        judged(estimate, scenario.theta), judged(estimate, scenario.theta, propagated), slowdown
    )


class DriveCovariances(NamedTuple):
    """How credible three covariances of the same ego-motion errors are."""

    fisher: Credibility
    independent: Credibility  # propagation that treats a target's position and Doppler as unrelated
    shared: Credibility  # propagation with one azimuth error in both


def drive_covariances(drive: Drive, *, doppler: bool, step: int = 3) -> DriveCovariances:
    """Credibility of three covariances, on every ``step``-th pair of scans of a drive.

    Each pair is started at the estimate of `d2d.radar.track`; the truth is the velocity at the
    second scan.
    """
    tracked = track(drive, doppler=doppler)
    errors, covariances = [], []
    for i in range(0, len(drive.scans) - 1, step):
        scans = drive.scans[i], drive.scans[i + 1]
        estimate = estimate_ego_motion(
            *scans, drive.mounting, doppler=doppler, initial=tracked.theta[i]
        )
        propagated = [
            propagate_ego_motion(
                estimate, *scans, drive.mounting, doppler=doppler, shared_azimuth=shared
            )
            for shared in (False, True)
        ]
        errors.append(estimate.theta - drive.truth.theta[i + 1])
        covariances.append([estimate.covariance, *propagated])
    error, covariance = np.array(errors), np.array(covariances)
    good = np.isfinite(covariance).all(axis=(1, 2, 3))
    return DriveCovariances(*(credibility(error[good], covariance[good, k]) for k in range(3)))
