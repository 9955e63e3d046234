"""What a cluster does to the cost surfaces of the scene on a line, and to its estimate."""

from functools import cache
from typing import NamedTuple

import numpy as np

from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.credibility import credibility
from d2d.registration import register
from d2d.study.line.disturbed_scenes import clustered
from d2d.study.line.outlier_study import SEED
from d2d.study.line.scene import SIGMA, TRUTH, line_scene
from d2d.study.line.surfaces import log_surface, peaks

ESTIMATES = 4000  # draws with an estimate
SEARCHED = 1000  # the first of them, whose surfaces are searched for maxima
NEAR = 1.75  # m around the true alignment: the cluster's own meetings, and no other's
SPACINGS = (0.0, 0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)  # standard deviations


class Spread(NamedTuple):
    """What a cost claims on a line, and how far it errs, of every converged draw."""

    claimed: Array  # (n,) standard deviations in units of sigma
    errors: Array  # (n,) in units of sigma
    nees: Array  # (n,)


@cache
def spread(cost: RegistrationCost, spacing: float | None) -> Spread:
    """Estimates with a cluster of this spacing (sigma), or of three targets without one."""
    rng = np.random.default_rng(SEED)
    draws = (ESTIMATES,)
    if spacing is None:
        sets = line_scene(rng, draws=draws)
    else:
        sets = clustered(rng, spacing * SIGMA, draws)
    found = register(*sets, cost, [TRUTH])
    good = found.converged
    errors, covariances = found.theta[good] - TRUTH, found.covariance[good]
    return Spread(
        np.sqrt(covariances[:, 0, 0]) / SIGMA,
        errors[:, 0] / SIGMA,
        credibility(errors, covariances).nees,
    )


class ClusterSweep(NamedTuple):
    """One entry for each spacing of the cluster."""

    near: Array  # mean number of maxima within 1.75 m of the true alignment
    several: Array  # share of the draws with more than one of them
    claimed: Array  # median claimed standard deviation, in units of sigma
    actual: Array  # root mean square error in units of sigma
    anees: Array


@cache
def cluster_sweep(cost: RegistrationCost, spacings: tuple[float, ...] = SPACINGS) -> ClusterSweep:
    """The fused surface near the true alignment, and its optimum, over the cluster's spacing."""
    window = np.arange(TRUTH - NEAR, TRUTH + NEAR, 0.02)
    rows = []
    for spacing in spacings:
        sets = clustered(np.random.default_rng(SEED), spacing * SIGMA, (ESTIMATES,))
        some = tuple(points[:SEARCHED] for points in sets)
        counts = peaks(window, log_surface(cost, window, *some)).number
        found = spread(cost, spacing)
        rows.append(
            (
                counts.mean(),
                np.mean(counts > 1),
                np.median(found.claimed),
                np.sqrt(np.mean(found.errors**2)),
                found.nees.mean(),
            )
        )
    return ClusterSweep(*np.array(rows).T)


@cache
def without_cluster(cost: RegistrationCost) -> tuple[float, float]:
    """Median claimed standard deviation and root mean square error of three targets, in sigma."""
    found = spread(cost, None)
    return float(np.median(found.claimed)), float(np.sqrt(np.mean(found.errors**2)))
