"""The cost's values and derivatives, against plain reference implementations and invariances."""

from __future__ import annotations

from enum import StrEnum

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.special import logsumexp
from scipy.stats import multivariate_normal, norm

from d2d import CorruptedGaussian, LinearMeasurement, PointSet, RegistrationCost, UniformOutlier
from d2d import rigid as rigid_motion
from tests.strategies import (
    FUSIONS,
    LAYOUTS,
    MEASURED,
    METRICS,
    OUTLIERS,
    Problem,
    all_cases,
    case_id,
    central_difference,
    dense_gradient,
    dense_hessian,
    dense_value,
    doppler_like,
    outlier_model,
    random_problem,
    spd,
    steps_of,
)

CASES = pytest.mark.parametrize("case", all_cases(), ids=case_id)
ANY_LAYOUT = pytest.mark.parametrize("layout", LAYOUTS)


def naive_log_densities(problem: Problem) -> np.ndarray:
    """log q_k by a double loop over the targets and SciPy's distributions, one problem."""
    cost, theta = problem.cost, problem.theta
    fixed, moving, measurement = problem.fixed, problem.moving, problem.measurement
    dimension = fixed.dimension
    turn = np.eye(1)
    if dimension == 2:
        c, s = np.cos(theta[2]), np.sin(theta[2])
        turn = np.array([[c, -s], [s, c]])
    logs = []
    for k in range(moving.size):
        point = turn @ moving.means[k] + theta[:dimension]
        inlier, wide = [], []
        for i in range(fixed.size):
            covariance = fixed.covariances[i]
            if cost.metric == "d2d":
                covariance = covariance + turn @ moving.covariances[k] @ turn.T
            log_weight = np.log(fixed.weights[i])
            inlier.append(
                log_weight + multivariate_normal.logpdf(point, fixed.means[i], covariance)
            )
            if isinstance(cost.outlier, CorruptedGaussian):
                wide.append(
                    log_weight
                    + multivariate_normal.logpdf(point, fixed.means[i], cost.outlier.covariance)
                )
        log_q = logsumexp(inlier)
        if measurement is not None:
            m = measurement
            xi = rigid_motion.logarithm(theta) if m.of_twist else theta
            spread = np.hypot(m.sigma[k], m.sigma_input[k] * (m.slope[k] @ xi))
            log_q += norm.logpdf(m.value[k], m.gain[k] @ xi, spread)
        if isinstance(cost.outlier, UniformOutlier):
            log_q = np.logaddexp(log_q, np.log(cost.outlier.density))
        elif isinstance(cost.outlier, CorruptedGaussian):
            alpha = cost.outlier.fraction
            log_q = np.logaddexp(np.log(1.0 - alpha) + log_q, np.log(alpha) + logsumexp(wide))
        logs.append(log_q)
    return np.array(logs)


def naive_value(problem: Problem) -> float:
    """The cost from the double loop."""
    logs = naive_log_densities(problem)
    return float(-logs.sum() if problem.cost.fusion == "likelihood" else -logsumexp(logs))


def assert_derivatives_close(
    actual: np.ndarray, expected: np.ndarray, natural: np.ndarray, relative: float = 1e-6
) -> None:
    """Relative per element; where symmetry makes one vanish, 1e-9 of its natural size."""
    limit = relative * np.abs(expected) + 1e-9 * natural
    assert (np.abs(actual - expected) <= limit).all(), f"{actual}\n!=\n{expected}"


def natural_sizes(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Of gradient and Hessian: those of one target at one standard deviation."""
    inverse = 1e-3 / steps_of(problem)
    return inverse, np.outer(inverse, inverse)


@ANY_LAYOUT
@CASES
def test_value_and_densities_equal_a_naive_double_loop(case, layout):
    """Breaks on a wrong normalisation, weight, rotation, mixture or an underflow."""
    problem = random_problem(np.random.default_rng(1), layout=layout, **case)
    assert_allclose(problem.value(), naive_value(problem), rtol=1e-10)
    logs = naive_log_densities(problem)
    assert_allclose(problem.densities(), np.exp(logs), rtol=1e-9 if layout == "far" else 1e-10)


@pytest.mark.parametrize(("fixed_size", "moving_size"), [(1, 1), (1, 6), (7, 1), (9, 17)])
@pytest.mark.parametrize("outlier", OUTLIERS)
@pytest.mark.parametrize("dimension", [1, 2])
def test_set_sizes_and_default_weights(dimension, outlier, fixed_size, moving_size):
    """Breaks if a loop runs over the wrong set, its vectorised tail is lost, or 1/N is not 1/N."""
    problem = random_problem(
        np.random.default_rng(2),
        dimension,
        outlier=outlier,
        measured="motion",
        fixed_size=fixed_size,
        moving_size=moving_size,
        weighted=False,
    )
    assert_allclose(problem.value(), naive_value(problem), rtol=1e-10)
    assert_allclose(problem.densities(), np.exp(naive_log_densities(problem)), rtol=1e-10)


@ANY_LAYOUT
@CASES
def test_derivatives_equal_central_differences(case, layout):
    """Breaks if gradient or Hessian leave out a term, such as the covariance's own rotation."""
    problem = random_problem(np.random.default_rng(3), layout=layout, **case)
    _, gradient, hessian = problem.derivatives()
    steps, sizes = steps_of(problem), natural_sizes(problem)
    slopes = central_difference(problem.value, problem.theta, steps)
    # the value's rounding error over the step limits what differences can tell
    noise = 1e-14 * abs(float(problem.value())) / steps
    assert (np.abs(gradient - slopes) <= 1e-6 * np.abs(slopes) + 1e-9 * sizes[0] + noise).all()
    curvatures = central_difference(lambda x: problem.derivatives(x)[1], problem.theta, steps)
    assert_derivatives_close(hessian, curvatures, sizes[1])
    assert_array_equal(hessian, hessian.T)


@ANY_LAYOUT
@CASES
def test_derivatives_equal_complex_steps_through_the_value(case, layout):
    """Breaks on an error of 1e-10 in the gradient or 1e-8 in the Hessian, by another route."""
    problem = random_problem(np.random.default_rng(4), layout=layout, **case)
    value, gradient, hessian = problem.derivatives()
    sizes = natural_sizes(problem)
    assert_allclose(value, dense_value(problem, problem.theta), rtol=1e-12)
    expected = dense_gradient(problem, problem.theta)
    assert_derivatives_close(gradient, expected, 1e-3 * sizes[0], relative=1e-10)
    expected = dense_hessian(problem, problem.theta)
    assert_derivatives_close(hessian, expected, sizes[1], relative=1e-8)


@pytest.mark.parametrize(
    "angle", [0.0, 1e-9, -1e-4, 0.03, -0.0499, 0.0501, 0.3, np.pi / 2, -np.pi, 3.0, 5.0, 100.0]
)
@pytest.mark.parametrize("measured", MEASURED)
def test_derivatives_at_any_angle(measured, angle):
    """Breaks if a small angle is assumed, or the logarithm's series and closed form part ways."""
    problem = random_problem(np.random.default_rng(5), outlier="corrupted", measured=measured)
    problem = problem.with_(theta=np.array([0.4, -0.3, angle]))
    value, gradient, hessian = problem.derivatives()
    assert_allclose(value, naive_value(problem), rtol=1e-10)
    sizes = natural_sizes(problem)
    expected = dense_gradient(problem, problem.theta)
    assert_derivatives_close(gradient, expected, sizes[0], relative=1e-10)
    expected = dense_hessian(problem, problem.theta)
    assert_derivatives_close(hessian, expected, sizes[1], relative=1e-8)


@pytest.mark.parametrize("fusion", FUSIONS)
@pytest.mark.parametrize("distance", [1e3, 1e6, 1e9])
def test_far_targets_cost_much_but_never_inf(distance, fusion):
    """Breaks if a density is formed before its logarithm: exp(-1e18) is zero."""
    problem = random_problem(np.random.default_rng(6), fusion=fusion)
    problem = problem.with_(theta=np.array([distance, -distance, 0.25]))
    value, gradient, hessian = problem.derivatives()
    assert_allclose(value, naive_value(problem), rtol=1e-10)
    assert_allclose(gradient, dense_gradient(problem, problem.theta), rtol=1e-8)
    assert np.isfinite(hessian).all()
    assert value > 1e3


@pytest.mark.parametrize("outlier", ["uniform", "corrupted"])
def test_an_outlier_model_bounds_what_one_far_target_can_do(outlier):
    """Breaks if the far target's inlier part is not cut off, or cut off together with the rest."""
    problem = random_problem(np.random.default_rng(7), outlier=outlier)
    one_off = problem.moving.means.copy()
    one_off[0] += 60.0 if outlier == "corrupted" else 1e7
    moved = problem.with_(moving=PointSet(one_off, problem.moving.covariances))
    assert_allclose(moved.value(), naive_value(moved), rtol=1e-10)
    assert_allclose(
        moved.derivatives()[1], dense_gradient(moved, moved.theta), rtol=1e-9, atol=1e-12
    )


@pytest.mark.parametrize("measured", MEASURED)
@pytest.mark.parametrize("metric", METRICS)
def test_corrupted_gaussian_without_outliers_is_no_outlier_model(metric, measured):
    """Breaks if alpha = 0 leaves a log(0) behind, or alpha is the inlier share."""
    plain = random_problem(np.random.default_rng(8), 2, metric, measured=measured)
    zero = plain.with_(
        cost=RegistrationCost(metric, outlier=CorruptedGaussian(0.0, 50.0 * np.eye(2)))
    )
    for ours, theirs in zip(zero.derivatives(), plain.derivatives(), strict=True):
        assert_allclose(ours, theirs, rtol=1e-13)


def test_corrupted_gaussian_of_outliers_only_knows_neither_covariances_nor_measurements():
    """Breaks if alpha = 1 leaves a log(0) behind, or the measurement reaches the outliers."""
    problem = random_problem(np.random.default_rng(9), measured="motion")
    wide = outlier_model("corrupted", 2).covariance
    only = problem.with_(cost=RegistrationCost(outlier=CorruptedGaussian(1.0, wide)))
    point_to_wide = Problem(
        RegistrationCost("p2d"),
        problem.theta,
        PointSet(problem.fixed.means, wide[None].repeat(5, 0), problem.fixed.weights),
        problem.moving,
    )
    for ours, theirs in zip(only.derivatives(), point_to_wide.derivatives(), strict=True):
        assert_allclose(ours, theirs, rtol=1e-11)


def test_point_to_distribution_ignores_the_moving_covariances():
    """Breaks if P2D adds the moving target's covariance."""
    problem = random_problem(np.random.default_rng(10), metric="p2d")
    other = PointSet(problem.moving.means, 7.0 * problem.moving.covariances)
    assert_array_equal(problem.value(), problem.with_(moving=other).value())


def test_weights_of_the_moving_set_play_no_role():
    """Breaks if the moving set's weights enter: they are the mixture's when the set is fixed."""
    problem = random_problem(np.random.default_rng(11))
    heavy = PointSet(problem.moving.means, problem.moving.covariances, [1.0, 2.0, 3.0, 4.0])
    assert_array_equal(problem.value(), problem.with_(moving=heavy).value())


# ---- Batches ----------------------------------------------------------------------------------


@pytest.mark.parametrize("outlier", OUTLIERS)
@pytest.mark.parametrize(
    ("theta_batch", "fixed_batch", "moving_batch", "measurement_batch"),
    [
        ((5, 1), (4,), (), ()),
        ((), (3,), (2, 1), (3,)),
        ((2, 1, 1), (3, 1), (4,), (2, 3, 4)),
        ((1,), (), (1, 1), (6, 1)),
        ((), (), (), (3,)),
    ],
    ids=str,
)
def test_batch_axes_broadcast(theta_batch, fixed_batch, moving_batch, measurement_batch, outlier):
    """Breaks if a problem of a batch is given another one's sets, start or measurement."""
    rng = np.random.default_rng(12)
    count = 4

    def point_set(batch):
        size = int(np.prod(batch, dtype=int)) * count
        return PointSet(
            rng.uniform(-3, 3, (*batch, count, 2)),
            spd(rng, size, 2).reshape(*batch, count, 2, 2),
            rng.uniform(0.5, 2.0, (*batch, count)),
        )

    fixed, moving = point_set(fixed_batch), point_set(moving_batch)
    theta = 0.3 * rng.standard_normal((*theta_batch, 3))
    template = doppler_like(rng, np.array([0.4, -0.3, 0.25]), count)
    measurement = LinearMeasurement(
        template.value + rng.standard_normal((*measurement_batch, count)),
        template.sigma,
        template.sigma_input,
        template.gain,
        template.slope,
    )
    cost = RegistrationCost(outlier=outlier_model(outlier, 2))
    value, gradient, hessian = cost.derivatives(theta, fixed, moving, measurement=measurement)
    densities = cost.target_densities(theta, fixed, moving, measurement=measurement)

    shape = np.broadcast_shapes(theta_batch, fixed_batch, moving_batch, measurement_batch)
    assert value.shape == shape
    assert gradient.shape == (*shape, 3)
    assert hessian.shape == (*shape, 3, 3)
    assert densities.shape == (*shape, count)

    def member(array, own, index):
        batch = array.shape[: array.ndim - own]
        return np.broadcast_to(array, shape + array.shape[len(batch) :])[index]

    for index in np.ndindex(shape):
        one = Problem(
            cost,
            member(theta, 1, index),
            PointSet(
                member(fixed.means, 2, index),
                member(fixed.covariances, 3, index),
                member(fixed.weights, 1, index),
            ),
            PointSet(member(moving.means, 2, index), member(moving.covariances, 3, index)),
            LinearMeasurement(
                member(measurement.value, 1, index),
                template.sigma,
                template.sigma_input,
                template.gain,
                template.slope,
            ),
        )
        assert_allclose(value[index], naive_value(one), rtol=1e-10)
        assert_allclose(densities[index], np.exp(naive_log_densities(one)), rtol=1e-10)
        alone = one.derivatives()
        assert_array_equal(gradient[index], alone[1])
        assert_array_equal(hessian[index], alone[2])


def test_value_and_derivatives_agree_and_leave_their_input_alone():
    """Breaks if value() takes another path, or theta is overwritten."""
    problem = random_problem(np.random.default_rng(13), outlier="corrupted")
    theta = problem.theta.copy()
    assert_array_equal(problem.value(), problem.derivatives()[0])
    assert_array_equal(theta, problem.theta)
    logs = np.log(problem.densities())
    assert_allclose(problem.value(), -logs.sum(), rtol=1e-13)


# ---- Invariances ------------------------------------------------------------------------------

FIXED_BY = np.array([12.0, -7.0, 0.8])
MOVING_BY = np.array([-3.0, 20.0, -2.1])


def conjugated(theta: np.ndarray) -> np.ndarray:
    """theta between the sets after FIXED_BY and MOVING_BY moved them."""
    return rigid_motion.compose(
        FIXED_BY, rigid_motion.compose(theta, rigid_motion.inverse(MOVING_BY))
    )


@pytest.mark.parametrize("outlier", OUTLIERS)
@pytest.mark.parametrize("fusion", FUSIONS)
@pytest.mark.parametrize("metric", METRICS)
def test_a_rigid_motion_of_the_scene_keeps_the_cost(metric, fusion, outlier):
    """Breaks if a covariance is not turned with its mean, or turned the wrong way."""
    problem = random_problem(np.random.default_rng(14), 2, metric, fusion, outlier)
    cost = problem.cost
    if outlier == "corrupted":  # the outlier covariance lives in the fixed set's frame
        turned = rigid_motion.transform_covariances(FIXED_BY, cost.outlier.covariance[None])[0]
        cost = RegistrationCost(metric, fusion, CorruptedGaussian(0.3, turned))
    moved = Problem(
        cost,
        conjugated(problem.theta),
        problem.fixed.transformed(FIXED_BY),
        problem.moving.transformed(MOVING_BY),
    )
    assert_allclose(moved.value(), problem.value(), rtol=1e-12)
    assert_allclose(moved.densities(), problem.densities(), rtol=1e-11)
    # the map of theta preserves volume, so the Hessian's determinant stays only at an optimum;
    # the gradient's chain rule holds anywhere
    jacobian = central_difference(conjugated, problem.theta, np.full(3, 1e-3))
    assert_allclose(moved.derivatives()[1] @ jacobian, problem.derivatives()[1], rtol=1e-8)


@CASES
def test_order_of_targets_does_not_matter(case):
    """Breaks if a target's covariance, weight or measurement is another one's."""
    problem = random_problem(np.random.default_rng(15), fixed_size=9, moving_size=8, **case)
    f, m, z = problem.fixed, problem.moving, problem.measurement
    rng = np.random.default_rng(16)
    i, k = rng.permutation(f.size), rng.permutation(m.size)
    shuffled = problem.with_(
        fixed=PointSet(f.means[i], f.covariances[i], f.weights[i]),
        moving=PointSet(m.means[k], m.covariances[k]),
        measurement=z
        and LinearMeasurement(
            z.value[k], z.sigma[k], z.sigma_input[k], z.gain[k], z.slope[k], z.of_twist
        ),
    )
    for ours, theirs in zip(shuffled.derivatives(), problem.derivatives(), strict=True):
        assert_allclose(ours, theirs, rtol=1e-10, atol=1e-12)
    assert_allclose(shuffled.densities(), problem.densities()[k], rtol=1e-12)


@pytest.mark.parametrize("fusion", FUSIONS)
@pytest.mark.parametrize("outlier", ["none", "corrupted"])
@pytest.mark.parametrize("dimension", [1, 2])
def test_doubled_weights_shift_the_cost_by_a_constant(dimension, outlier, fusion):
    """Breaks if weights are normalised behind the user's back or the outliers' are not doubled."""
    problem = random_problem(
        np.random.default_rng(17), dimension, fusion=fusion, outlier=outlier, measured="motion"
    )
    f = problem.fixed
    doubled = problem.with_(fixed=PointSet(f.means, f.covariances, 2.0 * f.weights))
    shift = (problem.moving.size if fusion == "likelihood" else 1) * np.log(2.0)
    value, gradient, hessian = problem.derivatives()
    assert_allclose(doubled.value(), value - shift, rtol=1e-13)
    assert_allclose(doubled.derivatives()[1], gradient, rtol=1e-11)
    assert_allclose(doubled.derivatives()[2], hessian, rtol=1e-11)


@pytest.mark.parametrize("outlier", OUTLIERS)
def test_summing_d2d_sees_both_sets_alike(outlier):
    """Breaks if one set's covariance counts more than the other's; holds for isotropic outliers."""
    cost = RegistrationCost(fusion="summing", outlier=outlier_model(outlier, 2))
    if outlier == "corrupted":
        cost = RegistrationCost(fusion="summing", outlier=CorruptedGaussian(0.3, 60.0 * np.eye(2)))
    problem = random_problem(np.random.default_rng(18), moving_size=5, weighted=False)
    there = problem.with_(cost=cost)
    back = Problem(cost, rigid_motion.inverse(there.theta), there.moving, there.fixed)
    assert_allclose(back.value(), there.value(), rtol=1e-12)


@pytest.mark.parametrize("outlier", OUTLIERS)
@pytest.mark.parametrize("fusion", FUSIONS)
@pytest.mark.parametrize("metric", METRICS)
def test_one_dimension_is_the_plane_along_x(metric, fusion, outlier):
    """Breaks if the 1D set's stand-in variance along y is seen in value, gradient or Hessian."""
    line = random_problem(np.random.default_rng(19), 1, metric, fusion, outlier)
    across = 0.7  # variance along y of every target
    factor = 2.0 * across if metric == "d2d" else across
    density = 1.0 / np.sqrt(2.0 * np.pi * factor)  # along y, of every pair

    def embedded(points):
        means = np.concatenate([points.means, np.zeros_like(points.means)], axis=-1)
        covariances = np.zeros((points.size, 2, 2))
        covariances[:, 0, 0] = points.covariances[:, 0, 0]
        covariances[:, 1, 1] = across
        return PointSet(means, covariances, points.weights)

    model = line.cost.outlier
    if outlier == "uniform":
        model = UniformOutlier(model.density * density)
    elif outlier == "corrupted":
        wide = np.diag([model.covariance[0, 0], factor])
        model = CorruptedGaussian(model.fraction, wide)
    plane = Problem(
        RegistrationCost(metric, fusion, model),
        np.array([line.theta[0], 0.0, 0.0]),
        embedded(line.fixed),
        embedded(line.moving),
    )
    count = line.moving.size if fusion == "likelihood" else 1
    value, gradient, hessian = line.derivatives()
    planar = plane.derivatives()
    assert_allclose(value, planar[0] + count * np.log(density), rtol=1e-12)
    assert_allclose(gradient[0], planar[1][0], rtol=1e-11)
    assert_allclose(hessian[0, 0], planar[2][0, 0], rtol=1e-11)
    assert_allclose(line.densities(), plane.densities() / density, rtol=1e-12)


# ---- Bad input --------------------------------------------------------------------------------

LINE = PointSet([[0.0], [1.0]], np.ones((2, 1, 1)))
PLANE = PointSet([[0.0, 0.0], [1.0, 2.0]], np.eye(2)[None].repeat(2, axis=0))
BATCH_OF_THREE = PointSet(np.zeros((3, 2, 2)), np.eye(2)[None].repeat(2, axis=0))
ZERO = np.zeros(3)


class Named:
    """What reads like a name and is none."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __str__(self) -> str:
        return self.name

    def __repr__(self) -> str:
        return f"Named({self.name!r})"


class Fusion(StrEnum):
    SUMMING = "summing"


def test_a_name_may_be_a_string_of_another_type():
    """Breaks if NumPy's strings, or an enumeration's, are refused."""
    sets = BATCH_OF_THREE, BATCH_OF_THREE
    expected = RegistrationCost("p2d", "summing").value(ZERO, *sets)
    for fusion in (Fusion.SUMMING, np.str_("summing")):
        cost = RegistrationCost(np.str_("p2d"), fusion)
        assert_array_equal(cost.value(ZERO, *sets), expected)


def measurement_of(targets: int = 2, parameters: int = 3, batch: tuple[int, ...] = ()):
    ones = np.ones((targets, parameters))
    return LinearMeasurement(np.zeros((*batch, targets)), 1.0, 0.1, ones, ones)


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({"metric": "d2p"}, "metric"),
        ({"metric": None}, "metric"),
        ({"metric": "D2D"}, "metric"),
        ({"metric": Named("d2d")}, "metric"),
        ({"metric": np.array("d2d")}, "metric"),
        ({"fusion": Named("summing")}, "fusion"),
        ({"fusion": np.array("summing")}, "fusion"),
        ({"fusion": "product"}, "fusion"),
        ({"fusion": 0}, "fusion"),
        ({"fusion": ["likelihood"]}, "fusion"),
        ({"outlier": 0.1}, "outlier"),
        ({"outlier": "uniform"}, "outlier"),
        ({"outlier": UniformOutlier}, "outlier"),
    ],
    ids=str,
)
def test_cost_refuses_what_it_does_not_know(arguments, name):
    """Breaks if a misspelt option is taken for another one."""
    with pytest.raises(ValueError, match=name):
        RegistrationCost(**arguments)


@pytest.mark.parametrize("density", [0.0, -1.0, np.nan, np.inf, "dense", None, [0.1, 0.2]])
def test_uniform_outlier_refuses_bad_densities(density):
    """Breaks if a density without a logarithm is accepted."""
    with pytest.raises(ValueError, match="density"):
        UniformOutlier(density)


@pytest.mark.parametrize("fraction", [-0.1, 1.1, np.nan, np.inf, "half", None, [0.1, 0.2]])
def test_corrupted_gaussian_refuses_bad_fractions(fraction):
    """Breaks if a share outside [0, 1] is accepted."""
    with pytest.raises(ValueError, match="fraction"):
        CorruptedGaussian(fraction, np.eye(2))


@pytest.mark.parametrize(
    "covariance",
    [
        np.zeros((2, 2)),
        np.diag([1.0, -1.0]),
        np.array([[1.0, 2.0], [2.0, 1.0]]),
        np.array([[1.0, 0.5], [0.1, 1.0]]),
        np.full((2, 2), np.nan),
        np.diag([1.0, np.inf]),
        np.eye(3),
        np.eye(2)[None],
        np.ones((2, 3)),
        np.ones((0, 0)),
        -1.0,
        0.0,
        "wide",
        None,
    ],
    ids=lambda value: str(value).replace("\n", ""),
)
def test_corrupted_gaussian_refuses_bad_covariances(covariance):
    """Breaks if what is no covariance of 1 or 2 dimensions is accepted."""
    with pytest.raises(ValueError, match="covariance"):
        CorruptedGaussian(0.2, covariance)


def test_corrupted_gaussian_takes_a_variance_in_one_dimension():
    """Breaks if a plain number is no longer a 1D covariance."""
    assert_array_equal(CorruptedGaussian(0.2, 9.0).covariance, [[9.0]])


MISFITS = {
    "fixed-none": ((ZERO, None, PLANE), None, "fixed"),
    "fixed-array": ((ZERO, PLANE.means, PLANE), None, "fixed"),
    "moving-string": ((ZERO, PLANE, "moving"), None, "moving"),
    "dimensions": ((ZERO, PLANE, LINE), None, "fixed and moving"),
    "theta-too-short": ((np.zeros(2), PLANE, PLANE), None, "theta"),
    "theta-1D-for-2D": ((np.zeros(1), PLANE, PLANE), None, "theta"),
    "theta-2D-for-1D": ((ZERO, LINE, LINE), None, "theta"),
    "theta-scalar": ((0.0, LINE, LINE), None, "theta"),
    "theta-nan": ((np.array([0.0, np.nan, 0.0]), PLANE, PLANE), None, "theta"),
    "theta-inf": ((np.array([np.inf, 0.0, 0.0]), PLANE, PLANE), None, "theta"),
    "theta-string": (("zero", PLANE, PLANE), None, "theta"),
    "theta-none": ((None, PLANE, PLANE), None, "theta"),
    "theta-complex": ((ZERO.astype(complex), PLANE, PLANE), None, "theta"),
    "batches": ((np.zeros((4, 3)), PLANE, BATCH_OF_THREE), None, "theta"),
    "measurement-targets": ((ZERO, PLANE, PLANE), measurement_of(targets=3), "measurement"),
    "measurement-2D-for-1D": ((np.zeros(1), LINE, LINE), measurement_of(), "measurement"),
    "measurement-1D-for-2D": ((ZERO, PLANE, PLANE), measurement_of(parameters=1), "measurement"),
    "measurement-batch": ((np.zeros((4, 3)), PLANE, PLANE), measurement_of(batch=(3,)), "measure"),
    "measurement-string": ((ZERO, PLANE, PLANE), "doppler", "measurement"),
    "measurement-array": ((ZERO, PLANE, PLANE), np.zeros(2), "measurement"),
}


@pytest.mark.parametrize("method", ["value", "derivatives", "target_densities"])
@pytest.mark.parametrize("misfit", MISFITS)
def test_evaluation_refuses_arguments_that_do_not_fit(misfit, method):
    """Breaks if a wrong shape, type or number gets as far as the compiled kernel."""
    arguments, measurement, name = MISFITS[misfit]
    with pytest.raises(ValueError, match=name):
        getattr(RegistrationCost(), method)(*arguments, measurement=measurement)


@pytest.mark.parametrize(
    ("points", "covariance"), [(PLANE, [[4.0]]), (LINE, np.eye(2))], ids=["2D", "1D"]
)
def test_outlier_covariance_must_have_the_sets_dimension(points, covariance):
    """Breaks if a 1D outlier covariance is read as a planar one or the reverse."""
    cost = RegistrationCost(outlier=CorruptedGaussian(0.2, covariance))
    with pytest.raises(ValueError, match="outlier covariance"):
        cost.value(np.zeros(3 if points is PLANE else 1), points, points)


def test_without_an_outlier_model_every_target_is_an_inlier():
    problem = random_problem(np.random.default_rng(5), layout="far")
    shares = problem.cost.inlier_probabilities(problem.theta, problem.fixed, problem.moving)
    assert_array_equal(shares, np.ones(problem.moving.size))


@pytest.mark.parametrize(("alpha", "expected"), [(0.0, 1.0), (1.0, 0.0)])
def test_inlier_probabilities_at_the_ends_of_alpha(alpha, expected):
    problem = random_problem(np.random.default_rng(5), layout="far")
    cost = RegistrationCost(outlier=CorruptedGaussian(alpha, np.eye(2)))
    shares = cost.inlier_probabilities(problem.theta, problem.fixed, problem.moving)
    assert_array_equal(shares, np.full(problem.moving.size, expected))
