"""Random registration problems, and what they must give, written as plainly as possible.

``dense_value`` is the cost once more, in NumPy over all pairs at once and without any shortcut.  It
takes complex parameters, so that its gradient follows from complex steps to machine precision and
owes nothing to the formulas under test.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from hypothesis import strategies as st

from d2d import (
    CorruptedGaussian,
    LinearMeasurement,
    PointSet,
    RegistrationCost,
    UniformOutlier,
    rigid,
)
from d2d.study.plane.scenarios import EIGHT_TARGETS

METRICS = ("d2d", "p2d")
FUSIONS = ("likelihood", "summing")
OUTLIERS = ("none", "uniform", "corrupted")
MEASURED = ("", "motion", "twist")  # linear in the motion's parameters or in its logarithm
LAYOUTS = ("near", "far", "coincident")

TRUTH = np.array([5.0, 0.0, np.deg2rad(15.0)])


def outlier_model(kind: str, dimension: int) -> Any:
    """An outlier model that matters beside targets about a metre in size."""
    if kind == "none":
        return None
    if kind == "uniform":
        return UniformOutlier(0.01)
    wide = {1: np.array([[40.0]]), 2: np.array([[90.0, 35.0], [35.0, 50.0]])}
    return CorruptedGaussian(0.3, wide[dimension])


def spd(rng: np.random.Generator, count: int, dimension: int, size: float = 1.0) -> np.ndarray:
    """Full covariances (count, D, D) with standard deviations around ``size``."""
    root = rng.standard_normal((count, dimension, dimension))
    return size**2 * (root @ np.swapaxes(root, -1, -2) + 0.1 * np.eye(dimension))


def drawn_errors(seed: int, runs: int, dimension: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Errors (N, D) and the covariances (N, D, D), all different, from which they are drawn."""
    rng = np.random.default_rng(seed)
    covariances = spd(rng, runs, dimension)
    normal = rng.standard_normal((runs, dimension))
    return np.einsum("nij,nj->ni", np.linalg.cholesky(covariances), normal), covariances


def doppler_like(
    rng: np.random.Generator, theta: np.ndarray, count: int, of_twist: bool = False
) -> LinearMeasurement:
    """Doppler velocities (planar: h and k of the radar's model) two sigmas off the prediction."""
    xi = twist(theta) if of_twist else theta
    if len(theta) == 3:
        tau, x, y, yaw = 0.1, 3.6, -0.7, 0.4
        azimuth = rng.uniform(-1.0, 1.0, count)
        c, s = np.cos(azimuth + yaw), np.sin(azimuth + yaw)
        gain = np.stack([-c, -s, y * c - x * s], axis=-1) / tau
        slope = np.stack([s, -c, -y * s - x * c], axis=-1) / tau
    else:
        gain, slope = rng.standard_normal((2, count, 1)) * 3.0
    sigma, sigma_input = rng.uniform(0.3, 1.0, (2, count))
    spread = np.hypot(sigma, sigma_input * (slope @ xi))
    value = gain @ xi + 2.0 * spread * rng.standard_normal(count)
    return LinearMeasurement(value, sigma, sigma_input, gain, slope, of_twist=of_twist)


def twist(theta: np.ndarray) -> np.ndarray:
    """SE(2) logarithm of one motion (3,), complex or real: the body velocity of unit time."""
    half = 0.5 * theta[2]
    c, s = np.cos(half), np.sin(half)
    # the closed form of sin(h) / h cancels in complex steps
    series = sum((-half * half) ** n / math.factorial(2 * n + 1) for n in range(9))
    x, y = theta[:2] / (series if abs(half) < 0.5 else np.sin(half) / half)
    return np.array([c * x + s * y, c * y - s * x, theta[2]])


@dataclass(frozen=True)
class Problem:
    """A cost and all that it is evaluated on."""

    cost: RegistrationCost
    theta: np.ndarray
    fixed: PointSet
    moving: PointSet
    measurement: LinearMeasurement | None = None

    def value(self, theta: Any = None) -> np.ndarray:
        return self.cost.value(
            self.theta if theta is None else theta,
            self.fixed,
            self.moving,
            measurement=self.measurement,
        )

    def derivatives(self, theta: Any = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.cost.derivatives(
            self.theta if theta is None else theta,
            self.fixed,
            self.moving,
            measurement=self.measurement,
        )

    def densities(self) -> np.ndarray:
        return self.cost.target_densities(
            self.theta, self.fixed, self.moving, measurement=self.measurement
        )

    def with_(self, **changes: Any) -> Problem:
        return replace(self, **changes)


def random_problem(
    rng: np.random.Generator,
    dimension: int = 2,
    metric: str = "d2d",
    fusion: str = "likelihood",
    outlier: str = "none",
    measured: str = "",
    layout: str = "near",
    fixed_size: int = 5,
    moving_size: int = 4,
    weighted: bool = True,
) -> Problem:
    """One problem.

    ``near``: targets that overlap their neighbours.  ``far``: every moving target hundreds of
    standard deviations from every component, where exp() underflows.  ``coincident``: all
    targets of both sets on one spot.
    """
    parameters = rigid.PARAMETERS[dimension]
    theta = np.array([0.4, -0.3, 0.25])[:parameters]
    if layout == "coincident":
        fixed_means = np.full((fixed_size, dimension), 2.0)
        spot = rigid.transform_means(rigid.inverse(theta), fixed_means[:1])
        moving_means = np.repeat(spot, moving_size, axis=0)
    else:
        fixed_means = rng.uniform(-3.0, 3.0, (fixed_size, dimension))
        moving_means = rng.uniform(-3.0, 3.0, (moving_size, dimension))
        if layout == "far":
            fixed_means = fixed_means * 100.0
            moving_means = moving_means + 900.0
    weights = rng.uniform(0.2, 3.0, fixed_size) if weighted else None
    fixed = PointSet(fixed_means, spd(rng, fixed_size, dimension), weights)
    moving = PointSet(moving_means, spd(rng, moving_size, dimension))
    measurement = doppler_like(rng, theta, moving_size, measured == "twist") if measured else None
    cost = RegistrationCost(metric, fusion, outlier_model(outlier, dimension))
    return Problem(cost, theta, fixed, moving, measurement)


def all_cases() -> list[dict[str, Any]]:
    """Every metric, fusion, outlier model and dimension, with and without a measurement."""
    names = ("dimension", "metric", "fusion", "outlier", "measured")
    combinations = product((1, 2), METRICS, FUSIONS, OUTLIERS, MEASURED)
    cases = [dict(zip(names, values, strict=True)) for values in combinations]
    return [case for case in cases if case["dimension"] == 2 or case["measured"] != "twist"]


def case_id(case: dict[str, Any]) -> str:
    """Readable name of a case for pytest."""
    measured = f"-{case['measured']}-measured" if case["measured"] else ""
    return f"{case['dimension']}D-{case['metric']}-{case['fusion']}-{case['outlier']}{measured}"


def dense_value(problem: Problem, theta: Any) -> Any:
    """The cost over all pairs at once; ``theta`` (P,) may be complex."""
    theta = np.asarray(theta)
    fixed, moving, cost = problem.fixed, problem.moving, problem.cost
    dimension = fixed.dimension
    if dimension == 2:
        c, s = np.cos(theta[2]), np.sin(theta[2])
        turn = np.array([[c, -s], [s, c]])
    else:
        turn = np.eye(1)
    moved = moving.means @ turn.T + theta[:dimension]
    d = moved[:, None, :] - fixed.means[None, :, :]
    spread = np.broadcast_to(fixed.covariances, (moving.size, *fixed.covariances.shape))
    if cost.metric == "d2d":
        spread = spread + (turn @ moving.covariances @ turn.T)[:, None]
    terms = np.log(fixed.weights) + _log_normal(d, spread)
    inlier = _log_sum_exp(terms)
    m = problem.measurement
    if m is not None:
        xi = twist(theta) if m.of_twist else theta
        variance = m.sigma**2 + m.sigma_input**2 * (m.slope @ xi) ** 2
        residual = m.value - m.gain @ xi
        inlier = inlier - 0.5 * (residual**2 / variance + np.log(2.0 * np.pi * variance))
    outlier = cost.outlier
    if isinstance(outlier, UniformOutlier):
        log_q = _log_sum_exp(
            np.stack([inlier, np.full_like(inlier, np.log(outlier.density))], axis=-1)
        )
    elif isinstance(outlier, CorruptedGaussian):
        wide = np.broadcast_to(outlier.covariance, (*d.shape, dimension))
        other = _log_sum_exp(np.log(fixed.weights) + _log_normal(d, wide))
        log_q = _log_sum_exp(
            np.stack(
                [np.log1p(-outlier.fraction) + inlier, np.log(outlier.fraction) + other], axis=-1
            )
        )
    else:
        log_q = inlier
    return -log_q.sum() if cost.fusion == "likelihood" else -_log_sum_exp(log_q)


def _log_normal(d: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    if d.shape[-1] == 1:
        variance = covariance[..., 0, 0]
        return -0.5 * (d[..., 0] ** 2 / variance + np.log(2.0 * np.pi * variance))
    xx, xy, yy = covariance[..., 0, 0], covariance[..., 0, 1], covariance[..., 1, 1]
    determinant = xx * yy - xy * xy
    x, y = d[..., 0], d[..., 1]
    square = (yy * x * x - 2.0 * xy * x * y + xx * y * y) / determinant
    return -0.5 * (square + np.log(determinant)) - np.log(2.0 * np.pi)


def _log_sum_exp(terms: np.ndarray) -> np.ndarray:
    top = terms.real.max(axis=-1)
    return top + np.log(np.exp(terms - top[..., None]).sum(axis=-1))


def dense_gradient(problem: Problem, theta: Any) -> np.ndarray:
    """Gradient (P,) of ``dense_value`` by complex steps: no difference, no cancellation."""
    theta = np.asarray(theta, dtype=float)
    steps = 1e-30j * np.eye(len(theta))
    return np.array([dense_value(problem, theta + step).imag / 1e-30 for step in steps])


def steps_of(problem: Problem) -> np.ndarray:
    """Steps (P,) for differences: a thousandth of the length over which the densities change."""
    fixed, moving = problem.fixed, problem.moving
    smallest = np.sqrt(np.linalg.eigvalsh(fixed.covariances).min())
    if fixed.dimension == 1:
        return np.array([1e-3 * smallest])
    lever = np.linalg.norm(moving.means, axis=-1).max()
    return 1e-3 * np.array([smallest, smallest, smallest / np.hypot(lever, smallest)])


def central_difference(function: Any, theta: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Fourth-order central differences of a function of (P,); the new axis comes last."""
    columns = []
    for step in np.diag(steps):
        near = function(theta + step) - function(theta - step)
        wide = function(theta + 2.0 * step) - function(theta - 2.0 * step)
        columns.append((8.0 * near - wide) / (12.0 * step.sum()))
    return np.stack(columns, axis=-1)


def dense_hessian(problem: Problem, theta: Any) -> np.ndarray:
    """Hessian (P, P): differences of the complex-step gradient, good to about 1e-10."""
    return central_difference(
        lambda x: dense_gradient(problem, x), np.asarray(theta, dtype=float), steps_of(problem)
    )


def overlapped_scene(
    runs: int, rng: np.random.Generator, sigma_range: float = 0.2, sigma_azimuth: float = 0.03
) -> tuple[PointSet, PointSet]:
    """Fixed and moving sets of ``runs`` noisy measurements of the eight targets, moved by TRUTH."""
    azimuth, distance = EIGHT_TARGETS.T
    points = distance[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    sets = []
    for means in (points, rigid.transform_means(rigid.inverse(TRUTH), points)):
        noise = rng.standard_normal((2, runs, len(means)))
        sets.append(
            PointSet.from_polar(
                np.hypot(*means.T) + sigma_range * noise[0],
                np.arctan2(means[:, 1], means[:, 0]) + sigma_azimuth * noise[1],
                sigma_range,
                sigma_azimuth,
            )
        )
    return sets[0], sets[1]


def reals(low: float, high: float) -> st.SearchStrategy[float]:
    """Finite numbers of an interval, for hypothesis."""
    return st.floats(low, high, allow_nan=False, allow_infinity=False)


def motions(dimension: int = 2) -> st.SearchStrategy[np.ndarray]:
    """Parameter vectors of rigid motions, for hypothesis."""
    shift = reals(-1e3, 1e3)
    if dimension == 1:
        return shift.map(lambda x: np.array([x]))
    return st.tuples(shift, shift, reals(-10.0, 10.0)).map(np.array)
