"""PointSet: construction, polar measurements, batches, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from d2d import PointSet, RegistrationCost, rigid
from tests.strategies import central_difference, motions, reals, spd

few = settings(max_examples=60, deadline=None, derandomize=True)
RANGES, ANGLES = reals(0.1, 300.0), reals(-2.0 * np.pi, 2.0 * np.pi)
SIGMA_RANGES, SIGMA_ANGLES = reals(1e-3, 2.0), reals(1e-4, 0.3)


def cartesian(polar: np.ndarray) -> np.ndarray:
    return polar[0] * np.array([np.cos(polar[1]), np.sin(polar[1])])


@few
@given(st.lists(st.tuples(RANGES, ANGLES, SIGMA_RANGES, SIGMA_ANGLES), min_size=1, max_size=5))
def test_polar_covariance_is_the_propagated_one(targets):
    """Breaks if the columns of J do not stand in the order of the variances, or r is left out."""
    columns = np.array(targets).T
    points = PointSet.from_polar(*columns)
    for k, (r, phi, sigma_r, sigma_phi) in enumerate(targets):
        polar = np.array([r, phi])
        jacobian = central_difference(cartesian, polar, np.array([1e-3 * r, 1e-3]))
        expected = jacobian @ np.diag([sigma_r**2, sigma_phi**2]) @ jacobian.T
        size = np.abs(expected).max()
        assert_allclose(points.covariances[k], expected, rtol=1e-9, atol=1e-9 * size)
        assert_allclose(points.means[k], cartesian(polar), rtol=1e-13, atol=1e-13 * r)
    assert_allclose(points.weights, 1.0 / len(targets))


@few
@given(RANGES, ANGLES, SIGMA_RANGES, SIGMA_ANGLES)
def test_polar_sets_are_accepted_by_the_constructor(r, phi, sigma_r, sigma_phi):
    """Breaks if from_polar makes what PointSet itself would refuse."""
    points = PointSet.from_polar([r], [phi], sigma_r, sigma_phi)
    again = PointSet(points.means, points.covariances, points.weights)
    assert_array_equal(again.covariances, points.covariances)


def test_polar_set_of_a_needle_shaped_target_is_refused_or_usable():
    """Breaks if a covariance that rounding made singular gets through and turns the cost to nan."""
    try:
        points = PointSet.from_polar([100.0, 50.0], [0.3, 1.0], 1e-7, 1.0)
    except ValueError:
        return
    assert (np.linalg.eigvalsh(points.covariances) > 0.0).all()
    assert np.isfinite(RegistrationCost("p2d").value(np.zeros(3), points, points))


def test_polar_sigmas_and_azimuths_broadcast():
    """Breaks if a common sigma is not spread over the targets and the batch."""
    rng = np.random.default_rng(1)
    r, phi = rng.uniform(1.0, 50.0, (7, 1, 4)), rng.uniform(-1.0, 1.0, (3, 4))
    points = PointSet.from_polar(r, phi, 0.2, [0.01, 0.02, 0.03, 0.04])
    assert points.batch_shape == (7, 3)
    assert (points.size, points.dimension) == (4, 2)
    one = PointSet.from_polar(r[5, 0], phi[2], 0.2, [0.01, 0.02, 0.03, 0.04])
    assert_array_equal(points[5, 2].means, one.means)
    assert_array_equal(points[5, 2].covariances, one.covariances)


def test_weights_are_one_over_n_unless_given():
    """Breaks if given weights are normalised or the default is not."""
    means, covariances = np.zeros((4, 2)), np.eye(2)[None].repeat(4, axis=0)
    assert_array_equal(PointSet(means, covariances).weights, 0.25)
    assert_array_equal(PointSet(means, covariances, [1, 2, 3, 4]).weights, [1.0, 2.0, 3.0, 4.0])


def test_a_set_keeps_its_own_copy_which_nobody_can_change():
    """Breaks if a caller's later change of an array reaches the set or its packed copy."""
    means, covariances = np.zeros((3, 2)), np.eye(2)[None].repeat(3, axis=0)
    weights = np.ones(3)
    points = PointSet(means, covariances, weights)
    means += 1.0
    covariances *= 4.0
    weights *= 2.0
    assert_array_equal(points.means, 0.0)
    assert_array_equal(points.covariances, np.eye(2)[None].repeat(3, axis=0))
    assert_array_equal(points.weights, 1.0)
    for array in (points.means, points.covariances, points.weights):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 7.0


def test_integers_and_lists_become_float64():
    """Breaks if an integer array's covariance is rounded."""
    points = PointSet([[1, 2]], [[[1, 0], [0, 1]]])
    assert points.means.dtype == points.covariances.dtype == points.weights.dtype == np.float64
    assert_array_equal(points.inflated(0.5).covariances, [[[0.25, 0.0], [0.0, 0.25]]])


def test_batches_broadcast_and_are_indexed():
    """Breaks if an index reaches beyond the batch axes or the three arrays part ways."""
    rng = np.random.default_rng(2)
    means = rng.standard_normal((5, 1, 3, 2))
    covariances = spd(rng, 4 * 3, 2).reshape(4, 3, 2, 2)
    weights = rng.uniform(1.0, 2.0, 3)
    points = PointSet(means, covariances, weights)
    assert points.batch_shape == (5, 4)
    assert_array_equal(points[2, 3].means, means[2, 0])
    assert_array_equal(points[2, 3].covariances, covariances[3])
    assert_array_equal(points[2, 3].weights, weights)
    assert points[1:3].batch_shape == (2, 4)
    assert_array_equal(points[1:3].means[:, 0], means[1:3, 0])
    assert points[np.array([0, 4])].batch_shape == (2, 4)
    assert points[np.arange(5) > 2].batch_shape == (2, 4)
    with pytest.raises(IndexError, match="no batch axes"):
        points[2, 3][0]


@pytest.mark.parametrize("index", [(0, 0, 0), (0, 0, slice(0, 2))], ids=str)
def test_an_index_beyond_the_batch_axes_is_refused(index):
    """Breaks if an index takes targets, or coordinates, apart and leaves a set that is none."""
    points = PointSet(np.zeros((5, 4, 3, 2)), np.eye(2)[None].repeat(3, axis=0))
    with pytest.raises(IndexError, match="batch"):
        points[index]


@few
@given(motions(2))
def test_a_transformed_set_is_moved_and_turned(theta):
    """Breaks if means and covariances are turned by different angles."""
    rng = np.random.default_rng(3)
    points = PointSet(rng.standard_normal((4, 2)), spd(rng, 4, 2), [1.0, 2.0, 3.0, 4.0])
    moved = points.transformed(theta)
    turn = rigid.rotation(theta[2])
    assert_allclose(moved.means, points.means @ turn.T + theta[:2], rtol=1e-12, atol=1e-12)
    assert_allclose(moved.covariances, turn @ points.covariances @ turn.T, atol=1e-12)
    assert_array_equal(moved.weights, points.weights)
    # without the constructor's checks, and yet as it would have it
    PointSet(moved.means, moved.covariances)


def test_one_set_moved_by_many_motions_is_a_batch():
    """Breaks if theta's batch axes do not become the set's."""
    points = PointSet(np.ones((4, 2)), np.eye(2)[None].repeat(4, axis=0))
    theta = np.random.default_rng(4).standard_normal((7, 3))
    moved = points.transformed(theta)
    assert moved.batch_shape == (7,)
    assert_allclose(moved[3].means, points.transformed(theta[3]).means, rtol=1e-14)


def test_inflation_multiplies_standard_deviations():
    """Breaks if variances are multiplied instead."""
    points = PointSet([[1.0]], [[[4.0]]])
    assert_array_equal(points.inflated(3.0).covariances, [[[36.0]]])
    assert_array_equal(points.inflated(3.0).means, [[1.0]])


@pytest.mark.parametrize("bad", [1.0, [1.0], np.ones(3), np.ones((2, 2)), [0.0, np.nan], "far"])
def test_a_shift_is_one_finite_translation(bad):
    """Breaks if a number is spread over the axes, or nan makes a set that is none."""
    points = PointSet(np.zeros((2, 2)), np.eye(2)[None].repeat(2, axis=0))
    assert_array_equal(points.shifted([1, 2]).means, [[1.0, 2.0]] * 2)
    with pytest.raises(ValueError, match=r"^translation must"):
        points.shifted(bad)


# ---- Bad input --------------------------------------------------------------------------------

MEANS = [[0.0, 0.0], [3.0, 1.0]]
COVARIANCES = [[[1.0, 0.2], [0.2, 1.0]]] * 2


def with_covariance(matrix):
    return MEANS, [COVARIANCES[0], matrix]


BAD_SETS = {
    "means-nan": (([[0.0, np.nan], [3.0, 1.0]], COVARIANCES), "means"),
    "means-inf": (([[0.0, -np.inf], [3.0, 1.0]], COVARIANCES), "means"),
    "means-none": ((None, COVARIANCES), "means"),
    "means-string": (("points", COVARIANCES), "means"),
    "means-ragged": (([[1.0, 2.0], [3.0]], COVARIANCES), "means"),
    "means-complex": ((np.array(MEANS) + 1j, COVARIANCES), "means"),
    "means-object": (([[object(), 1.0]], COVARIANCES), "means"),
    "means-scalar": ((1.0, COVARIANCES), "means"),
    "means-one-axis": (([0.0, 1.0], COVARIANCES), "means"),
    "means-3D": ((np.zeros((2, 3)), np.eye(3)[None].repeat(2, axis=0)), "means"),
    "means-0D": ((np.zeros((2, 0)), np.zeros((2, 0, 0))), "means"),
    "means-no-targets": ((np.zeros((0, 2)), np.zeros((0, 2, 2))), "means"),
    "means-empty-batch": ((np.zeros((0, 2, 2)), COVARIANCES), "means"),
    "means-set": ((PointSet(MEANS, COVARIANCES), COVARIANCES), "means"),
    "covariances-none": ((MEANS, None), "covariances"),
    "covariances-string": ((MEANS, "wide"), "covariances"),
    "covariances-scalar": ((MEANS, 1.0), "covariances"),
    "covariances-variances": ((MEANS, [1.0, 1.0]), "covariances"),
    "covariances-not-square": ((MEANS, np.ones((2, 2, 3))), "covariances"),
    "covariances-of-three": ((MEANS, COVARIANCES * 2), "covariances"),
    "covariances-one-for-all": ((MEANS, np.eye(2)), "covariances"),
    "covariances-1D": ((MEANS, np.ones((2, 1, 1))), "covariances"),
    "covariances-nan": (with_covariance([[np.nan, 0.0], [0.0, 1.0]]), "covariances"),
    "covariances-inf": (with_covariance([[np.inf, 0.0], [0.0, 1.0]]), "covariances"),
    "covariances-zero": (with_covariance(np.zeros((2, 2))), "covariances"),
    "covariances-singular": (with_covariance(np.ones((2, 2))), "covariances"),
    "covariances-indefinite": (with_covariance([[1.0, 2.0], [2.0, 1.0]]), "covariances"),
    "covariances-negative": (with_covariance(-np.eye(2)), "covariances"),
    "covariances-asymmetric": (with_covariance([[1.0, 0.5], [0.1, 1.0]]), "symmetric"),
    "covariances-batch": ((np.zeros((3, 2, 2)), np.stack([COVARIANCES] * 4)), "covariances"),
    "covariances-1D-negative": (([[0.0]], [[[-1.0]]]), "covariances"),
    "covariances-1D-zero": (([[0.0]], [[[0.0]]]), "covariances"),
    "weights-zero": ((MEANS, COVARIANCES, [1.0, 0.0]), "weights"),
    "weights-negative": ((MEANS, COVARIANCES, [1.0, -1.0]), "weights"),
    "weights-nan": ((MEANS, COVARIANCES, [1.0, np.nan]), "weights"),
    "weights-three": ((MEANS, COVARIANCES, np.ones(3)), "weights"),
    "weights-scalar": ((MEANS, COVARIANCES, 1.0), "weights"),
    "weights-string": ((MEANS, COVARIANCES, "equal"), "weights"),
    "weights-batch": ((np.zeros((3, 2, 2)), COVARIANCES, np.ones((4, 2))), "weights"),
}


@pytest.mark.parametrize("bad", BAD_SETS)
def test_constructor_names_what_is_wrong(bad):
    """Breaks if a set that is none is accepted, or the message leaves the user guessing."""
    arguments, name = BAD_SETS[bad]
    with pytest.raises(ValueError, match=name):
        PointSet(*arguments)


def test_rounding_errors_of_symmetry_are_forgiven():
    """Breaks if R Sigma R' of the user's own is refused, or kept unsymmetric."""
    points = PointSet([[0.0, 0.0]], [[[1.0, 0.5 + 1e-14], [0.5, 1.0]]])
    assert points.covariances[0, 0, 1] == points.covariances[0, 1, 0]


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_covariances_computed_in_single_precision_are_taken(kind):
    """Breaks if J Sigma J' of float32 arrays is refused, as they are or converted afterwards."""
    rng = np.random.default_rng(5)
    jacobian = rng.standard_normal((200, 2, 2)).astype(np.float32)
    sigma = np.array([[0.04, 0.01], [0.01, 0.09]], dtype=np.float32)
    covariances = jacobian @ sigma @ jacobian.swapaxes(1, 2)
    gap = np.abs(covariances - covariances.swapaxes(1, 2)).max(axis=(1, 2))
    assert (gap > 1e-9 * np.trace(covariances, axis1=1, axis2=2)).any()
    points = PointSet(rng.standard_normal((200, 2)), covariances.astype(kind))
    assert_array_equal(points.covariances, points.covariances.swapaxes(2, 1))


def test_an_asymmetric_covariance_is_told_with_its_difference():
    """Breaks if the user has to search for what differs, and by how much."""
    with pytest.raises(
        ValueError, match=r"^covariances must be symmetric, but entry \(0, 1\) .* 4"
    ):
        PointSet(*with_covariance([[1.0, 0.5], [0.1, 1.0]]))


GOOD_POLAR = {
    "range": [10.0, 20.0],
    "azimuth": [0.1, 0.2],
    "sigma_range": 0.2,
    "sigma_azimuth": 0.03,
}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("range", [10.0, 0.0]),
        ("range", [10.0, -1.0]),
        ("range", [10.0, np.nan]),
        ("range", [np.inf, 1.0]),
        ("range", []),
        ("range", 10.0),
        ("range", None),
        ("range", "far"),
        ("range", [10.0, 20.0, 30.0]),
        ("range", np.ones((0, 2))),
        ("azimuth", [0.1, np.nan]),
        ("azimuth", [0.1, np.inf]),
        ("azimuth", [0.1, 0.2, 0.3]),
        ("azimuth", None),
        ("sigma_range", 0.0),
        ("sigma_range", [0.2, -0.2]),
        ("sigma_range", np.nan),
        ("sigma_range", [0.2, 0.2, 0.2]),
        ("sigma_azimuth", 0.0),
        ("sigma_azimuth", -0.03),
        ("sigma_azimuth", np.inf),
        ("sigma_azimuth", "narrow"),
    ],
    ids=str,
)
def test_polar_measurements_name_what_is_wrong(name, value):
    """Breaks if a range or sigma without a covariance is accepted."""
    with pytest.raises(ValueError, match=name):
        PointSet.from_polar(**(GOOD_POLAR | {name: value}))


@pytest.mark.parametrize("scale", [0.0, -1.0, np.nan, np.inf, "wide", None])
def test_inflation_refuses_what_is_no_scale(scale):
    """Breaks if a set of zero, negative-definite or nan covariances can be made."""
    with pytest.raises(ValueError, match="scale"):
        PointSet(MEANS, COVARIANCES).inflated(scale)


@pytest.mark.parametrize("theta", [np.zeros(2), np.zeros(1), 0.0, [0.0, np.nan, 0.0], None, "left"])
def test_transformation_refuses_what_is_no_motion(theta):
    """Breaks if a motion of another dimension, or nan, is applied."""
    with pytest.raises(ValueError, match="theta"):
        PointSet(MEANS, COVARIANCES).transformed(theta)


@pytest.mark.parametrize("weight", [1e-101, 1e101])
def test_weights_whose_sums_would_lose_digits_are_refused(weight):
    """The kernel's sums begin at 1e-300 and may not overflow."""
    with pytest.raises(ValueError, match=r"^weights must lie within 1e-100 and 1e\+100"):
        PointSet(np.zeros((2, 1)), np.ones((2, 1, 1)), [1.0, weight])


@pytest.mark.parametrize("dimension", [1, 2])
def test_variances_whose_products_overflow_are_refused(dimension):
    """Breaks if det(Sigma_k + Sigma_i) becomes infinite, and the density zero, without a word."""
    means, unit = np.zeros((1, dimension)), np.eye(dimension)[np.newaxis]
    PointSet(means, 1e150 * unit)
    with pytest.raises(ValueError, match="covariances must be at most 1e"):
        PointSet(means, 1e154 * unit)
