"""Random registration problems, and what they must give.

A loop over the pairs, as plain as possible, judges the formulas of `d2d.dense`; these, which are
faster and have derivatives, judge the compiled kernel.
"""

from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from hypothesis import strategies as st

from d2d import (
    CorruptedGaussian,
    Estimate,
    LinearMeasurement,
    PointSet,
    RegistrationCost,
    UniformOutlier,
    dense,
    register,
    rigid,
)
from d2d.study.plane.scenarios import OVERLAPPED

METRICS = ("d2d", "p2d")
FUSIONS = ("likelihood", "summing")
OUTLIERS = ("none", "uniform", "corrupted")
MEASURED = ("", "motion", "twist")  # linear in the motion's parameters or in its logarithm
LAYOUTS = ("near", "far", "coincident")

TRUTH = OVERLAPPED.theta
ROBUST = RegistrationCost(outlier=CorruptedGaussian(0.2, 100.0 * np.eye(2)))


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
    xi = rigid.logarithm(theta) if of_twist else theta
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


@dataclass(frozen=True)
class Problem:
    """A cost and all that it is evaluated on."""

    cost: RegistrationCost
    theta: np.ndarray
    fixed: PointSet
    moving: PointSet
    measurement: LinearMeasurement | None = None

    def _of(self, function: Any, theta: Any = None) -> Any:
        theta = self.theta if theta is None else theta
        return function(theta, self.fixed, self.moving, measurement=self.measurement)

    def value(self, theta: Any = None) -> np.ndarray:
        return self._of(self.cost.value, theta)

    def derivatives(self, theta: Any = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self._of(self.cost.derivatives, theta)

    def register(self, initial: Any = None, scales: Any = (1.0,)) -> Estimate:
        """From its own theta unless another start is given."""
        start = self.theta if initial is None else initial
        sets, measurement = (self.fixed, self.moving), self.measurement
        return register(*sets, self.cost, start, scales, measurement=measurement)

    def densities(self) -> np.ndarray:
        return self._of(self.cost.target_densities)

    def inlier_probabilities(self) -> np.ndarray:
        return self._of(self.cost.inlier_probabilities)

    def with_(self, **changes: Any) -> "Problem":
        return replace(self, **changes)


def random_problem(
    rng: np.random.Generator,
    dimension: int = 2,
    metric: str = "d2d",
    fusion: str = "likelihood",
    outlier: str = "none",
    measured: str = "",
    layout: str = "near",
    sizes: tuple[int, int] = (5, 4),
    weighted: bool = True,
) -> Problem:
    """One problem.

    ``near``: targets that overlap their neighbours.  ``far``: every moving target hundreds of
    standard deviations from every component, where exp() underflows.  ``coincident``: all
    targets of both sets on one spot.
    """
    parameters = rigid.PARAMETERS[dimension]
    theta = np.array([0.4, -0.3, 0.25])[:parameters]
    fixed_size, moving_size = sizes
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


def in_unit(problem: Problem, unit: float) -> Problem:
    """The same scene with all lengths multiplied by ``unit``; no measurement."""
    f, m, model = problem.fixed, problem.moving, problem.cost.outlier
    dimension = f.dimension
    if isinstance(model, UniformOutlier):
        model = UniformOutlier(model.density / unit**dimension)
    elif isinstance(model, CorruptedGaussian):
        model = CorruptedGaussian(model.fraction, model.covariance * unit**2)
    return Problem(
        replace(problem.cost, outlier=model),
        np.concatenate([problem.theta[:dimension] * unit, problem.theta[dimension:]]),
        PointSet(f.means * unit, f.covariances * unit**2, f.weights),
        PointSet(m.means * unit, m.covariances * unit**2),
    )


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


def naive_log_densities(problem: Problem) -> np.ndarray:
    """log q_k of one problem, by a loop over the targets and one over the components."""
    cost, theta, m = problem.cost, problem.theta, problem.measurement
    fixed, moving, outlier = problem.fixed, problem.moving, problem.cost.outlier
    turn = rigid.rotation(theta[2]) if fixed.dimension == 2 else np.eye(1)
    logs = []
    for k in range(moving.size):
        inlier, wide = [], []
        for i in range(fixed.size):
            d = turn @ moving.means[k] + theta[: fixed.dimension] - fixed.means[i]
            covariance = fixed.covariances[i]
            if cost.metric == "d2d":
                covariance = covariance + turn @ moving.covariances[k] @ turn.T
            inlier.append(np.log(fixed.weights[i]) + log_normal(d, covariance))
            if isinstance(outlier, CorruptedGaussian):
                wide.append(np.log(fixed.weights[i]) + log_normal(d, outlier.covariance))
        log_q = np.logaddexp.reduce(inlier)
        if m is not None:
            xi = rigid.logarithm(theta) if m.of_twist else theta
            variance = m.sigma[k] ** 2 + (m.sigma_input[k] * (m.slope[k] @ xi)) ** 2
            log_q += log_normal(m.value[[k]] - m.gain[k] @ xi, np.array([[variance]]))
        if isinstance(outlier, UniformOutlier):
            log_q = np.logaddexp(log_q, np.log(outlier.density))
        elif isinstance(outlier, CorruptedGaussian):
            shares = np.log([1.0 - outlier.fraction, outlier.fraction])
            log_q = np.logaddexp(shares[0] + log_q, shares[1] + np.logaddexp.reduce(wide))
        logs.append(log_q)
    return np.array(logs)


def log_normal(d: np.ndarray, covariance: np.ndarray) -> float:
    """log N(d | 0, S) of one pair."""
    square = d @ np.linalg.solve(covariance, d)
    return float(-0.5 * (square + np.linalg.slogdet(2.0 * np.pi * covariance)[1]))


def naive_value(problem: Problem) -> float:
    logs = naive_log_densities(problem)
    summed = problem.cost.fusion == "summing"
    return float(-np.logaddexp.reduce(logs) if summed else -logs.sum())


def batch_of_one(problem: Problem, theta: Any = None) -> tuple[Any, ...]:
    """What the functions of `d2d.dense` take, which expect a batch axis."""
    motion = np.asarray(problem.theta if theta is None else theta, dtype=float)[None]
    fixed, moving = (
        PointSet(points.means[None], points.covariances[None], points.weights[None])
        for points in (problem.fixed, problem.moving)
    )
    return motion, fixed, moving, problem.cost, problem.measurement


def dense_value(problem: Problem, theta: Any = None) -> float:
    """The cost by the formulas of `d2d.dense`, over all pairs at once."""
    return float(dense.value(*batch_of_one(problem, theta))[0])


def dense_gradient(problem: Problem, theta: Any = None) -> np.ndarray:
    """Gradient (P,) by the same formulas: -sum_ki gamma_ki dL_ki / d theta."""
    motion, fixed, moving, cost, measurement = batch_of_one(problem, theta)
    factor = None if measurement is None else dense.factor_of(measurement, motion)
    parts = dense.components(motion, fixed, moving, cost, factor)
    shares = dense.responsibilities(parts, cost)
    return -sum(
        np.einsum("bki,bkip->p", share, part.gradient)
        for share, part in zip(shares, parts, strict=True)
    )


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


def dense_hessian(problem: Problem, theta: Any = None) -> np.ndarray:
    """Hessian (P, P): differences of the gradient, good to about 1e-10."""
    theta = problem.theta if theta is None else theta
    return central_difference(lambda x: dense_gradient(problem, x), theta, steps_of(problem))


def overlapped_scene(
    runs: int, rng: np.random.Generator, sigma_range: float = 0.2, sigma_azimuth: float = 0.03
) -> tuple[PointSet, PointSet]:
    """Fixed and moving sets of ``runs`` noisy measurements of the eight targets, moved by TRUTH."""
    scene = replace(OVERLAPPED, sigma_range=sigma_range, sigma_azimuth=sigma_azimuth)
    return scene.sample(runs, rng)


seeds = st.integers(0, 2**32 - 1)


def reals(low: float, high: float) -> st.SearchStrategy[float]:
    """Finite numbers of an interval, for hypothesis."""
    return st.floats(low, high, allow_nan=False, allow_infinity=False)


def motions(dimension: int = 2) -> st.SearchStrategy[np.ndarray]:
    """Parameter vectors of rigid motions, for hypothesis."""
    shift = reals(-1e3, 1e3)
    if dimension == 1:
        return shift.map(lambda x: np.array([x]))
    return st.tuples(shift, shift, reals(-10.0, 10.0)).map(np.array)
