"""The compiled kernel: its exponential, blocks, charts, cut-off, trust region and cache."""

from __future__ import annotations

import gc
import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import njit
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import brentq

from d2d import CorruptedGaussian, LinearMeasurement, PointSet, RegistrationCost, _kernel, rigid
from d2d._kernel import compiling, elementary, layout, newton, pairs
from tests.strategies import (
    METRICS,
    OUTLIERS,
    Problem,
    case_id,
    dense_gradient,
    dense_hessian,
    dense_value,
    doppler_like,
    outlier_model,
    random_problem,
)

# ---- exp --------------------------------------------------------------------------------------


def _one(x):
    return elementary.exp(x)


def _loop(x, out):
    for i in range(len(x)):
        out[i] = elementary.exp(x[i])


def _shifted_loop(x, out):
    # as the kernel calls it: of a difference, times a weight, summed up
    total = 0.0
    for i in range(len(x)):
        out[i] = elementary.exp(2.0 * (x[i] * 0.5))
        total += out[i]
    return total


FLAGS = {"strict": False, "kernel": compiling.FAST, "all": True}


@pytest.fixture(scope="module", params=FLAGS)
def exponentials(request):
    """exp of an array, through a scalar call and through two loops, under a caller's flags."""
    options = {"fastmath": FLAGS[request.param], "error_model": "numpy"}
    one = njit(**options)(_one)
    loops = [njit(**options)(function) for function in (_loop, _shifted_loop)]

    def evaluate(x):
        yield np.array([one(value) for value in x])
        for loop in loops:
            out = np.empty_like(x)
            loop(x, out)
            yield out

    return evaluate


def test_exp_is_within_four_ulp(exponentials):
    """Breaks if a caller's fastmath cancels the rounding constant, or a digit of ln 2 is off."""
    rng = np.random.default_rng(1)
    x = np.concatenate(
        [
            -rng.uniform(0.0, 700.0, 40_000),
            -rng.uniform(0.0, 1.0, 20_000),
            -np.exp(rng.uniform(-40.0, 0.0, 5_000)),
            -math.log(2.0) * np.arange(0.0, 1009.5, 0.5),  # where the exponent steps
            [0.0, -0.0, -5e-324, -700.0],
        ]
    )
    x = np.maximum(x, -700.0)
    expected = np.exp(x)
    for actual in exponentials(x):
        assert (np.abs(actual - expected) <= 4.0 * np.spacing(expected)).all()


def test_exp_of_zero_is_one_and_far_below_it_is_negligible(exponentials):
    """Breaks if the nearest component's weight is not 1, or exp(-1000) wraps around."""
    for actual in exponentials(np.array([0.0, -0.0, -701.0, -745.0, -1e5, -1e300, -np.inf])):
        assert_array_equal(actual[:2], 1.0)
        assert (actual[2:] >= 0.0).all()
        assert (actual[2:] <= 1.0000001e-304).all()


# ---- log --------------------------------------------------------------------------------------


def _one_log(x):
    return elementary.log(x)


def _log_loop(x, out):
    for i in range(len(x)):
        out[i] = elementary.log(x[i])


@pytest.mark.parametrize("flags", FLAGS.values(), ids=FLAGS)
def test_log_is_within_three_ulp(flags):
    """Breaks if the exponent is taken from the wrong bits, or a coefficient is off."""
    rng = np.random.default_rng(1)
    x = np.concatenate(
        [
            np.exp(rng.uniform(-690.0, 690.0, 40_000)),
            rng.uniform(0.5, 2.0, 20_000),
            1.0 + np.exp(rng.uniform(-40.0, 0.0, 5_000)),
            2.0 ** np.arange(-1000.0, 1000.0),
            math.sqrt(2.0) * np.array([1.0 - 1e-15, 1.0, 1.0 + 1e-15]),
            [1.0, 1e-300],
        ]
    )
    expected = np.log(x)
    tolerance = 3.0 * np.maximum(np.spacing(np.abs(expected)), 1e-16)
    one, loop = njit(fastmath=flags)(_one_log), njit(fastmath=flags)(_log_loop)
    out = np.empty_like(x)
    loop(x, out)
    for actual in (out, np.array([one(value) for value in x])):
        assert (np.abs(actual - expected) <= tolerance).all()
    assert one(1.0) == 0.0


# ---- Blocks of targets ------------------------------------------------------------------------

BLOCKED = [
    {"dimension": 2, "metric": "d2d", "fusion": fusion, "outlier": outlier, "measured": measured}
    for fusion in ("likelihood", "summing")
    for outlier in OUTLIERS
    for measured in ("", "twist")
]


@pytest.mark.parametrize("size", [1, 7, 8, 9, 17])
@pytest.mark.parametrize("case", BLOCKED, ids=case_id)
def test_a_block_that_is_not_full_counts_its_targets_once(case, size):
    """Breaks if a lane without a target counts, or a target gets another one's measurement."""
    rng = np.random.default_rng(size)
    problem = random_problem(rng, moving_size=size, **case)
    value, gradient, hessian = problem.derivatives()
    assert_allclose(value, dense_value(problem, problem.theta), rtol=1e-12)
    assert_allclose(gradient, dense_gradient(problem, problem.theta), rtol=1e-10, atol=1e-11)
    expected = dense_hessian(problem, problem.theta)
    assert_allclose(hessian, expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())
    by_target = [
        problem.cost.target_densities(
            problem.theta,
            problem.fixed,
            PointSet(problem.moving.means[[k]], problem.moving.covariances[[k]]),
            measurement=None if problem.measurement is None else only(problem.measurement, k),
        )[0]
        for k in range(size)
    ]
    assert_allclose(problem.densities(), by_target, rtol=1e-12)


def only(measurement: LinearMeasurement, k: int) -> LinearMeasurement:
    """The measurement of target ``k``."""
    return LinearMeasurement(
        measurement.value[[k]],
        measurement.sigma[[k]],
        measurement.sigma_input[[k]],
        measurement.gain[[k]],
        measurement.slope[[k]],
        measurement.of_twist,
    )


def test_blocks_are_made_of_targets_of_like_size():
    """Breaks if a target is lost or taken twice, or if small and large ones share a block."""
    rng = np.random.default_rng(3)
    sizes = rng.permutation(64.0 ** np.arange(4).repeat(8) * rng.uniform(1.0, 2.0, 32))
    covariances = sizes[:, None, None] * np.eye(2)
    order = PointSet(rng.standard_normal((32, 2)), covariances)._order
    assert_array_equal(np.sort(order), np.arange(32))
    blocks = sizes[order].reshape(4, 8)
    assert (blocks.max(axis=1) <= 2.0 * blocks.min(axis=1)).all()


@pytest.mark.parametrize("size", [layout.CHUNK - 1, layout.CHUNK, layout.CHUNK + 1, 100])
@pytest.mark.parametrize("case", BLOCKED, ids=case_id)
def test_every_component_within_the_cut_off_counts_once(case, size):
    """Breaks if one is lost, or counts twice, where the components are cut into chunks."""
    problem = random_problem(np.random.default_rng(size), fixed_size=size, **case)
    value, gradient, hessian = problem.derivatives()
    assert_allclose(value, dense_value(problem, problem.theta), rtol=1e-12)
    assert_allclose(gradient, dense_gradient(problem, problem.theta), rtol=1e-10, atol=1e-11)
    expected = dense_hessian(problem, problem.theta)
    assert_allclose(hessian, expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())


# ---- The gate ---------------------------------------------------------------------------------


def wide_scene(metric: str, outlier: str, measured: str, fusion: str = "likelihood") -> Problem:
    """200 targets over two kilometres, in clusters, standard deviations from 1 cm to 100 m.

    Weights span four orders of magnitude, so that the gate's bound on them is far from tight.
    """
    rng = np.random.default_rng(2)
    count = 200
    centres = rng.uniform(-1000.0, 1000.0, (20, 2))

    def point_set(weights):
        means = centres[rng.integers(0, 20, count)] + 5.0 * rng.standard_normal((count, 2))
        sizes = 10.0 ** rng.uniform(-2.0, 2.0, (count, 2))
        angle = rng.uniform(0.0, np.pi, count)
        axes = np.stack([np.cos(angle), np.sin(angle), -np.sin(angle), np.cos(angle)], -1)
        axes = axes.reshape(count, 2, 2)
        # not more than 30 times as long as wide: else rounding, not the gate, is compared
        sizes[:, 1] = np.clip(sizes[:, 1], sizes[:, 0] / 30.0, sizes[:, 0] * 30.0)
        covariances = np.einsum("nia,na,nja->nij", axes, sizes**2, axes)
        return PointSet(means, 0.5 * (covariances + np.swapaxes(covariances, 1, 2)), weights)

    theta = np.array([1.0, -2.0, 0.02])
    fixed, moving = point_set(10.0 ** rng.uniform(-4.0, 0.0, count)), point_set(None)
    measurement = doppler_like(rng, theta, count, measured == "twist") if measured else None
    model = outlier_model(outlier, 2)
    return Problem(RegistrationCost(metric, fusion, model), theta, fixed, moving, measurement)


GATED = [
    {"dimension": 2, "metric": metric, "fusion": fusion, "outlier": outlier, "measured": measured}
    for metric in METRICS
    for fusion in ("likelihood", "summing")
    for outlier in OUTLIERS
    for measured in ("", "twist")
]


def gated_at(problem: Problem, gate: float) -> tuple[np.ndarray, ...]:
    """Value, gradient, Hessian and logarithms of the densities with another gate."""
    bound_problem = problem.cost.problem(problem.fixed, problem.moving, problem.measurement)
    bound = bound_problem.bind(problem.theta)
    bound = bound._replace(batch=bound.batch._replace(gate=gate))
    value, gradient, hessian = (array[0] for array in bound_problem.derivatives(bound))
    return value, gradient, hessian, bound_problem.log_densities(bound)


@pytest.mark.parametrize("case", GATED, ids=case_id)
def test_the_gate_changes_nothing(case):
    """Breaks if a pair that matters is skipped: the bound must hold for any size and weight."""
    problem = wide_scene(case["metric"], case["outlier"], case["measured"], case["fusion"])
    value, gradient, hessian, logs = gated_at(problem, pairs.GATE)
    open_value, open_gradient, open_hessian, open_logs = gated_at(problem, np.inf)
    assert_allclose(value, open_value, rtol=1e-13)
    natural = np.sqrt(np.abs(np.diag(open_hessian)))
    assert (np.abs(gradient - open_gradient) <= 1e-12 * abs(value) * natural).all()
    assert (np.abs(hessian - open_hessian) <= 1e-12 * abs(value) * np.outer(natural, natural)).all()
    assert_allclose(np.exp(logs), np.exp(open_logs), rtol=1e-12)
    assert_array_equal(problem.derivatives()[0], value)  # the gate that is compared is in use


def test_a_gate_too_narrow_is_noticed():
    """Breaks if the comparison above misses the gate: this one skips what matters."""
    problem = wide_scene("d2d", "none", measured="")
    *_, expected = gated_at(problem, pairs.GATE)
    *_, narrow = gated_at(problem, -45.0)
    assert (narrow < expected - 1e-3).any()


@pytest.mark.parametrize("outlier", OUTLIERS)
@pytest.mark.parametrize("metric", METRICS)
def test_the_wide_scene_equals_dense_numpy(metric, outlier):
    """Breaks if the sums over 200 components lose accuracy, whatever the gate does."""
    problem = wide_scene(metric, outlier, measured="")
    value, gradient, hessian = problem.derivatives()
    assert_allclose(value, dense_value(problem, problem.theta), rtol=1e-12)
    expected = dense_gradient(problem, problem.theta)
    assert_allclose(gradient, expected, rtol=1e-10, atol=1e-12 * abs(value))
    expected = dense_hessian(problem, problem.theta)
    assert_allclose(hessian, expected, rtol=1e-6, atol=1e-10 * np.abs(expected).max())


def test_most_pairs_of_the_wide_scene_are_beyond_the_gate():
    """Breaks if the scene above no longer gives the gate anything to skip."""
    problem = wide_scene("d2d", "none", measured="")
    theta, f, m = problem.theta, problem.fixed, problem.moving
    moved = m.transformed(theta)
    d = moved.means[:, None] - f.means
    s = moved.covariances[:, None] + f.covariances
    half = 0.5 * np.einsum("kni,kni->kn", d, np.linalg.solve(s, d[..., None])[..., 0])
    logs = np.log(f.weights) - half - 0.5 * np.linalg.slogdet(s)[1]
    below = logs.max(axis=1, keepdims=True) - logs
    assert (below > pairs.GATE + 10.0).mean() > 0.5
    assert 0.02 < (below < pairs.GATE).mean() < 0.5


# ---- The trust region -------------------------------------------------------------------------


def best_decrease(h: np.ndarray, g: np.ndarray, scale: np.ndarray, radius: float) -> float:
    """Of the quadratic model within the radius, by the eigenvectors of the scaled Hessian."""
    root = np.sqrt(scale)
    values, vectors = np.linalg.eigh(h / np.outer(root, root))
    slope = vectors.T @ (g / root)

    def length(shift):
        return np.linalg.norm(slope / (values + shift))

    shift = 0.0
    if values[0] <= 0.0 or length(0.0) > radius:
        low = max(0.0, -values[0]) + 1e-14 * np.abs(values).max()
        high = low + np.linalg.norm(slope) / radius + np.abs(values).max()
        shift = brentq(lambda s: 1.0 / radius - 1.0 / length(s), low, high, rtol=1e-14)
    y = -slope / (values + shift)
    return float(-(slope @ y + 0.5 * y @ (values * y)))


@pytest.mark.parametrize("seed", range(4))
def test_trust_region_step_is_nearly_the_best_within_the_radius(seed):
    """Breaks if the shift's search ends at a step too long, or one that lowers the model little."""
    rng = np.random.default_rng(seed)
    for _ in range(300):
        h = rng.standard_normal((3, 3)) * 10.0 ** rng.uniform(-3.0, 3.0)
        h = h + h.T + rng.choice([0.0, 1.0, 10.0]) * np.abs(h).max() * np.eye(3)
        scale = np.array([1.0, 1.0, 10.0 ** rng.uniform(-1.0, 3.0)])
        h *= np.sqrt(np.outer(scale, scale))
        g = rng.standard_normal(3) * 10.0 ** rng.uniform(-3.0, 3.0) * np.sqrt(scale)
        radius = 10.0 ** rng.uniform(-3.0, 3.0)
        step = np.full(3, np.nan)
        decrease = newton.trust_region_step(h, g, scale, radius, 1.0, np.empty((5, 3)), step)
        assert np.sqrt((scale * step**2).sum()) <= 1.1 * radius * (1.0 + 1e-9)
        assert_allclose(decrease, -(g @ step + 0.5 * step @ h @ step), rtol=1e-9)
        assert decrease >= 0.75 * best_decrease(h, g, scale, radius)


def test_trust_region_step_on_a_plateau_is_zero():
    """Breaks if the step stays what the memory held before: with g = 0 and H = 0 no shift helps."""
    step = np.array([20.0, 3.0, 0.1])
    decrease = newton.trust_region_step(
        np.zeros((3, 3)), np.zeros(3), np.ones(3), 1.0, 1.0, np.empty((5, 3)), step
    )
    assert_array_equal(step, 0.0)
    assert decrease == 0.0


def _calls_a_part(h, g, step):
    return newton.decrease(h, g, step)


def test_a_part_without_a_wrapper_may_be_called_from_python():
    """Breaks if Python jumps to the address 0: a part is compiled for compiled callers alone."""
    rng = np.random.default_rng(3)
    h, g, step = rng.standard_normal((3, 3)), *rng.standard_normal((2, 3))
    expected = -(g @ step + 0.5 * step @ h @ step)
    assert_allclose(newton.decrease(h, g, step), expected)
    assert_allclose(njit(_calls_a_part)(h, g, step), expected)
    assert_allclose(newton.decrease(h, g, step), expected)


@pytest.mark.parametrize("collecting", [True, False])
def test_compiling_leaves_the_collector_as_it_was(collecting):
    """Breaks if what is switched off while compiling stays off, or is switched on."""
    seen = []

    def fails():
        seen.append(gc.isenabled())
        raise ValueError("it fails")

    was = gc.isenabled()
    try:
        (gc.enable if collecting else gc.disable)()
        with pytest.raises(ValueError, match="it fails"):
            compiling.unhindered(fails)()
        assert seen == [False]
        assert gc.isenabled() == collecting
    finally:
        (gc.enable if was else gc.disable)()


@pytest.mark.parametrize("shift", [0.0, 0.3])
def test_shifted_solve_equals_a_general_solver(shift):
    """Breaks on a wrong factor, a wrong derivative or a Hessian wrongly called definite."""
    rng = np.random.default_rng(5)
    refused = 0
    for _ in range(300):
        root = rng.standard_normal((3, 3))
        h = root @ np.diag([1.0, 2.0, rng.choice([-1.0, 0.5])]) @ root.T
        h = 0.5 * (h + h.T)
        g, scale, step = rng.standard_normal(3), rng.uniform(0.5, 5.0, 3), np.empty(3)
        shifted = h + shift * np.diag(scale)
        definite, slope = newton.shifted_solve(h, g, shift, scale, step)
        assert definite == (np.linalg.eigvalsh(shifted)[0] > 0.0)
        if not definite:
            refused += 1
            continue
        assert_allclose(step, np.linalg.solve(shifted, -g), rtol=1e-7, atol=1e-9)
        along = scale * step
        assert_allclose(slope, along @ np.linalg.solve(shifted, along), rtol=1e-7)
    assert 30 < refused < 270


def test_shifted_solve_refuses_singular_matrices_with_rounding_errors():
    """Breaks if rounding above zero counts as definite and what is unobservable converges."""
    rng = np.random.default_rng(7)
    for _ in range(300):
        root = rng.standard_normal((3, 2)) * [[1.0], [1.0], [30.0]]
        definite, _ = newton.shifted_solve(
            root @ root.T, rng.standard_normal(3), 0.0, np.ones(3), np.empty(3)
        )
        assert not definite


def test_a_set_on_a_line_has_density_one_along_the_other_axis():
    """Breaks if the variance that stands in for the missing dimension changes."""
    assert_allclose(2.0 * np.pi * _kernel.UNIT_DENSITY_VARIANCE, 1.0, rtol=1e-15)
    problem = random_problem(np.random.default_rng(6), dimension=1)
    assert_array_equal(problem.fixed._packed[_kernel.YY], _kernel.UNIT_DENSITY_VARIANCE)


# ---- The cache --------------------------------------------------------------------------------

ROOT = Path(__file__).resolve().parents[1]
KERNEL_MODULES = sorted(path.name for path in (ROOT / "d2d" / "_kernel").glob("*.py"))


@pytest.fixture
def package_copy(tmp_path):
    """A copy of the package and of its tests that may be edited."""
    for name in ("d2d", "tests"):
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, tmp_path / name, ignore=ignored)
    return tmp_path


def run_copy(folder: Path, program: str, *arguments: str) -> str:
    """Run a program with the package in a folder, which keeps its compiled code there, too."""
    environment = os.environ | {
        "NUMBA_CACHE_DIR": str(folder / "cache"),
        "PYTHONPATH": str(folder),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.run(
        command, env=environment, cwd=folder, capture_output=True, check=True, text=True
    ).stdout


def test_what_is_compiled_is_kept_until_a_module_changes(package_copy):
    """Breaks if a cached function calls a stale one: Numba itself looks at one file only."""
    program = """
import numpy as np
from d2d._kernel import pack_targets
sets = np.ones((1, 1, 2)), np.eye(2)[None, None], np.ones((1, 1))
pack_targets(*sets, np.empty((6, 1)), np.empty((1, 3)), np.empty((1, 2)))
print(sum(pack_targets.stats.cache_hits.values()))
"""
    assert run_copy(package_copy, program).split() == ["0"]
    assert run_copy(package_copy, program).split() == ["1"]
    edit(package_copy / "d2d" / "_kernel" / "pairs.py")
    assert run_copy(package_copy, program).split() == ["0"]


def edit(path: Path) -> None:
    """Change a module."""
    with path.open("a", encoding="utf-8") as file:
        file.write("# an edit\n")


@pytest.mark.parametrize("module", KERNEL_MODULES)
def test_an_edit_of_any_module_of_the_kernel_is_noticed(package_copy, module):
    """Breaks if a module does not count in what the cache depends on."""
    kernel = package_copy / "d2d" / "_kernel"
    before = compiling.source_stamp(kernel)
    edit(kernel / module)
    assert compiling.source_stamp(kernel) != before
    assert before == compiling._STAMP


def test_the_process_that_compiles_gets_the_bits_of_those_that_load(package_copy):
    """Breaks if LLVM may order sums by its own choice: then workers differ from who compiled."""
    program = """
import numpy as np
from d2d import CorruptedGaussian, RegistrationCost
from d2d.study import scenarios
scene = scenarios.OVERLAPPED
cost = RegistrationCost(outlier=CorruptedGaussian(0.2, 100 * np.eye(2)))
sets = scene.sample(300, np.random.default_rng(0))
found = cost.derivatives(scene.theta, *sets)
print(*(array.tobytes().hex() for array in found))
"""
    first, second = (run_copy(package_copy, program) for _ in range(2))
    assert list((package_copy / "cache").rglob("*.nbc"))
    assert first == second


# ---- Far away ---------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", np.linspace(0.0, 3.0, 31))
def test_an_elongated_component_far_away_still_pulls(angle):
    """Breaks if two passes take a pair's distance by formulas that round differently."""
    turn = rigid.rotation(angle)
    covariance = turn @ np.diag([10.0, 1e-3]) @ turn.T
    fixed = PointSet(np.zeros((1, 2)), [0.5 * (covariance + covariance.T)])
    moving = PointSet(np.zeros((1, 2)), [np.eye(2)])
    theta = np.array([*(1e9 * turn[:, 0]), 0.0])
    value, gradient, _ = RegistrationCost(metric="p2d").derivatives(theta, fixed, moving)
    assert_allclose(value, 0.5 * 1e18 / 10.0, rtol=1e-2)
    assert_allclose(gradient[:2] @ turn[:, 0], 1e9 / 10.0, rtol=1e-2)


def test_a_component_beyond_the_cut_off_leaves_other_targets_alone():
    """Breaks if a target without further components meets one so far away that it overflows."""
    moving = PointSet([[0.0, 0.0], [8.0, 1.0]], np.tile([[0.1, 0.02], [0.02, 0.2]], (2, 1, 1)))
    near = np.array([[0.0, 0.0], [0.5, 0.0]])
    far = PointSet(np.vstack([near, [[1e80, 0.0]]]), np.tile(np.eye(2), (3, 1, 1)))
    some = RegistrationCost().derivatives([0.0, 0.0, 0.1], far, moving)
    third = PointSet(np.vstack([near, [[1e6, 0.0]]]), far.covariances)
    for actual, expected in zip(
        some, RegistrationCost().derivatives([0.0, 0.0, 0.1], third, moving), strict=True
    ):
        assert_allclose(actual, expected, rtol=1e-12, atol=1e-9)


def test_many_heavy_components_far_away_are_no_plateau():
    """Breaks if what exp() is cut off at, times all weights, passes for a density."""
    count = 20_000
    fixed = PointSet(np.zeros((count, 2)), np.tile(np.eye(2), (count, 1, 1)), np.full(count, 1e100))
    moving = PointSet(np.zeros((1, 2)), [np.eye(2)])
    cost = RegistrationCost(outlier=CorruptedGaussian(0.2, 100.0 * np.eye(2)))
    expected = 0.5 * 1e12 / 100.0  # half the squared distance in the outlier component's sigmas
    assert_allclose(cost.value([1e6, 0.0, 0.0], fixed, moving), expected, rtol=1e-6)
