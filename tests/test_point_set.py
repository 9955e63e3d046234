"""PointSet: construction, polar measurements, batches, and what it refuses."""

import copy
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from d2d import PointSet, multi_start, propagate_covariance, register, rigid
from tests.strategies import central_difference, motions, reals, spd

few = settings(max_examples=60)
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
    again = PointSet(points.means, points.covariances, points.weights)
    assert_array_equal(again.covariances, points.covariances)


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


def test_weights_are_one_over_n_unless_given_and_sigmas_are_inflated():
    """Breaks if given weights are normalised, integers are rounded or variances are multiplied."""
    points = PointSet([[1, 2], [3, 4]], [[[1, 0], [0, 1]]] * 2)
    assert points.means.dtype == points.covariances.dtype == points.weights.dtype == np.float64
    assert_array_equal(points.weights, 0.5)
    assert_array_equal(PointSet(points.means, points.covariances, [1, 2]).weights, [1.0, 2.0])
    assert_array_equal(points.inflated(0.5).covariances, 0.25 * points.covariances)
    assert_array_equal(points.shifted([1, 2]).means, [[2.0, 4.0], [4.0, 6.0]])


def test_batches_broadcast_and_are_indexed():
    """Breaks if an index reaches beyond the batch axes, the three arrays part ways or a loop over
    the batch leaves out its last set."""
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
    assert_array_equal([each.means[0] for each in points], means[:, 0])
    assert points[np.array([0, 4])].batch_shape == (2, 4)
    assert points[np.arange(5) > 2].batch_shape == (2, 4)
    none = points[:, 0][np.zeros(5, dtype=bool)]
    assert "batch of (0,)" in repr(none)
    for estimate in (register(none, points[0, 0], scales=(2.0, 1.0)), multi_start(none, none)):
        assert propagate_covariance(estimate, none, none).shape == (0, 3, 3)
    with pytest.raises(IndexError, match="no batch axes"):
        points[2, 3][0]
    with pytest.raises(IndexError, match="batch"):
        points[0, 0, 0]


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


def test_covariances_computed_in_single_precision_are_taken():
    """Breaks if J Sigma J' of float32 arrays is refused, as they are or converted afterwards."""
    rng = np.random.default_rng(5)
    jacobian = rng.standard_normal((200, 2, 2)).astype(np.float32)
    sigma = np.array([[0.04, 0.01], [0.01, 0.09]], dtype=np.float32)
    covariances = jacobian @ sigma @ jacobian.swapaxes(1, 2)
    gap = np.abs(covariances - covariances.swapaxes(1, 2)).max(axis=(1, 2))
    assert (gap > 1e-9 * np.trace(covariances, axis1=1, axis2=2)).any()
    for kind in (np.float32, np.float64):
        points = PointSet(rng.standard_normal((200, 2)), covariances.astype(kind))
        assert_array_equal(points.covariances, points.covariances.swapaxes(2, 1))


def test_one_covariance_serves_all_targets():
    """Breaks if a user has to repeat it for each target."""
    for means in (np.zeros((3, 2)), np.zeros((4, 3, 2))):
        points = PointSet(means, [[0.04, 0.01], [0.01, 0.09]])
        assert points.covariances.shape == (*means.shape, 2)
        assert (points.covariances == [[0.04, 0.01], [0.01, 0.09]]).all()


def test_a_set_and_its_copies_do_not_change():
    """Breaks if an edit of the user's array or of a copy leaves what was computed before."""
    means = np.arange(6.0).reshape(3, 2)
    points = PointSet(means, np.eye(2))
    register(points, points)
    means *= 2.0
    for same in (points, copy.deepcopy(points), pickle.loads(pickle.dumps(points))):
        assert_array_equal(same.means, np.arange(6.0).reshape(3, 2))
        with pytest.raises(ValueError, match="read-only"):
            same.means[...] = 0.0
