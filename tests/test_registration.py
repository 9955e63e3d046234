"""register: the optimum, its covariance, and what it says when there is none."""

from dataclasses import fields
from itertools import product

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import minimize

from d2d import (
    ANNEALED,
    CorruptedGaussian,
    Estimate,
    LinearMeasurement,
    PointSet,
    RegistrationCost,
    UniformOutlier,
    fisher_covariance,
    multi_start,
    register,
    rigid,
    start_grid,
)
from d2d.study.point_sets.convergence import is_registered
from d2d.study.point_sets.room_scans import room_scan
from tests.strategies import (
    FUSIONS,
    METRICS,
    OUTLIERS,
    ROBUST,
    TRUTH,
    Problem,
    dense_gradient,
    dense_hessian,
    dense_value,
    doppler_like,
    in_unit,
    outlier_model,
    overlapped_scene,
    reals,
    seeds,
    spd,
)

FIELDS = [field.name for field in fields(Estimate)]
SCHEDULE = (10.0, 5.5, 3.2, 1.7, 1.0)
SCALES = (2.0, 1.0)


def assert_same(ours, theirs, index=()):
    """All fields equal bit for bit."""
    for name in FIELDS:
        assert_array_equal(getattr(ours, name)[index], getattr(theirs, name), err_msg=name)


def scene(
    seed: int,
    dimension: int = 2,
    metric: str = "d2d",
    fusion: str = "likelihood",
    outlier: str = "none",
    measured: str = "",
    count: int = 7,
) -> Problem:
    """Noisy copies of ``count`` targets, two of them without a partner, seen from two poses."""
    rng = np.random.default_rng(seed)
    parameters = rigid.PARAMETERS[dimension]
    theta = np.array([1.5, -0.8, 0.2])[:parameters]
    # seen from some way off, as a sensor does: rotation and translation are not alike
    targets = rng.uniform(-8.0, 8.0, (count, dimension)) + np.array([15.0, 0.0])[:dimension]

    def seen(means):
        covariances = spd(rng, count, dimension, 0.4)
        noise = rng.standard_normal((count, dimension))
        factor = np.linalg.cholesky(covariances)
        return PointSet(means + np.einsum("nij,nj->ni", factor, noise), covariances)

    fixed = seen(targets)
    strangers = targets + np.where(np.arange(count) < 2, 4.0, 0.0)[:, None]
    moving = seen(rigid.transform_means(rigid.inverse(theta), strangers))
    measurement = doppler_like(rng, theta, count, measured == "twist") if measured else None
    cost = RegistrationCost(metric, fusion, outlier_model(outlier, dimension))
    return Problem(cost, theta, fixed, moving, measurement)


def starts_around(problem: Problem, count: int, seed: int) -> np.ndarray:
    """Starts (count, P) around the true motion; the first is the truth."""
    rng = np.random.default_rng(seed)
    size = np.array([2.0, 2.0, 0.2])[: len(problem.theta)]
    offsets = size * rng.standard_normal((count, len(problem.theta)))
    offsets[0] = 0.0
    return problem.theta + offsets


def iso(means, sigma):
    return PointSet(means, sigma**2 * np.eye(2))


CASES = [
    (2, "d2d", "likelihood", "none", ""),
    (2, "d2d", "likelihood", "corrupted", "twist"),
    (2, "d2d", "summing", "none", ""),
    (2, "p2d", "likelihood", "uniform", "motion"),
    (2, "p2d", "summing", "corrupted", ""),
    (1, "d2d", "likelihood", "corrupted", "motion"),
    (1, "p2d", "summing", "none", ""),
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: "-".join(map(str, case)).rstrip("-"))
def test_best_optimum_is_that_of_scipy(case):
    """Breaks if Newton's iteration ends anywhere but at the optimum of the stated cost."""
    problem = scene(1, *case)
    starts = starts_around(problem, 8, 1)
    estimate = problem.register(starts)
    best = int(np.nanargmin(np.where(estimate.converged, estimate.value, np.nan)))

    # SciPy works in the units of the expected errors, on the dense reference cost
    unit = np.sqrt(np.diag(estimate.covariance[best]))
    found = [
        minimize(
            lambda x: dense_value(problem, x * unit),
            start / unit,
            jac=lambda x: dense_gradient(problem, x * unit) * unit,
            method="BFGS",
            options={"gtol": 1e-7},
        )
        for start in starts
    ]
    winner = min(found, key=lambda result: result.fun)
    theta = winner.x * unit
    theta -= np.linalg.solve(dense_hessian(problem, theta), dense_gradient(problem, theta))
    assert_allclose(estimate.value[best], winner.fun, rtol=1e-9, atol=1e-9)
    assert (np.abs(estimate.theta[best] - theta) <= 1e-6 * unit).all()
    expected = np.linalg.inv(dense_hessian(problem, theta))
    assert_allclose(estimate.covariance[best], expected, rtol=1e-5, atol=1e-7 * unit.max() ** 2)


@pytest.mark.parametrize("outlier", OUTLIERS)
def test_what_converged_is_a_minimum_with_its_covariance(outlier):
    """Breaks if converged, covariance or the fields of the estimate do not belong together."""
    for dimension, metric, fusion in product((1, 2), METRICS, FUSIONS):
        problem = scene(3, dimension, metric, fusion, outlier, "motion")
        estimate = problem.register(starts_around(problem, 60, 3))
        good = estimate.converged
        assert good.mean() > 0.8
        assert_array_equal(np.isnan(estimate.covariance).all(axis=(-2, -1)), ~good)
        assert_array_equal(np.isnan(estimate.covariance).any(axis=(-2, -1)), ~good)
        fisher = fisher_covariance(estimate.hessian[good])
        sigma = np.sqrt(np.einsum("nii->ni", fisher))
        allowed = 1e-9 * sigma[:, :, None] * sigma[:, None, :]
        assert (np.abs(estimate.covariance[good] - fisher) <= allowed).all()
        unit = estimate.covariance[good] @ estimate.hessian[good]
        assert_allclose(unit, np.broadcast_to(np.eye(len(problem.theta)), unit.shape), atol=1e-9)
        # in units of standard deviations the gradient vanishes and the Hessian is positive definite
        size = np.sqrt(np.einsum("nii->ni", estimate.hessian[good]))
        assert np.abs(estimate.gradient[good] / size).max() < 1e-6
        assert (np.linalg.eigvalsh(estimate.hessian[good])[:, 0] > 0.0).all()


def test_a_schedule_never_ends_higher_than_none():
    """Breaks if a schedule leaves the well of a good start: so did one of ten spacings' width."""
    fixed, moving = overlapped_scene(200, np.random.default_rng(3))
    rng = np.random.default_rng(4)
    for spread in (0.1, 1.0, 4.0):
        starts = TRUTH + spread * rng.standard_normal((200, 3)) * [1.0, 1.0, 0.1]
        for cost in (ROBUST, RegistrationCost(), RegistrationCost(outlier=UniformOutlier(1e-3))):
            plain = register(fixed, moving, cost, starts)
            found = register(fixed, moving, cost, starts, ANNEALED)
            assert (found.value <= plain.value).all()
            near = np.abs(plain.theta - TRUTH).max(axis=-1) < 1.0
            assert (np.abs(found.theta[near] - TRUTH).max(axis=-1) < 1.0).mean() > 0.95
    # a needle so thin that the cost of some scales is undefined
    fixed = PointSet(rng.uniform(-38.0, 38.0, (70, 2)), 1e-6 * np.eye(2))
    needle = PointSet([[0.03, 0.0]], np.diag([2e18, 16.0]))
    for angle in np.linspace(0.0, 3.0, 60):
        moving = needle.transformed([0.0, 0.0, angle])
        plain, found = (register(fixed, moving, ROBUST, None, s) for s in ((1.0,), ANNEALED))
        assert found.value <= plain.value or np.isnan(plain.value)


def test_a_schedule_reaches_the_most_precise_target():
    """Breaks if a target that is known to a millimetre is passed by, hundreds of sigmas off."""
    rng = np.random.default_rng(5)
    sigmas = np.full(31, 0.1)
    sigmas[7] = 0.001
    covariances = sigmas[:, None, None] ** 2 * np.eye(2)
    means = rng.uniform(-20.0, 20.0, (40, 31, 2))
    fixed, moving = (
        PointSet(means + sigmas[:, None] * rng.standard_normal(means.shape), covariances)
        for _ in range(2)
    )
    found = register(fixed, moving, ROBUST, [0.5, -0.4, 0.02], ANNEALED)
    assert found.converged.all()
    at_mark = rigid.transform_means(found.theta, moving.means)[:, 7] - fixed.means[:, 7]
    assert np.abs(at_mark).max() < 0.01


@pytest.mark.parametrize("sigma", [0.1, 0.05])
def test_a_schedule_keeps_a_good_start_on_walls(sigma):
    """Breaks if dense places upon dense places, at a lower cost, replace a good registration.

    In a hall with cabinets, whose walls two scans sample anew, the lower cost alone keeps a half.
    """
    rng = np.random.default_rng(0)
    box = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    right = []
    for _ in range(30):
        places = np.column_stack([rng.uniform(1.0, 18.0, 6), rng.choice([-1.2, 0.8], 6)])
        hall = [[-2.0, -1.2] + [22.0, 2.4] * box, *(place + [0.8, 0.4] * box for place in places)]
        truth = rng.uniform([0.3, -0.2, -0.5], [2.5, 0.2, 0.5])
        fixed, moving = (
            iso(room_scan(rng, pose, walls=hall, field_of_view=np.pi).points, sigma)
            for pose in (np.zeros(3), truth)
        )
        starts = np.array([rigid.compose(truth, [0.2, 0.0, 0.087]), np.zeros(3)])
        found = [register(fixed, moving, ROBUST, starts, s) for s in ((1.0,), ANNEALED)]
        right.append([is_registered(each.theta, truth) for each in found])
    (near, far), (near_annealed, far_annealed) = np.sum(right, axis=0)
    assert near_annealed >= near - 1 > 20
    assert far_annealed > far


def test_multi_start_is_the_best_of_its_starts_for_every_problem():
    """Breaks if another problem's best start is picked, or one that did not converge."""
    problem = scene(35, outlier="corrupted", measured="motion")
    f, m, z = problem.fixed, problem.moving, problem.measurement
    rng = np.random.default_rng(36)
    fixed = PointSet(f.means + 0.1 * rng.standard_normal((3, 1, *f.means.shape)), f.covariances)
    moving = PointSet(m.means + 0.1 * rng.standard_normal((2, *m.means.shape)), m.covariances)
    value = z.value + rng.standard_normal((3, 2, z.size))

    def best_of(fixed, moving, value):
        measurement = LinearMeasurement(value, z.sigma, z.sigma_input, z.gain, z.slope)
        one = problem.with_(fixed=fixed, moving=moving, measurement=measurement)
        best = multi_start(fixed, moving, problem.cost, starts, SCALES, measurement=measurement)
        return best, one

    for count in (2, 3, 4):
        starts = starts_around(problem, count, 37)
        starts[0, :2] = 1e6
        every, _ = best_of(fixed, moving, value)
        assert every.theta.shape == (3, 2, 3)
        for i, j in np.ndindex(3, 2):
            best, one = best_of(fixed[i, 0], moving[j], value[i, j])
            assert_same(every, best, (i, j))
            each = one.register(rigid.about(one.moving.means.mean(axis=0), starts), SCALES)
            winner = np.argmin(np.where(each.converged, each.value, np.inf))
            for name in {*FIELDS} - {"iterations"}:
                assert_array_equal(getattr(best, name), getattr(each, name)[winner], name)
            assert best.iterations == each.iterations.sum()


def test_starts_turn_about_the_set():
    """Breaks if they turn about the origin: a set ten metres away leaves their grid."""
    rng = np.random.default_rng(6)
    grid = start_grid(2.0, 1.0, np.deg2rad(np.arange(-60.0, 61.0, 15.0)))
    for place in ([10.0, 0.0], [3e5, -2e5]):
        for _ in range(10):
            means = rng.uniform(-4.0, 4.0, (20, 2)) + place
            turned = rigid.about(np.mean(means, axis=0), np.array([1.0, 1.1, -0.6]))
            sets = iso(means, 0.1), iso(rigid.transform_means(turned, means), 0.1)
            for starts in (grid, None):
                found = multi_start(*sets, ROBUST, starts, ANNEALED)
                assert_allclose(found.theta[2], 0.6, atol=1e-3)


def test_start_grid_reaches_its_edges_in_steps_no_longer_than_asked():
    """Breaks if an edge is left out or a rotation is not tried everywhere."""
    angles = np.array([-0.2, 0.1])
    starts = start_grid(5.0, 2.0, angles)
    assert starts.shape == (7 * 7 * 2, 3)
    for axis in (0, 1):
        line = np.unique(starts[:, axis])
        assert_allclose(line[[0, -1]], [-5.0, 5.0])
        assert (np.diff(line) <= 2.0).all()
    assert len(np.unique(starts, axis=0)) == len(starts)
    assert_array_equal(np.unique(starts[:, 2]), angles)


@pytest.mark.parametrize("scales", [(1.0,), SCHEDULE], ids=["plain", "scales"])
def test_a_batch_is_its_problems_one_by_one_in_any_number_of_threads(scales):
    """Breaks if a result depends on its neighbours, or on who computes it."""
    for outlier in OUTLIERS:
        fixed, moving = overlapped_scene(25, np.random.default_rng(13))
        starts = TRUTH + np.random.default_rng(14).standard_normal((25, 3)) * [4.0, 4.0, 0.3]
        cost = RegistrationCost(outlier=outlier_model(outlier, 2))
        batch = register(fixed, moving, cost, starts, scales)
        for i in range(25):
            assert_same(batch, register(fixed[i], moving[i], cost, starts[i], scales), i)
    fixed, moving = overlapped_scene(101, np.random.default_rng(15))
    one = register(fixed, moving, ROBUST, scales=scales)
    for threads in (2, 3, 64):
        assert_same(register(fixed, moving, ROBUST, scales=scales, threads=threads), one)


def test_batch_axes_of_sets_starts_and_measurements_broadcast():
    """Breaks if the batch axes are flattened in another order than they are unfolded."""
    problem = scene(16, measured="motion", count=5)
    rng = np.random.default_rng(17)
    f, m, z = problem.fixed, problem.moving, problem.measurement
    fixed = PointSet(f.means + 0.1 * rng.standard_normal((4, *f.means.shape)), f.covariances)
    moving = PointSet(m.means + 0.1 * rng.standard_normal((3, 1, *m.means.shape)), m.covariances)
    value = z.value + rng.standard_normal((2, 1, 1, z.size))
    measurement = LinearMeasurement(value, z.sigma, z.sigma_input, z.gain, z.slope)
    starts = problem.theta + 0.1 * rng.standard_normal((4, 3))
    before = starts.copy()
    cost = RegistrationCost(outlier=outlier_model("corrupted", 2))
    batch = register(fixed, moving, cost, starts, (2.0, 1.0), measurement=measurement)
    assert batch.theta.shape == batch.gradient.shape == (2, 3, 4, 3)
    assert batch.covariance.shape == batch.hessian.shape == (2, 3, 4, 3, 3)
    assert batch.value.shape == batch.converged.shape == batch.iterations.shape == (2, 3, 4)
    for i, j, k in np.ndindex(2, 3, 4):
        one = LinearMeasurement(value[i, 0, 0], z.sigma, z.sigma_input, z.gain, z.slope)
        alone = register(fixed[k], moving[j, 0], cost, starts[k], (2.0, 1.0), measurement=one)
        assert_same(batch, alone, (i, j, k))
    shapes = {name: np.shape(getattr(alone, name)) for name in FIELDS}
    assert [*shapes.values()] == [(3,), (3, 3), (), (3,), (3, 3), *6 * [()]]
    assert_array_equal(starts, before)


def test_what_does_not_converge_keeps_its_place_in_a_batch():
    """Breaks if the flags of a batch are unfolded in another order than its motions."""
    means = 5.0 * np.random.default_rng(18).standard_normal((2, 3, 2, 2))
    means[1, 0, 1] = means[1, 0, 0]  # two targets at one place do not show a rotation
    sets = PointSet(means, np.broadcast_to(0.04 * np.eye(2), (2, 2, 2)))
    found = register(sets, sets)
    assert_array_equal(np.argwhere(~found.converged), [[1, 0]])
    assert_array_equal(found.undetermined, ~found.converged)
    assert_array_equal(np.isinf(found.covariance).any(axis=(2, 3)), ~found.converged)


@given(
    seeds,
    st.sampled_from([1, 2]),
    st.sampled_from(METRICS),
    st.sampled_from(FUSIONS),
    st.sampled_from(OUTLIERS),
    reals(-6.0, 6.0),
)
@settings(max_examples=60)
def test_the_optimum_scales_with_the_unit(seed, dimension, metric, fusion, outlier, decade):
    """Breaks if a tolerance or radius of the minimiser is a length."""
    problem = scene(seed, dimension, metric, fusion, outlier)
    unit = 10.0**decade
    one, two = problem.register(), in_unit(problem, unit).register()
    assert one.converged == two.converged
    assume(one.converged)
    per = np.array([unit, unit, 1.0] if dimension == 2 else [unit])
    sigma = np.sqrt(np.diagonal(one.covariance))
    assert (np.abs(two.theta / per - one.theta) <= 1e-5 * sigma).all()
    assert_allclose(two.covariance / np.outer(per, per), one.covariance, rtol=1e-4, atol=1e-300)


def assert_refused(estimate):
    assert not estimate.converged.any()
    assert np.isnan(estimate.covariance).all()
    assert np.isfinite(estimate.theta).all()


def test_a_round_target_does_not_show_its_rotation():
    """Breaks if an unobservable rotation gets a variance, or hides that of the translation."""
    rng = np.random.default_rng(24)
    fixed = PointSet(rng.uniform(-20.0, 20.0, (40, 1, 2)), 0.09 * np.eye(2))
    moving = PointSet(np.zeros((40, 1, 2)), 0.09 * np.eye(2))
    # an isotropic outlier component sees no rotation either
    models = None, UniformOutlier(1e-3), CorruptedGaussian(0.2, 9.0 * np.eye(2))
    start = np.zeros((40, 3))
    start[:, :2] = fixed.means[:, 0] + 0.1 * rng.standard_normal((40, 2))
    for metric, model in product(METRICS, models):
        found = register(fixed, moving, RegistrationCost(metric, outlier=model), start)
        assert found.undetermined.all()
        assert not found.converged.any()
        assert_allclose(found.theta[:, :2], fixed.means[:, 0], atol=1e-6)
        assert_allclose(found.theta[:, 2], 0.0, atol=1e-6)
        expected = 0.18 if metric == "d2d" else 0.09
        assert_allclose(found.covariance[:, 0, 0], expected, rtol=0.1)
        assert_array_equal(found.covariance[:, 2, 2], np.inf)


@pytest.mark.parametrize("place", [0.0, 50.0])
@pytest.mark.parametrize("scales", [(1.0,), SCHEDULE], ids=["plain", "scales"])
def test_a_ring_turns_no_further_than_from_its_start(place, scales):
    """Breaks if steps walk along a valley: rounding errors led 6 rad away."""
    around = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
    posts = 3.0 * np.stack([np.cos(around), np.sin(around)], axis=-1)
    fixed = iso(posts + np.array([place, 0.0]), 0.2)
    moving = fixed.transformed(rigid.inverse([0.1, 0.05, 0.03]))
    found = register(fixed, moving, scales=scales)
    assert found.undetermined
    assert not found.converged
    assert np.isinf(found.covariance[2, 2])
    # the translation is known but for what turning by any angle adds to it
    x, y = rigid.rotation(found.theta[2]) @ moving.means.mean(axis=0)
    expected = np.pi**2 / 3.0 * np.outer([y, -x], [y, -x])
    assert_allclose(found.covariance[:2, :2], expected, rtol=1e-6, atol=1e-3)
    middle = rigid.transform_means(found.theta, moving.means).mean(axis=0)
    assert_allclose(middle, [place, 0.0], atol=1e-4)
    assert abs(found.theta[2]) < 1e-6


def test_a_corridor_determines_what_lies_across_it():
    """Breaks if the covariance of a corridor is unknown in all directions, or known in all."""
    walls = np.stack([np.tile(np.linspace(-9.0, 9.0, 20), 2), np.repeat([1.5, -1.5], 20)], axis=-1)
    fixed = PointSet(walls, np.diag([1e12, 0.0025]))
    moving = fixed.transformed(rigid.inverse([0.3, 0.05, 0.01]))
    found = register(fixed, moving)
    assert found.undetermined
    assert_allclose(found.theta[1:], [0.05, 0.01], atol=1e-3)
    assert_array_equal(np.isinf(np.diag(found.covariance)), [True, False, False])
    assert_allclose(found.covariance[1, 1], 2.0 * 0.0025 / 40.0, rtol=0.05)


@pytest.mark.parametrize("place", [0.0, 5e5])
def test_an_angle_is_within_half_a_turn(place):
    """Breaks if the path of a descent adds turns: in map coordinates there were 13 000."""
    rng = np.random.default_rng(3)
    means = rng.uniform(-20.0, 20.0, (200, 3, 2)) + place
    fixed, moving = iso(means, 0.5), iso(rng.permuted(means, axis=1), 0.5)
    starts = np.zeros((200, 3))
    starts[:, 2] = rng.uniform(-6.2, 6.2, 200)
    for scales in ((1.0,), SCHEDULE):
        found = register(fixed, moving, initial=starts, scales=scales)
        assert (found.theta[:, 2] > -np.pi).all()
        assert (found.theta[:, 2] <= np.pi).all()
        value = RegistrationCost().value(found.theta, fixed, moving)
        assert_allclose(value, found.value, rtol=1e-5)


def test_a_measured_angle_is_within_half_a_turn():
    """Breaks if the turn is taken off an angle that is measured, and the cost is another one."""
    for of_twist in (False, True):
        problem = scene(5, measured="twist" if of_twist else "motion")
        starts = starts_around(problem, 40, 6)
        starts[:, 2] = np.linspace(-6.2, 6.2, 40)
        found = problem.register(starts)
        assert (np.abs(found.theta[:, 2]) <= np.pi).all()
        assert_allclose(problem.value(found.theta), found.value, rtol=1e-9)


def test_the_fit_tells_what_inliers_cannot():
    """Breaks if a quarter of the targets without counterpart, or wrong sigmas, do not show."""
    rng = np.random.default_rng(0)
    means = rng.uniform(-60.0, 60.0, (300, 30, 2))
    fixed, moving = (iso(means + 0.1 * rng.standard_normal(means.shape), 0.1) for _ in range(2))
    found = register(fixed, moving)
    assert np.isnan(found.inliers).all()
    assert_array_equal(found.freedom, 57.0)
    low, high = np.moveaxis(found.fit_region, -1, 0)
    assert 0.92 <= ((low <= found.fit) & (found.fit <= high)).mean() <= 0.98
    strange = moving.means.copy()
    strange[:, ::4] += 3.0
    for other in (iso(strange, 0.1), iso(moving.means, 0.01)):
        worse = register(fixed, other)
        assert (worse.fit > high).mean() > 0.95
    assert (register(fixed.inflated(3.0), moving.inflated(3.0)).fit < low).all()


def test_a_maximum_of_the_cost_is_no_optimum():
    """Breaks if a vanishing gradient is enough: halfway between two targets the cost is highest."""
    fixed = PointSet([[-3.0], [3.0]], np.full((2, 1, 1), 0.25))
    moving = PointSet([[0.0]], [[[0.25]]])
    assert np.abs(RegistrationCost().derivatives([0.0], fixed, moving)[1]) < 1e-12
    for offset in (0.0, 1e-14, 1e-6, 0.1):
        estimate = register(fixed, moving, initial=[offset])
        if estimate.converged:  # it found its way down
            assert_allclose(np.abs(estimate.theta), 3.0, rtol=1e-6)
        else:
            assert_refused(estimate)
            assert offset < 1e-6


@pytest.mark.parametrize("distance", [1e4, 1e6, 1e7])
def test_what_converged_has_a_small_newton_decrement_however_far_apart_the_pairs_are(distance):
    """Breaks if "the cost can fall no further in floating point" counts as an optimum.

    At a million standard deviations a cost of 1e13 is rounded to 1e-3, the gain of a step of three
    hundredths of a standard deviation.
    """
    rng, converged = np.random.default_rng(0), 0
    for _ in range(60):
        fixed, moving = (
            PointSet(distance * rng.standard_normal((size, 2)), [np.eye(2)] * size)
            for size in rng.integers(2, 12, 2)
        )
        estimate = register(fixed, moving, RegistrationCost(rng.choice(["d2d", "p2d"])))
        if estimate.converged:
            converged += 1
            step = np.linalg.solve(estimate.hessian, estimate.gradient)
            assert estimate.gradient @ step <= 1e-7
    assert converged >= 10


@pytest.mark.parametrize("dimension", [1, 2])
def test_a_plateau_is_no_optimum(dimension):
    """Breaks if a vanishing Hessian gives a covariance, or the motion leaves for nowhere."""
    parameters = rigid.PARAMETERS[dimension]
    targets = np.arange(3.0 * dimension).reshape(3, dimension)
    points = PointSet(targets, np.eye(dimension)[None].repeat(3, axis=0) * 0.01)
    start = np.full((30, parameters), 1e4) * np.arange(1.0, 31.0)[:, None]
    start[:, 2:] = 1.0
    estimate = register(points, points, RegistrationCost(outlier=UniformOutlier(0.01)), start)
    assert_refused(estimate)
    assert_array_equal(estimate.theta, start)


@pytest.mark.parametrize("outlier", OUTLIERS)
def test_an_estimate_tells_the_mean_inlier_probability(outlier):
    """Breaks if a target of a block that is not full counts, or a rejected trial's shares."""
    fixed, moving = overlapped_scene(4, np.random.default_rng(2))
    cost = RegistrationCost(outlier=outlier_model(outlier, 2))
    for scales in ((1.0,), (4.0, 2.0, 1.0)):
        found = register(fixed, moving, cost, [4.5, 0.3, 0.2], scales)
        expected = cost.inlier_probabilities(found.theta, fixed, moving).mean(axis=-1)
        assert_allclose(found.inliers, expected if cost.outlier else np.nan, rtol=1e-9)
