"""60 000 random registrations at extreme scales: none may crash, hang or lie about its outcome.

The unit of length runs from 1e-6 to 1e6 m, standard deviations from 1e-6 to 1000 units, weights
over a hundred decades, angles to a million radians; sets of 1 to 40 targets lie apart, on one spot
or on a line.  What may come out is an honest "not converged" or an optimum whose numbers belong
together.
"""

import subprocess
import sys
from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np
import pytest

from d2d import (
    CorruptedGaussian,
    LinearMeasurement,
    PointSet,
    RegistrationCost,
    UniformOutlier,
    register,
    rigid,
)
from tests.strategies import FUSIONS, METRICS, Problem, dense_gradient, dense_value, steps_of

BATCH = 250
ROUNDS = 6  # of each case; 2 x 2 x 2 x 5 cases
LAYOUTS = ("apart", "far", "one spot", "overlapping", "on a line", "coincident")
OUTLIERS = ("none", "uniform", "corrupted", "never", "only")


def random_batch(
    rng: np.random.Generator, dimension: int, metric: Any, fusion: Any, outlier: str, measured: bool
) -> Problem:
    """``BATCH`` problems of one cost, each at a scale and in a layout of its own."""
    fixed_size, moving_size = np.minimum(rng.geometric(0.12, 2), 40)
    unit = 10.0 ** rng.uniform(-6.0, 6.0, (BATCH, 1, 1))
    sigma = unit * 10.0 ** rng.uniform(-4.0, 1.0, (BATCH, 1, 1))
    fixed = rng.uniform(-1.0, 1.0, (BATCH, fixed_size, dimension)) * unit
    moving = rng.uniform(-1.0, 1.0, (BATCH, moving_size, dimension)) * unit
    layout = np.array(LAYOUTS)[rng.integers(0, len(LAYOUTS), BATCH)]
    partner = rng.integers(0, fixed_size, (BATCH, moving_size, 1))
    moving[layout == "far"] += (unit * 10.0 ** rng.uniform(0.0, 6.0, unit.shape))[layout == "far"]
    fixed[layout == "one spot"] = fixed[layout == "one spot", :1]
    for name, noise in (("one spot", 0.0), ("overlapping", 1.0), ("coincident", 0.0)):
        near = np.take_along_axis(fixed, partner, axis=1)
        near = near + noise * sigma * rng.standard_normal(moving.shape)
        moving[layout == name] = near[layout == name]
    for points in (fixed, moving):
        points[layout == "on a line", :, -1] = 0.0
    weights = None
    if rng.random() < 0.5:
        weights = 10.0 ** rng.uniform(-rng.choice([1, 10, 100]), 0.0, (BATCH, fixed_size))
    theta = np.zeros((BATCH, rigid.PARAMETERS[dimension]))
    away = rng.choice([0.0, 1.0, 1e3], (BATCH, 1))
    theta[:, :dimension] = sigma[:, 0] * away * rng.standard_normal((BATCH, dimension))
    if dimension == 2:
        theta[:, 2] = rng.uniform(-np.pi, np.pi, BATCH) * rng.choice([0, 1e-9, 0.1, 1], BATCH)
    return Problem(
        RegistrationCost(metric, fusion, model(rng, outlier, dimension, float(np.median(sigma)))),
        theta,
        PointSet(fixed, spreads(rng, sigma[..., 0], fixed.shape), weights),
        PointSet(moving, spreads(rng, sigma[..., 0], moving.shape)),
        doppler(rng, sigma[..., 0], moving_size, theta.shape[1]) if measured else None,
    )


def spreads(rng: np.random.Generator, sigma: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Covariances (B, N, D, D), of one size or many, round or as thin as 1 : 100 000."""
    batch, size, dimension = shape
    sigma = sigma * 10.0 ** (rng.integers(0, 2) * rng.uniform(-2.0, 2.0, (batch, size)))
    if dimension == 1:
        return sigma[..., None, None] ** 2
    thin = sigma * 10.0 ** (rng.integers(0, 2) * rng.uniform(-5.0, 0.0, (batch, size)))
    angle = rng.uniform(-np.pi, np.pi, (batch, size))
    c, s = np.cos(angle), np.sin(angle)
    xx, xy, yy = (
        (sigma * c) ** 2 + (thin * s) ** 2,
        (sigma**2 - thin**2) * c * s,
        (sigma * s) ** 2 + (thin * c) ** 2,
    )
    return np.stack([xx, xy, xy, yy], axis=-1).reshape(batch, size, 2, 2)


def model(rng: np.random.Generator, kind: str, dimension: int, sigma: float) -> Any:
    """An outlier model of any size beside the targets."""
    if kind == "none":
        return None
    if kind == "uniform":
        return UniformOutlier(10.0 ** rng.uniform(-10.0, 6.0))
    fraction = {"corrupted": rng.choice([0.2, 1e-9]), "never": 0.0, "only": 1.0}[kind]
    wide = sigma * 10.0 ** rng.uniform(-2.0, 4.0)
    return CorruptedGaussian(float(fraction), wide**2 * np.eye(dimension))


def doppler(
    rng: np.random.Generator, sigma: np.ndarray, size: int, parameters: int
) -> LinearMeasurement:
    """Measurements of any precision and size, some with a variance that grows with the motion."""
    gain, slope = rng.standard_normal((2, len(sigma), size, parameters))
    own = sigma * 10.0 ** rng.uniform(-3.0, 3.0, (len(sigma), size))
    value = own * 10.0 ** rng.uniform(-1.0, 2.0) * rng.standard_normal(own.shape)
    twist = parameters == 3 and rng.random() < 0.5
    return LinearMeasurement(value, own, rng.choice([0.0, 0.1, 10.0]), gain, slope, bool(twist))


def honestly_converged(problem: Problem) -> int:
    """How many converge; checks that what is said of each belongs together."""
    estimate = problem.register()
    good = estimate.converged
    for name in ("theta", "value", "gradient", "hessian"):
        assert np.isfinite(getattr(estimate, name)).all(), name
    assert np.isnan(estimate.covariance[~good & ~estimate.undetermined]).all()
    assert not (good & estimate.undetermined).any()
    start, blur = problem.value(), 10.0 * rounding_of(problem)
    assert (estimate.value <= start + blur * (1.0 + np.abs(start))).all()
    value, gradient, hessian = problem.derivatives(estimate.theta)
    exact = (1e-13 + blur) * (problem.moving.size + np.abs(value))
    assert (np.abs(estimate.value - value) <= exact).all()
    # but for pairs that vanish beside others, and are in one of the two sums only
    size = 1e-3 / steps_of(problem)
    each = ((1e-12 + 100.0 * blur) * (problem.moving.size + np.abs(value)))[:, None] * size
    assert (np.abs(estimate.gradient - gradient) <= each).all()
    assert (np.abs(estimate.hessian - hessian) <= each[:, :, None] * size).all()
    covariance = estimate.covariance[good]
    assert np.isfinite(covariance).all()
    size = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    unit = covariance / (size[:, :, None] * size[:, None, :])
    assert (np.linalg.eigvalsh(unit)[:, 0] > 0.0).all()
    return int(good.sum())


def rounding_of(problem: Problem) -> np.ndarray:
    """How far (B,) targets move, in standard deviations, by the rounding of a motion.

    The descent is about the middle of the sets, the motion about the origin.
    """
    points = (problem.fixed, problem.moving)
    away = max_of(np.abs(problem.theta)) + sum(max_of(np.abs(each.means)) for each in points)
    away = away * (1.0 + np.abs(problem.theta[:, -1]) * (problem.theta.shape[1] == 3))
    thin = np.minimum(*(np.linalg.eigvalsh(each.covariances)[..., 0].min(-1) for each in points))
    if isinstance(problem.cost.outlier, CorruptedGaussian):
        thin = np.minimum(thin, problem.cost.outlier.covariance[0, 0])
    return 2e-16 * away / np.sqrt(thin)


def max_of(array: np.ndarray) -> np.ndarray:
    return array.reshape(len(array), -1).max(axis=-1)


CASES = pytest.mark.parametrize("outlier", OUTLIERS)


def costs(outlier: str, seed: int) -> Iterator[tuple[int, Any, Any, np.random.Generator]]:
    """Dimension, metric and fusion of each cost with this outlier model, and a generator."""
    for numbers in product((1, 2), range(2), range(2)):
        rng = np.random.default_rng([seed, *numbers, OUTLIERS.index(outlier)])
        yield numbers[0], METRICS[numbers[1]], FUSIONS[numbers[2]], rng


@CASES
def test_no_result_is_dishonest(outlier):
    """Breaks on nan with converged=True, a covariance that is none, or a cost above the start's."""
    for dimension, metric, fusion, rng in costs(outlier, 0):
        converged = 0
        for _ in range(ROUNDS):
            problem = random_batch(rng, dimension, metric, fusion, outlier, rng.random() < 0.5)
            converged += honestly_converged(problem)
        # else the problems are too hopeless to tell anything
        assert converged > 0.1 * BATCH * ROUNDS


def member(problem: Problem, i: int) -> Problem:
    z, names = problem.measurement, ("value", "sigma", "sigma_input", "gain", "slope")
    return problem.with_(
        theta=problem.theta[i],
        fixed=problem.fixed[i],
        moving=problem.moving[i],
        measurement=z and LinearMeasurement(*(getattr(z, name)[i] for name in names), z.of_twist),
    )


@CASES
def test_value_and_gradient_equal_dense_numpy(outlier):
    """Breaks if a pair that matters is skipped, or a lane works on another one's numbers.

    Both sides round: a squared distance of u^2 standard deviations by 1e-16 u^2, and the matrix of
    a target as thin as 1 : r by 1e-16 r^2, so that less is asked of thin targets and nothing of
    those a hundred million standard deviations away.
    """
    for dimension, metric, fusion, rng in costs(outlier, 9):
        compared = 0
        for _ in range(4):
            batch = random_batch(rng, dimension, metric, fusion, outlier, rng.random() < 0.5)
            values, gradients, _ = batch.derivatives()
            blur = rounding_of(batch)
            for i in rng.choice(BATCH, 8, replace=False):
                one = member(batch, i)
                expected = dense_value(one)
                if abs(expected) > 1e16:
                    continue
                compared += 1
                rounding = 1e-14 * (1e3 + thinness(one) ** 2) + blur[i]
                assert abs(values[i] - expected) <= rounding * (abs(expected) + one.moving.size)
                slope = dense_gradient(one)
                natural = np.abs(slope) + 1e-3 * np.abs(slope).max() + 1e-3 / steps_of(one)
                if isinstance(one.cost.outlier, CorruptedGaussian):
                    natural += 1.0 / np.sqrt(one.cost.outlier.covariance[0, 0])
                assert (np.abs(gradients[i] - slope) <= 1e4 * rounding * natural).all()
        assert compared > 10


def thinness(problem: Problem) -> float:
    """Length over width of the thinnest target."""
    both = (np.linalg.eigvalsh(each.covariances) for each in (problem.fixed, problem.moving))
    return float(max(np.sqrt(values[:, -1] / values[:, 0]).max() for values in both))


# ---- Found by this fuzz


def test_a_plateau_with_a_measurement_is_no_optimum():
    """Breaks if the measurement of a target that is surely an outlier makes a plateau an optimum.

    The target is 100 standard deviations from its only counterpart: a share of its measurement as
    small as 1e-304 would give a variance of 1e299.
    """
    fixed, moving = (PointSet([[x]], [[[1.0]]]) for x in (0.0, 100.0))
    measurement = LinearMeasurement([0.0], 1.0, 0.0, [[1.0]], [[0.0]])
    cost = RegistrationCost(outlier=UniformOutlier(0.01))
    assert not register(fixed, moving, cost, measurement=measurement).converged


EXTREMES = """
import sys
import numpy as np
from d2d import (
    CorruptedGaussian, LinearMeasurement, PointSet, RegistrationCost, UniformOutlier, multi_start,
    propagate_covariance, register, sandwich_covariance,
)
rng = np.random.default_rng(0)
ended = refused = 0
while ended + refused < 3000:
    size = lambda most: 10.0 ** rng.uniform(-most, most)
    shape = rng.integers(1, 90, 2) if rng.random() < 0.1 else rng.integers(1, 9, 2)
    most = rng.choice([5.0, 45.0, 170.0, 305.0])
    try:
        fixed, moving = (
            PointSet(size(most) * rng.standard_normal((n, 2)), size(most) * np.eye(2),
                     np.full(n, size(min(most, 110.0))))
            for n in shape
        )
        outlier = [None, UniformOutlier(size(most)), CorruptedGaussian(0.2, size(most) * np.eye(2))]
        cost = RegistrationCost(*[str(rng.choice(two)) for two in (["d2d", "p2d"], ["likelihood",
                                "summing"])], outlier[rng.integers(3)])
        measurement = None
        if rng.random() < 0.2:
            gain, slope = size(most) * rng.standard_normal((2, shape[1], 3))
            measurement = LinearMeasurement(np.zeros(shape[1]), size(most), size(most), gain, slope)
        start = np.append(size(most) * rng.standard_normal(2), rng.uniform(-6.0, 6.0))
        found = register(fixed, moving, cost, start, measurement=measurement)
        propagate_covariance(found, fixed, moving, cost, measurement=measurement)
        sandwich_covariance(found, fixed, moving, cost, measurement=measurement)
        assert not found.converged or np.isfinite(found.covariance).all()
        ended += 1
    except ValueError:
        refused += 1
print(ended)
"""


@pytest.mark.filterwarnings("ignore")
def test_every_call_ends():
    """Breaks if a loop of the kernel runs for ever on numbers that are accepted."""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", EXTREMES],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 700
