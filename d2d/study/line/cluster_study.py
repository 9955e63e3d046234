"""Effect of a cluster on the cost surfaces of the scene on a line, and on its estimate."""

from functools import cache
from typing import NamedTuple

import numpy as np

from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.credibility import credibility
from d2d.registration import register
from d2d.study.line.outlier_study import SEED
from d2d.study.line.scene import SIGMA, TRUTH, clustered, line_scene
from d2d.study.line.surfaces import log_surface, peaks

ESTIMATES = 4000  # draws with an estimate
SEARCHED = 1000  # the first of them, whose surfaces are searched for maxima
NEAR = 1.75  # m from the true alignment: meetings in the cluster, from 3 sigma on also of E with C
SPACINGS = (0.0, 0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)  # standard deviations


class Spread(NamedTuple):
    """Stated and actual errors of a cost on a line, of every converged draw."""

    stated: Array  # (n,) standard deviations in units of sigma
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
    estimate = register(*sets, cost, [TRUTH])
    good = estimate.converged
    errors, covariances = estimate.theta[good] - TRUTH, estimate.covariance[good]
    return Spread(
        np.sqrt(covariances[:, 0, 0]) / SIGMA,
        errors[:, 0] / SIGMA,
        credibility(errors, covariances).nees,
    )


class ClusterSweep(NamedTuple):
    """One entry for each spacing of the cluster."""

    maxima: Array  # (spacings, draws) number within 1.75 m of the true alignment
    spreads: tuple[Spread, ...]

    @property
    def near(self) -> Array:
        """Mean number of maxima within 1.75 m of the true alignment."""
        return np.asarray(self.maxima.mean(axis=1))

    @property
    def stated(self) -> Array:
        """Median stated standard deviation, in units of sigma."""
        return np.array([np.median(spread.stated) for spread in self.spreads])

    @property
    def actual(self) -> Array:
        """Root mean square error in units of sigma."""
        return np.array([np.sqrt(np.mean(spread.errors**2)) for spread in self.spreads])

    @property
    def anees(self) -> Array:
        """ANEES; a single parameter is estimated."""
        return np.array([spread.nees.mean() for spread in self.spreads])


@cache
def cluster_sweep(cost: RegistrationCost, spacings: tuple[float, ...] = SPACINGS) -> ClusterSweep:
    """The fused surface near the true alignment, and its optimum, over the cluster's spacing."""
    window = np.arange(TRUTH - NEAR, TRUTH + NEAR, 0.02)
    maxima = []
    for spacing in spacings:
        sets = clustered(np.random.default_rng(SEED), spacing * SIGMA, (ESTIMATES,))
        some = tuple(points[:SEARCHED] for points in sets)
        maxima.append(peaks(window, log_surface(cost, window, *some)).number)
    return ClusterSweep(np.array(maxima), tuple(spread(cost, spacing) for spacing in spacings))
