"""Identities of the public functions over random shapes, batch axes, scales and numbers of targets.

Hypothesis chooses sizes, scales and seeds; the numbers come from a generator of that seed, so that
an example is small to print and to shrink.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from d2d import (
    CorruptedGaussian,
    LinearMeasurement,
    PointSet,
    RegistrationCost,
    UniformOutlier,
    block_length,
    coverage,
    credibility,
    crps,
    energy_score,
    fisher_covariance,
    log_score,
    multi_start,
    propagate_covariance,
    register,
    rigid,
    start_grid,
    whiten,
)
from d2d.baselines import fit_rigid, grid_cells, icp, line_normals, ndt_d2d, ndt_p2d, pooled_cells
from d2d.radar import (
    Mounting,
    RadarScan,
    doppler_ego_motion,
    doppler_velocity,
    estimate_ego_motion,
    inlier_probabilities,
    propagate_ego_motion,
    sensor_velocity,
    simulate_drive,
    track,
)
from d2d.radar.scans.scan import doppler_gradients
from tests.strategies import (
    FUSIONS,
    METRICS,
    OUTLIERS,
    Problem,
    doppler_like,
    outlier_model,
    random_problem,
    reals,
    spd,
)

FEW = settings(max_examples=8)  # of tests that take long

seeds = st.integers(0, 2**32 - 1)
decades = reals(-6.0, 6.0)
batches = st.sampled_from([(), (1,), (3,), (2, 3), (2, 1)])
costs = st.fixed_dictionaries(
    {
        "dimension": st.sampled_from([1, 2]),
        "metric": st.sampled_from(METRICS),
        "fusion": st.sampled_from(FUSIONS),
        "outlier": st.sampled_from(OUTLIERS),
    }
)
sizes = st.tuples(st.integers(1, 40), st.integers(1, 40))


def problem_of(seed: int, case: dict[str, Any], size: tuple[int, int], **options: Any) -> Problem:
    """A random problem of these sizes."""
    return random_problem(
        np.random.default_rng(seed), fixed_size=size[0], moving_size=size[1], **case, **options
    )


def in_unit(problem: Problem, unit: float) -> Problem:
    """The same scene with all lengths multiplied by ``unit``."""
    f, m, model = problem.fixed, problem.moving, problem.cost.outlier
    dimension = f.dimension
    if isinstance(model, UniformOutlier):
        model = UniformOutlier(model.density / unit**dimension)
    elif model is not None:
        model = CorruptedGaussian(model.fraction, model.covariance * unit**2)
    return Problem(
        replace(problem.cost, outlier=model),
        np.concatenate([problem.theta[:dimension] * unit, problem.theta[dimension:]]),
        PointSet(f.means * unit, f.covariances * unit**2, f.weights),
        PointSet(m.means * unit, m.covariances * unit**2),
    )


# ---- The cost ---------------------------------------------------------------------------------


@given(seeds, costs, sizes, decades)
def test_a_change_of_unit_shifts_the_cost_by_a_constant(seed, case, size, decade):
    """Breaks if any constant of the code is a length: a target adds D log(unit)."""
    problem, unit = problem_of(seed, case, size), 10.0**decade
    scaled = in_unit(problem, unit)
    value, gradient, hessian = problem.derivatives()
    other, slope, bend = scaled.derivatives()
    shift = case["dimension"] * np.log(unit)
    shift *= size[1] if case["fusion"] == "likelihood" else 1
    assert_allclose(other - shift, value, rtol=1e-10, atol=1e-8)
    per = np.array([unit] * case["dimension"] + [1.0] * (len(gradient) - case["dimension"]))
    natural = np.sqrt(np.abs(np.diagonal(hessian))) + np.abs(gradient)
    assert (np.abs(slope * per - gradient) <= 1e-9 * natural).all()
    outer = np.outer(natural, natural)
    assert (np.abs(bend * np.outer(per, per) - hessian) <= 1e-9 * (outer + np.abs(hessian))).all()


@given(seeds, costs, sizes)
def test_the_order_of_targets_and_components_does_not_matter(seed, case, size):
    """Breaks if a target or component is skipped, counted twice or given another one's weight."""
    problem = problem_of(seed, case, size, measured="motion")
    rng = np.random.default_rng(seed)
    f, m, z = problem.fixed, problem.moving, problem.measurement
    some, other = rng.permutation(size[0]), rng.permutation(size[1])
    shuffled = problem.with_(
        fixed=PointSet(f.means[some], f.covariances[some], f.weights[some]),
        moving=PointSet(m.means[other], m.covariances[other]),
        measurement=LinearMeasurement(
            *(getattr(z, n)[other] for n in ("value", "sigma", "sigma_input", "gain", "slope"))
        ),
    )
    assert_allclose(shuffled.densities(), problem.densities()[other], rtol=1e-12)
    for one, two in zip(shuffled.derivatives(), problem.derivatives(), strict=True):
        assert_allclose(one, two, rtol=1e-9, atol=1e-9 * np.abs(two).max())


@given(seeds, costs, sizes, reals(-1e7, 1e7), reals(-10.0, 10.0))
def test_moving_both_sets_alike_changes_nothing(seed, case, size, shift, angle):
    """Breaks if origin or axes play a role: f(theta; G F, M) = f(G^-1 theta; F, M) for any G."""
    problem = problem_of(seed, case, size)
    if isinstance(problem.cost.outlier, CorruptedGaussian) and case["dimension"] == 2:
        round_one = CorruptedGaussian(0.3, 60.0 * np.eye(2))  # the only kind that may be turned
        problem = problem.with_(cost=replace(problem.cost, outlier=round_one))
    by = np.array([shift, -0.3 * shift, angle])[: len(problem.theta)]
    turned = problem.with_(
        theta=rigid.compose(by, problem.theta), fixed=problem.fixed.transformed(by)
    )
    rounding = max(1.0, abs(shift) / 1e3)
    assert_allclose(turned.value(), problem.value(), rtol=1e-8, atol=1e-7 * rounding)
    assert_allclose(turned.densities(), problem.densities(), rtol=1e-6 * rounding)
    # and of the moving set alone: f(theta; F, G M) = f(theta G; F, M)
    there = problem.with_(
        theta=rigid.compose(problem.theta, rigid.inverse(by)),
        moving=problem.moving.transformed(by),
    )
    assert_allclose(there.value(), problem.value(), rtol=1e-8, atol=1e-7)


@given(seeds, costs, sizes)
def test_the_fusions_are_sums_over_the_target_densities(seed, case, size):
    """Breaks if value and target densities are not those of one cost."""
    problem = problem_of(seed, case, size, measured="motion")
    q = problem.densities()
    expected = -np.log(q).sum() if case["fusion"] == "likelihood" else -np.log(q.sum())
    assert_allclose(problem.value(), expected, rtol=1e-11, atol=1e-11)


@given(seeds, costs, sizes)
def test_inlier_probabilities_are_the_inliers_share(seed, case, size):
    """Breaks if a share leaves [0, 1], is that of the outliers, or is not 1 without a model.

    Shares below 2e-16 count as none.
    """
    problem = problem_of(seed, case, size, measured="motion")
    share = problem.cost.inlier_probabilities(
        problem.theta, problem.fixed, problem.moving, measurement=problem.measurement
    )
    assert ((share >= 0.0) & (share <= 1.0)).all()
    bare = problem.with_(cost=replace(problem.cost, outlier=None)).densities()
    model = problem.cost.outlier
    kept = 1.0 - model.fraction if isinstance(model, CorruptedGaussian) else 1.0
    densities = problem.densities()
    wrong = np.abs(share * densities - kept * bare)
    assert (wrong <= 1e-10 * kept * bare + 3e-16 * densities).all()


@FEW
@given(seeds, st.sampled_from([1, 2, 7, 8, 9, 63, 64, 65, 250, 499, 500]), st.sampled_from(METRICS))
def test_up_to_five_hundred_targets(seed, size, metric):
    """Breaks where a block, its tail or a buffer is too small: the cost is a sum over targets."""
    case = {"dimension": 2, "metric": metric, "outlier": "corrupted"}
    problem = problem_of(seed, case, (size, size))
    parts = [
        problem.with_(moving=PointSet(problem.moving.means[p], problem.moving.covariances[p]))
        for p in np.array_split(np.arange(size), min(size, 5))
    ]
    for whole, some in zip(
        problem.derivatives(), zip(*(p.derivatives() for p in parts), strict=True), strict=True
    ):
        assert_allclose(whole, sum(some), rtol=1e-9, atol=1e-9 * np.abs(whole).max())


def test_sets_without_targets_are_refused():
    """Breaks if a mean over nothing, or an empty block, reaches the kernel."""
    with pytest.raises(ValueError, match="means"):
        PointSet(np.zeros((0, 2)), np.zeros((0, 2, 2)))
    with pytest.raises(ValueError, match="range"):
        PointSet.from_polar([], [], [], [])
    empty = RadarScan(0.0, [], [], [], [], [], [])
    assert_array_equal(sensor_velocity(empty, Mounting()), 0.0)
    assert np.isnan(doppler_ego_motion([(empty, Mounting())]).covariance).all()
    with pytest.raises(ValueError, match="previous"):
        estimate_ego_motion(empty, replace_time(scan_of(0, 5), 0.1), Mounting())


# ---- The optimum ------------------------------------------------------------------------------


def overlapping(
    rng: np.random.Generator, batch: tuple[int, ...], dimension: int = 2, size: int = 8
) -> tuple[PointSet, PointSet, np.ndarray]:
    """Sets that a motion (*batch, P) maps onto each other up to their own errors."""
    theta = 0.1 * rng.standard_normal((*batch, rigid.PARAMETERS[dimension]))
    points = rng.uniform(-10.0, 10.0, (*batch, size, dimension))
    count = int(np.prod(batch, dtype=int)) * size
    sets = []
    for means in (points, rigid.transform_means(rigid.inverse(theta), points)):
        covariances = spd(rng, count, dimension, 0.1).reshape(*means.shape, dimension)
        noise = rng.standard_normal(means.shape)
        means = means + np.einsum("...ij,...j->...i", np.linalg.cholesky(covariances), noise)
        sets.append(PointSet(means, covariances))
    return sets[0], sets[1], theta


@given(seeds, costs, decades)
def test_the_optimum_scales_with_the_unit(seed, case, decade):
    """Breaks if a tolerance or radius of the minimiser is a length."""
    dimension = case["dimension"]
    fixed, moving, truth = overlapping(np.random.default_rng(seed), (), dimension)
    model = outlier_model(case["outlier"], dimension)
    cost = RegistrationCost(case["metric"], case["fusion"], model)
    problem = Problem(cost, truth, fixed, moving)
    scaled, unit = in_unit(problem, 10.0**decade), 10.0**decade
    one = register(fixed, moving, cost, truth)
    two = register(scaled.fixed, scaled.moving, scaled.cost, scaled.theta)
    assert one.converged == two.converged
    assume(one.converged)
    per = np.array([unit] * dimension + [1.0] * (len(truth) - dimension))
    sigma = np.sqrt(np.diagonal(one.covariance))
    assert (np.abs(two.theta / per - one.theta) <= 1e-5 * sigma).all()
    assert_allclose(two.covariance / np.outer(per, per), one.covariance, rtol=1e-4, atol=1e-300)


@given(seeds, batches, st.integers(1, 5))
def test_batch_loop_and_threads_agree_to_the_last_bit(seed, batch, threads):
    """Breaks if a problem's result depends on its neighbours, or on who computes it."""
    fixed, moving, _ = overlapping(np.random.default_rng(seed), batch)
    cost = RegistrationCost(outlier=outlier_model("corrupted", 2))
    whole = register(fixed, moving, cost, threads=threads)
    assert whole.theta.shape == (*batch, 3)
    assert whole.covariance.shape == (*batch, 3, 3)
    for index in np.ndindex(batch):
        one = register(
            PointSet(fixed.means[index], fixed.covariances[index]),
            PointSet(moving.means[index], moving.covariances[index]),
            cost,
        )
        for name in ("theta", "covariance", "value", "converged", "iterations"):
            assert_array_equal(getattr(whole, name)[index], getattr(one, name))


@given(seeds, reals(0.1, 20.0), reals(0.1, 20.0), st.integers(1, 4))
def test_a_grid_of_starts_holds_its_corners_and_finds_no_worse(seed, reach, spacing, turns):
    """Breaks if the best of many starts is worse than one of them, or the grid has gaps."""
    angles = np.linspace(-0.2, 0.2, turns)
    grid = start_grid(reach, spacing, angles)
    line = np.unique(grid[:, 0])
    assert_allclose([line[0], line[-1]], [-reach, reach])
    assert np.diff(line).max() <= spacing * (1 + 1e-12)
    assert len(grid) == len(line) ** 2 * turns
    starts = grid[np.linspace(0, len(grid) - 1, min(len(grid), 6)).astype(int)]
    fixed, moving, _ = overlapping(np.random.default_rng(seed), ())
    best = multi_start(fixed, moving, None, starts)
    each = register(fixed, moving, initial=starts)
    assert best.converged == each.converged.any()
    if best.converged:
        assert best.value == each.value[each.converged].min()


# ---- Covariances ------------------------------------------------------------------------------


@given(seeds, batches, st.integers(1, 4), decades, decades)
def test_fisher_inverts_in_any_units(seed, batch, size, first, last):
    """Breaks if parameters of very different units make a good Hessian look singular."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((*batch, size, size))
    unit = 10.0 ** np.linspace(first, last, size)
    well = root @ np.swapaxes(root, -1, -2) + np.eye(size)
    covariance = fisher_covariance(well * np.outer(unit, unit))
    assert_allclose(covariance * np.outer(unit, unit), np.linalg.inv(well), rtol=1e-6, atol=1e-9)
    assert np.isnan(fisher_covariance(-well)).all()


@given(seeds, costs, decades, reals(0.2, 5.0))
def test_propagation_is_quadratic_in_the_errors(seed, case, decade, stretch):
    """Breaks if a covariance is propagated as if it were a deviation, or a unit is left behind."""
    dimension, unit = case["dimension"], 10.0**decade
    rng = np.random.default_rng(seed)
    fixed, moving, truth = overlapping(rng, (), dimension)
    model = outlier_model(case["outlier"], dimension)
    cost = RegistrationCost(case["metric"], case["fusion"], model)
    measurement = doppler_like(rng, truth, moving.size)
    estimate = register(fixed, moving, cost, truth, measurement=measurement)
    assume(estimate.converged)
    spread = propagate_covariance(estimate, fixed, moving, cost, measurement=measurement)
    assert_array_equal(spread, spread.T)
    size = np.sqrt(np.diagonal(spread))
    assert np.linalg.eigvalsh(spread / np.outer(size, size))[0] > -1e-9
    # the same optimum in another unit
    free = register(fixed, moving, cost, truth)
    assume(free.converged)
    scaled = in_unit(Problem(cost, free.theta, fixed, moving), unit)
    again = register(scaled.fixed, scaled.moving, scaled.cost, scaled.theta)
    per = np.array([unit] * dimension + [1.0] * (len(truth) - dimension))
    assert_allclose(
        propagate_covariance(again, scaled.fixed, scaled.moving, scaled.cost) / np.outer(per, per),
        propagate_covariance(free, fixed, moving, cost),
        rtol=1e-4,
        atol=1e-6 * np.abs(np.diagonal(free.covariance)).min(),
    )
    # a multiple of the cost has the multiple of the gradient's slope and of the Hessian
    multiple = replace(free, covariance=free.covariance * stretch)
    assert_allclose(
        propagate_covariance(multiple, fixed, moving, cost),
        stretch**2 * propagate_covariance(free, fixed, moving, cost),
        rtol=1e-12,
    )


@given(seeds, st.integers(1, 4), st.integers(6, 60), decades)
def test_credibility_does_not_depend_on_the_coordinates(seed, n, runs, decade):
    """Breaks if an error is compared with a deviation of another axis: any linear map will do."""
    rng = np.random.default_rng(seed)
    errors = rng.standard_normal((runs, n))
    covariances = spd(rng, runs, n)
    map_ = rng.standard_normal((n, n)) + 3.0 * np.eye(n)
    map_ *= 10.0 ** (decade * np.linspace(0.0, 1.0, n))[:, None]
    one = credibility(errors, covariances)
    two = credibility(errors @ map_.T, map_ @ covariances @ map_.T)
    assert_allclose(two.nees, one.nees, rtol=1e-6)
    assert_allclose(two.credible_nees, one.credible_nees, rtol=1e-6)
    assert_allclose([two.nci, two.inclination], [one.nci, one.inclination], rtol=1e-6, atol=1e-6)
    order = rng.permutation(runs)
    three = credibility(errors[order], covariances[order])
    assert_allclose([three.anees, three.nci], [one.anees, one.nci], rtol=1e-12)
    # covariances k times as large: k times less NEES, 10 log10 k dB towards pessimism
    wide = credibility(errors, 7.0 * covariances)
    assert_allclose(wide.anees, one.anees / 7.0, rtol=1e-12)
    assert_allclose(wide.inclination, one.inclination - 10.0 * np.log10(7.0), rtol=1e-9, atol=1e-9)
    assert abs(one.inclination) <= one.nci + 1e-12


# ---- Rigid motions and polar targets ----------------------------------------------------------


@given(seeds, batches, decades, reals(-8.0, np.log10(6.2)))
def test_exponential_and_logarithm_undo_each_other(seed, batch, decade, angle):
    """Breaks at an angle where a series ends or a closed form cancels, on either side."""
    rng = np.random.default_rng(seed)
    twist = np.concatenate(
        [
            10.0**decade * rng.standard_normal((*batch, 2)),
            10.0**angle * rng.choice([-1.0, 0.0, 1.0], (*batch, 1)),
        ],
        axis=-1,
    )
    size = np.abs(twist[..., :2]).max()
    back = rigid.logarithm(rigid.exponential(twist))
    assert_allclose(back, twist, rtol=1e-9, atol=1e-9 * size * (angle > 0) + 1e-12 * size)
    there = rigid.exponential(rigid.logarithm(twist))
    assert_allclose(there, twist, rtol=1e-9, atol=1e-9 * size * (angle > 0) + 1e-12 * size)
    assert_allclose(
        rigid.inverse(rigid.exponential(twist)), rigid.exponential(-twist), atol=1e-9 * size + 1e-15
    )


@given(seeds, batches, st.integers(1, 500), decades, reals(-3.0, 0.0))
def test_polar_targets_are_what_the_formula_says(seed, batch, count, decade, sigma):
    """Breaks at any range, azimuth or batch shape: eigenvalues are the two variances."""
    rng = np.random.default_rng(seed)
    r = 10.0**decade * rng.uniform(1.0, 10.0, (*batch, count))
    phi = rng.uniform(-2.0 * np.pi, 2.0 * np.pi, (*batch, count))
    sigma_r, sigma_phi = 10.0**decade * 10.0**sigma, 10.0**sigma
    targets = PointSet.from_polar(r, phi, sigma_r, sigma_phi)
    assert targets.batch_shape == batch
    direction = np.stack([np.cos(phi), np.sin(phi)], axis=-1)
    assert_allclose(targets.means, r[..., None] * direction, rtol=1e-12, atol=1e-14 * r.max())
    across = np.stack([-direction[..., 1], direction[..., 0]], axis=-1)
    for axis, deviation in ((direction, sigma_r), (across, r * sigma_phi)):
        stretched = np.einsum("...ij,...j->...i", targets.covariances, axis)
        expected = np.asarray(deviation**2)[..., None] * axis
        assert_allclose(stretched, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    assert_allclose(targets.weights.sum(axis=-1), 1.0)


# ---- The radar --------------------------------------------------------------------------------


def scan_of(seed: int, count: int, theta: Any = (8.0, 0.0, 0.1), at: Any = None) -> RadarScan:
    """Static targets around, measured exactly, with their Doppler velocities."""
    rng = np.random.default_rng(seed)
    azimuth = rng.uniform(-0.7, 0.7, count)
    mounting = Mounting() if at is None else at
    speed = doppler_velocity(theta, azimuth, mounting)
    return RadarScan(0.0, rng.uniform(5.0, 40.0, count), azimuth, speed, 0.1, 0.01, 0.05)


def replace_time(scan: RadarScan, time: float) -> RadarScan:
    """The scan at another time."""
    fields = ("range", "azimuth", "doppler", "sigma_range", "sigma_azimuth", "sigma_doppler")
    return RadarScan(time, *(getattr(scan, name) for name in fields))


velocities = st.tuples(reals(-40.0, 40.0), reals(-3.0, 3.0), reals(-1.0, 1.0)).map(np.array)
mountings = st.builds(Mounting, reals(-4.0, 4.0), reals(-2.0, 2.0), reals(-3.2, 3.2))


@given(seeds, velocities, mountings, st.integers(0, 500), batches)
def test_doppler_velocity_is_linear_and_that_of_the_sensor(seed, theta, mounting, count, batch):
    """Breaks if the lever arm has the wrong sign, or one motion of a batch meets another's scan."""
    rng = np.random.default_rng(seed)
    azimuth = rng.uniform(-4.0, 4.0, (*batch, count))
    seen = doppler_velocity(theta, azimuth, mounting)
    assert seen.shape == (*batch, count)
    u = theta[:2] + theta[2] * np.array([-mounting.y, mounting.x])
    line = azimuth + mounting.yaw
    assert_allclose(seen, -u[0] * np.cos(line) - u[1] * np.sin(line), atol=1e-11)
    assert_allclose(doppler_velocity(-2.0 * theta, azimuth, mounting), -2.0 * seen, atol=1e-11)
    gain, slope = doppler_gradients(azimuth, mounting)
    turned, _ = doppler_gradients(azimuth + 1e-6, mounting)
    assert_allclose((turned - gain) / 1e-6, slope, atol=1e-4)


@given(seeds, velocities, mountings, st.integers(3, 300))
def test_exact_doppler_velocities_give_the_velocity(seed, theta, mounting, count):
    """Breaks if a sensor's frame is left out, or good targets are thrown away."""
    scan = scan_of(seed, count, theta, mounting)
    assume(np.ptp(scan.azimuth) > 0.2)
    u = theta[:2] + theta[2] * np.array([-mounting.y, mounting.x])
    assert_allclose(sensor_velocity(scan, mounting), u, atol=1e-6 * (1.0 + np.abs(u).max()))
    rear = Mounting(mounting.x - 3.0, mounting.y + 1.0, mounting.yaw + 2.0)
    found = doppler_ego_motion([(scan, mounting), (scan_of(seed + 1, count, theta, rear), rear)])
    if np.isfinite(found.covariance).all():
        limit = 1e-6 + 10.0 * np.sqrt(np.diagonal(found.covariance))
        assert (np.abs(found.theta - theta) <= limit).all()


def successive(seed: int, theta: np.ndarray, at: Mounting, count: int) -> tuple[RadarScan, ...]:
    """Two scans, a tenth of a second apart, of the same targets without errors."""
    now = replace_time(scan_of(seed, count, theta, at), 0.1)
    points = now.range[:, None] * np.stack([np.cos(now.azimuth), np.sin(now.azimuth)], axis=-1)
    moved = rigid.compose(
        rigid.inverse(at.pose), rigid.compose(rigid.exponential(0.1 * theta), at.pose)
    )
    x, y = rigid.transform_means(moved, points).T
    azimuth = np.arctan2(y, x)
    before = RadarScan(
        0.0, np.hypot(x, y), azimuth, doppler_velocity(theta, azimuth, at), 0.1, 0.01, 0.05
    )
    return before, now


@given(seeds, velocities, mountings, st.booleans())
def test_ego_motion_of_exact_scans_is_the_true_one(seed, theta, mounting, doppler):
    """Breaks if positions, Doppler velocities, mounting or interval do not fit together."""
    pair = (*successive(seed, theta, mounting, 30), mounting)
    options = {"doppler": doppler, "initial": theta, "outlier": UniformOutlier(1e-6)}
    estimate = estimate_ego_motion(*pair, **options)
    assert estimate.converged
    sigma = np.sqrt(np.diagonal(estimate.covariance))
    # neighbours within the errors' reach pull the optimum a little from the truth
    assert (np.abs(estimate.theta - theta) <= 1.5 * sigma + 1e-9).all()
    model = {"doppler": doppler, "outlier": options["outlier"]}
    share = inlier_probabilities(estimate.theta, *pair, **model)
    assert share.shape == (30,)
    assert share.min() > 0.9
    spread = propagate_ego_motion(estimate, *pair, **model)
    assert np.linalg.eigvalsh(spread / np.outer(sigma, sigma))[0] > 0.0


@FEW
@given(seeds, st.integers(2, 6), st.integers(1, 3))
def test_a_track_of_one_sensor_is_the_chain_of_its_pairs(seed, count, baseline):
    """Breaks if a pair is left out, or a scan is registered with another one than was asked for."""
    drive = simulate_drive(np.random.default_rng(seed), duration=0.1 * count)
    scans = [scan[:12] for scan in drive.scans]
    assume(all(scan.size > 5 for scan in scans))
    path = track((scans, drive.mounting), baseline=baseline)
    assert path.theta.shape == (len(scans) - 1, 3)
    assert_allclose(path.times, [scan.time for scan in scans[1:]])
    assert (np.isfinite(path.covariance).all(axis=(1, 2)) == path.converged).all()
    poses = path.poses((1.0, -2.0, 3.0))
    assert_array_equal(poses[0], [1.0, -2.0, 3.0])
    for before, after, theta, interval in zip(
        poses[:-1], poses[1:], path.theta, path.intervals, strict=True
    ):
        step = rigid.compose(before, rigid.exponential(theta * interval))
        assert_allclose(after, step, atol=1e-12)


# ---- Baselines --------------------------------------------------------------------------------


@given(seeds, batches, st.integers(2, 500), decades)
def test_paired_points_are_fitted_exactly_at_any_scale(seed, batch, count, decade):
    """Breaks if a mirror is taken for a rotation, or a batch's pairs are mixed up."""
    rng, unit = np.random.default_rng(seed), 10.0**decade
    theta = rng.uniform(-3.1, 3.1, (*batch, 3))
    theta[..., :2] *= unit
    moving = unit * rng.standard_normal((*batch, count, 2))
    found = fit_rigid(rigid.transform_means(theta, moving), moving)
    assert_allclose(found, theta, rtol=1e-6, atol=1e-6 * unit if decade < 0 else 1e-6)


@given(seeds, decades, st.integers(10, 300), st.sampled_from(["point", "line"]))
def test_icp_is_right_in_any_unit_and_order(seed, decade, count, metric):
    """Breaks if a tolerance is a hidden length, or the order of the points matters."""
    rng, unit = np.random.default_rng(seed), 10.0**decade
    fixed = rng.uniform(-10.0, 10.0, (count, 2))
    theta = np.array([0.02, -0.03, 0.002])
    moving = rigid.transform_means(rigid.inverse(theta), fixed)
    per = np.array([unit, unit, 1.0])
    one = icp(fixed, moving, metric=metric)
    two = icp(
        fixed[rng.permutation(count)] * unit, moving * unit, metric=metric, tolerance=1e-6 * unit
    )
    assert one.converged == two.converged
    assert_allclose(two.theta / per, one.theta, atol=1e-5)
    assert one.thetas.shape == (one.iterations + 1, 3)
    if metric == "point":
        assert (np.diff(one.rms_history) <= 1e-12).all()


@given(seeds, st.integers(7, 200), reals(-1.5, 1.5))
def test_normals_turn_with_their_points(seed, count, angle):
    """Breaks if the longer axis is taken for the normal."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-5.0, 5.0, (count, 2)) * [1.0, 0.2]
    turned = points @ rigid.rotation(angle).T
    normals, others = line_normals(points), line_normals(turned)
    assert_allclose(np.linalg.norm(normals, axis=-1), 1.0)
    along = np.abs(np.einsum("ni,ni->n", normals @ rigid.rotation(angle).T, others))
    assert np.median(along) > 1.0 - 1e-9


@given(seeds, st.integers(60, 300), reals(-4.0, 4.0), st.integers(-3, 3))
def test_cells_move_with_whole_cells_and_scale_with_the_unit(seed, count, decade, steps):
    """Breaks if a point falls through a border, or a floor of the covariance is a length."""
    rng, unit = np.random.default_rng(seed), 2.0 ** round(decade)
    points = rng.uniform(-4.0, 4.0, (count, 2))
    cells = grid_cells(points, 2.0)
    scaled = grid_cells(points * unit, 2.0 * unit)
    assert_array_equal(scaled.means, cells.means * unit)
    assert_allclose(scaled.covariances, cells.covariances * unit**2, rtol=1e-12)
    moved = grid_cells(points + 2.0 * steps, 2.0)
    assume(moved.size == cells.size)  # a point within rounding of a border may change sides
    assert_allclose(moved.means, cells.means + 2.0 * steps, atol=1e-12)
    pooled = pooled_cells(points, 2.0, ((0.0, 0.0), (0.5, 0.5)))
    assert_array_equal(pooled.means[: cells.size], cells.means)
    # each component peaks at 1
    peak = 2.0 * np.pi * np.sqrt(np.linalg.det(pooled.covariances))
    assert_allclose(pooled.weights / peak, 1.0, rtol=1e-12)


@FEW
@given(seeds, batches, st.sampled_from([ndt_p2d, ndt_d2d]))
def test_ndt_of_a_batch_of_starts_is_that_of_each(seed, batch, method):
    """Breaks if a start is given to another problem, or takes part in its result."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-6.0, 6.0, (200, 2))
    starts = 0.1 * rng.standard_normal((*batch, 3))
    whole = method(points, points, starts, size=3.0)
    assert whole.theta.shape == (*batch, 3)
    for index in np.ndindex(batch):
        assert_array_equal(
            method(points, points, starts[index], size=3.0).theta, whole.theta[index]
        )


# ---- What does not fit is refused by name -----------------------------------------------------

POINTS = np.random.default_rng(0).standard_normal((40, 2))
SETS = tuple(PointSet(POINTS[:4] + k, np.tile(np.eye(2), (4, 1, 1))) for k in (0.0, 0.1))
SCANS = (scan_of(1, 6), replace_time(scan_of(2, 6), 0.1))
CALLS: dict[str, tuple[Any, dict[str, Any]]] = {
    "PointSet": (PointSet, {"means": POINTS[:4], "covariances": np.tile(np.eye(2), (4, 1, 1))}),
    "from_polar": (
        PointSet.from_polar,
        {"range": np.ones(4), "azimuth": np.ones(4), "sigma_range": 1.0, "sigma_azimuth": 1.0},
    ),
    "UniformOutlier": (UniformOutlier, {"density": 1.0}),
    "CorruptedGaussian": (CorruptedGaussian, {"fraction": 0.5, "covariance": np.eye(2)}),
    "LinearMeasurement": (
        LinearMeasurement,
        {
            "value": np.ones(4),
            "sigma": 1.0,
            "sigma_input": 1.0,
            "gain": np.ones((4, 3)),
            "slope": np.ones((4, 3)),
        },
    ),
    "register": (register, {"fixed": SETS[0], "moving": SETS[1], "initial": np.zeros(3)}),
    "multi_start": (
        multi_start,
        {"fixed": SETS[0], "moving": SETS[1], "cost": None, "starts": np.zeros((2, 3))},
    ),
    "start_grid": (start_grid, {"reach": 1.0, "spacing": 1.0, "angles": [0.0]}),
    "fisher_covariance": (fisher_covariance, {"hessian": np.eye(3)}),
    "propagate_covariance": (
        propagate_covariance,
        {"estimate": register(*SETS), "fixed": SETS[0], "moving": SETS[1]},
    ),
    "credibility": (credibility, {"errors": POINTS, "covariances": np.eye(2), "confidence": 0.9}),
    "whiten": (whiten, {"errors": POINTS, "covariances": np.eye(2), "order": (1, 0)}),
    "log_score": (log_score, {"errors": POINTS, "covariances": np.eye(2)}),
    "energy_score": (energy_score, {"errors": POINTS, "covariances": np.eye(2)}),
    "crps": (crps, {"errors": POINTS, "sigmas": 1.0}),
    "coverage": (coverage, {"errors": POINTS, "covariances": np.eye(2), "levels": 0.9}),
    "block_length": (block_length, {"series": POINTS}),
    "Mounting": (Mounting, {"x": 0.0, "y": 0.0, "yaw": 0.0}),
    "doppler_velocity": (
        doppler_velocity,
        {"theta": np.zeros(3), "azimuth": np.zeros(4), "mounting": Mounting()},
    ),
    "doppler_measurement": (
        SCANS[0].doppler_measurement,
        {"mounting": Mounting(), "interval": 0.1},
    ),
    "point_set": (SCANS[0].point_set, {"mounting": Mounting()}),
    "sensor_velocity": (sensor_velocity, {"scan": SCANS[0], "mounting": Mounting()}),
    "doppler_ego_motion": (doppler_ego_motion, {"views": [(SCANS[0], Mounting())]}),
    "estimate_ego_motion": (
        estimate_ego_motion,
        {"previous": SCANS[0], "current": SCANS[1], "mounting": Mounting()},
    ),
    "fit_rigid": (fit_rigid, {"fixed": POINTS, "moving": POINTS}),
    "icp": (
        icp,
        {
            "fixed": POINTS,
            "moving": POINTS,
            "initial": np.zeros(3),
            "metric": "point",
            "tolerance": 1e-6,
            "max_iterations": 3,
        },
    ),
    "line_normals": (line_normals, {"points": POINTS, "neighbours": 5}),
    "grid_cells": (
        grid_cells,
        {"points": POINTS, "size": 2.0, "shift": (0.0, 0.0), "min_points": 3},
    ),
    "pooled_cells": (pooled_cells, {"points": POINTS, "size": 2.0, "shifts": ((0.0, 0.0),)}),
    "ndt_p2d": (
        ndt_p2d,
        {"fixed": POINTS, "moving": POINTS, "initial": np.zeros(3), "size": 2.0},
    ),
    "ndt_d2d": (
        ndt_d2d,
        {"fixed": POINTS, "moving": POINTS, "initial": np.zeros(3), "size": 2.0, "d2": 0.5},
    ),
}
# None of these is what any of the arguments above could be.
NONSENSE = {
    "text": "near",
    "nan": float("nan"),
    "minus infinity": float("-inf"),
    "complex": 1.0 + 2.0j,
    "dictionary": {},
    "many axes": np.full((2, 2, 2, 5), np.nan),
    "objects": np.array([object()]),
    "dates": np.array(["2020-01-01"], dtype="datetime64[D]"),
}


@pytest.mark.parametrize("bad", NONSENSE.values(), ids=NONSENSE)
@pytest.mark.parametrize(
    ("call", "argument"),
    [(c, a) for c, (_, arguments) in CALLS.items() for a in arguments],
    ids=lambda name: name,
)
def test_nonsense_is_refused_by_name(call, argument, bad):
    """Breaks if it is taken, or ends in an error that does not say which argument was wrong."""
    function, arguments = CALLS[call]
    with pytest.raises(ValueError, match=argument.removesuffix("s")):
        function(**{**arguments, argument: bad})


def test_what_is_wrong_only_here_is_refused_by_name():
    """Breaks if a step shorter than nothing is waited for, or a batch is taken for points."""
    with pytest.raises(ValueError, match="tolerance"):
        icp(POINTS, POINTS, tolerance=-1e-6)
    with pytest.raises(ValueError, match="points"):
        line_normals(POINTS.reshape(2, 20, 2))
    with pytest.raises(ValueError, match="cost"):
        propagate_covariance(register(*SETS), *SETS, "likelihood")
    with pytest.raises(ValueError, match="interval"):
        SCANS[0].doppler_measurement(Mounting(), 0.0)


def test_the_calls_without_nonsense_are_good():
    """Breaks if the calls above are refused for a reason of their own."""
    for function, arguments in CALLS.values():
        assert function(**arguments) is not None
