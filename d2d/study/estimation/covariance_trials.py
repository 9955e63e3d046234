"""The covariances that several costs state, compared with the scatter of many runs."""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.covariance import propagate_covariance
from d2d.point_set import PointSet
from d2d.registration import register
from d2d.study.book.claim import DECIBELS
from d2d.study.book.measured import Measured, anees_of, mean_of
from d2d.study.plane import evaluation
from d2d.study.plane.scenarios import OVERLAPPED, Scenario, cartesian
from d2d.study.runs import StatedCovariances, credibility_of

SEED = 5
RUNS = 20_000  # a variance is known to 1 % (one standard error)
CREDIBLE_INCLINATION = DECIBELS.high  # dB, limit of |I^2|: an ANEES of 1.12 or 0.89
P2D = RegistrationCost("p2d")
COSTS = {
    "likelihood": evaluation.LIKELIHOOD,
    "robust likelihood": evaluation.ROBUST,
    "sum": evaluation.SUMMING,
    "P2D likelihood": P2D,
}
ALL_COSTS = evaluation.COSTS | {"P2D": P2D}


@cache
def overlapped_sets(width: float = 1.0) -> tuple[PointSet, PointSet]:
    """Draws of the overlapped scene, whose targets report ``width`` times their actual noise."""
    narrow = replace(
        OVERLAPPED,
        sigma_range=OVERLAPPED.sigma_range / width,
        sigma_azimuth=OVERLAPPED.sigma_azimuth / width,
    )
    fixed, moving = narrow.sample(RUNS, np.random.default_rng(SEED))
    return fixed.inflated(width), moving.inflated(width)


def both_covariances(
    fixed: PointSet, moving: PointSet, cost: RegistrationCost, theta: Array
) -> StatedCovariances:
    """Errors of runs (N,) that start at the true motion; inverse Hessians, propagated covariances.

    The question is how far the right optimum scatters, not whether it is found.
    """
    estimates = register(fixed, moving, cost, theta)
    stated = {
        "inverse Hessian": estimates.covariance,
        "propagated": propagate_covariance(estimates, fixed, moving, cost),
    }
    good = estimates.converged
    converged = {kind: covariances[good] for kind, covariances in stated.items()}
    return StatedCovariances((estimates.theta - theta)[good], converged)


@cache
def covariance_study(name: str, width: float = 1.0) -> StatedCovariances:
    """Both covariances of a cost of `COSTS` and the scatter, each scaled to the actual noise."""
    study = both_covariances(*overlapped_sets(width), COSTS[name], OVERLAPPED.theta)
    actual = {kind: covariances / width**2 for kind, covariances in study.covariances.items()}
    return study._replace(covariances=actual)


def variance_ratio(study: StatedCovariances, kind: str) -> Array:
    """Ratio (3,) of the mean stated variance to the actual one."""
    stated = study.covariances[kind].mean(axis=0)
    return np.asarray(np.diag(stated) / study.errors.var(axis=0))


def kurtosis_of(errors: Array) -> Measured:
    """Kurtosis of whitened errors (N, n) over that of a Gaussian, n (n + 2) (Mardia 1970)."""
    count, dimension = errors.shape
    centred = errors - errors.mean(axis=0)
    covariance = centred.T @ centred / count
    white = np.linalg.solve(np.linalg.cholesky(covariance), centred.T)
    return mean_of((white**2).sum(axis=0) ** 2 / (dimension * (dimension + 2)))


def quadratic_ratios(name: str, distance: float) -> Array:
    """Ratio (500,) of the rise of a cost to that of its quadratic model, median over directions.

    It is measured ``distance`` stated standard deviations off along each parameter.
    """
    runs = 500
    fixed, moving = (points[:runs] for points in overlapped_sets())
    optima = register(fixed, moving, COSTS[name], OVERLAPPED.theta)
    ratios = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            step = np.zeros((runs, 3))
            step[:, axis] = sign * distance * np.sqrt(optima.covariance[:, axis, axis])
            rise = COSTS[name].value(optima.theta + step, fixed, moving) - optima.value
            model = 0.5 * np.einsum("ri,rij,rj->r", step, optima.hessian, step)
            ratios.append(rise / model)
    return np.asarray(np.median(ratios, axis=0))


class SharedPartner(NamedTuple):
    """ANEES of the D2D likelihood where targets share a partner."""

    fisher: Measured
    propagated: Measured
    expected: float  # of the inverse Hessian


def shared_partner(count: int) -> SharedPartner:
    """ANEES in the overlapped scene where ``count`` moving targets share each fixed one.

    The Hessian adds ``count`` pairs as if the fixed target's error, which is in all of them, were
    independent: with equal covariances it has 2 / count for the variance 1 + 1 / count.
    """
    runs = 2000
    fixed, moving = OVERLAPPED.sample(runs, np.random.default_rng(SEED))
    others = [moving]
    for seed in range(1, count):
        others.append(OVERLAPPED.sample(runs, np.random.default_rng([SEED, seed]))[1])
    means = np.concatenate([points.means for points in others], axis=-2)
    together = PointSet(means, np.concatenate([points.covariances for points in others], axis=-3))
    study = both_covariances(fixed, together, COSTS["likelihood"], OVERLAPPED.theta)
    fisher, propagated = (anees_of(study.credibility(kind)) for kind in study.covariances)
    return SharedPartner(fisher, propagated, 0.5 * (count + 1))


@cache
def over_layouts(name: str) -> tuple[Measured, ...]:
    """ANEES of the inverse Hessian on each of twelve random layouts of eight targets."""
    rng = np.random.default_rng(SEED)
    anees = []
    for _ in range(12):
        places = np.stack([rng.uniform(-0.7, 0.7, 8), rng.uniform(14.0, 33.0, 8)], axis=-1)
        scenario = replace(OVERLAPPED, targets=cartesian(places))
        estimates = register(*scenario.sample(1000, rng), COSTS[name], scenario.theta)
        anees.append(anees_of(credibility_of(estimates, scenario.theta)))
    return tuple(anees)


@cache
def in_scene(scenario: Scenario, cost: str, runs: int = 1000) -> StatedCovariances:
    """Both covariances of a cost of `ALL_COSTS`, of the draws of `evaluation.evaluated`."""
    fixed, moving = evaluation.same_draws(scenario, runs)
    return both_covariances(fixed, moving, ALL_COSTS[cost], scenario.theta)
