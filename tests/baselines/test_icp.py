"""The closed-form fit against truth and against a search; ICP against its own promises."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import minimize

from d2d import rigid
from d2d.baselines import fit_rigid, icp, line_normals
from d2d.study.point_sets.room_scans import MOTION
from tests.strategies import reals, seeds

RNG_POINTS = np.random.default_rng(0).uniform(-5.0, 5.0, (30, 2))


@given(seeds, st.sampled_from([(), (3,), (2, 1)]), st.integers(2, 500), reals(-6.0, 6.0))
def test_paired_points_are_fitted_exactly_at_any_scale(seed, batch, count, decade):
    """Breaks if a mirror is taken for a rotation, or a batch's pairs are mixed up."""
    rng, unit = np.random.default_rng(seed), 10.0**decade
    theta = rng.uniform(-3.1, 3.1, (*batch, 3))
    theta[..., :2] *= unit
    moving = unit * rng.standard_normal((*batch, count, 2))
    found = fit_rigid(rigid.transform_means(theta, moving), moving)
    assert_allclose(found, theta, rtol=1e-6, atol=1e-6 * unit if decade < 0 else 1e-6)


def test_closed_form_is_the_best_motion():
    """Breaks if it is no optimum; mirrored points are best matched by what is no rigid motion."""
    noise = 0.3 * np.random.default_rng(3).standard_normal((30, 2))
    moved = rigid.transform_means([0.4, 0.2, 0.5], RNG_POINTS) + noise
    for fixed in (moved, RNG_POINTS * [1.0, -1.0]):
        found = fit_rigid(fixed, RNG_POINTS)

        def squares(theta, fixed=fixed):
            return ((rigid.transform_means(theta, RNG_POINTS) - fixed) ** 2).sum()

        for angle in np.linspace(-np.pi, np.pi, 7):
            searched = minimize(squares, [0.0, 0.0, angle], tol=1e-12)
            assert squares(found) <= searched.fun + 1e-9


@pytest.mark.parametrize("metric", ["point", "line"])
def test_two_scans_of_a_room_are_registered_and_a_copy_exactly(scans, metric):
    theta = np.array([0.02, -0.01, 0.005])  # nearer than the points are to each other
    moving = rigid.transform_means(rigid.inverse(theta), scans[0])
    result = icp(scans[0], moving, metric=metric, tolerance=1e-12)
    assert result.converged
    assert_allclose(result.theta, theta, atol=1e-10)
    assert result.rms < 1e-10
    result = icp(*scans, metric=metric)
    assert result.converged or metric == "line"  # which may swap between two pairings
    assert_allclose(result.theta, MOTION, atol=0.03)


@given(seeds, reals(-6.0, 6.0), st.integers(10, 300), st.sampled_from(["point", "line"]))
def test_icp_is_right_in_any_unit_and_order(seed, decade, count, metric):
    """Breaks if a tolerance is a hidden length, or the order of the points matters."""
    rng, unit = np.random.default_rng(seed), 10.0**decade
    fixed = rng.uniform(-10.0, 10.0, (count, 2))
    theta = np.array([0.02, -0.03, 0.002])
    moving = rigid.transform_means(rigid.inverse(theta), fixed)
    per = np.array([unit, unit, 1.0])
    one = icp(fixed, moving, metric=metric)
    shuffled = fixed[rng.permutation(count)]
    two = icp(shuffled * unit, moving * unit, metric=metric, tolerance=1e-6 * unit)
    assert one.converged == two.converged
    assert_allclose(two.theta / per, one.theta, atol=1e-5)
    assert one.thetas.shape == (one.iterations + 1, 3)


def test_point_to_point_never_raises_its_error(scans):
    """Besl & McKay 1992, theorem: neither pairing anew nor fitting can raise the mean square."""
    starts = MOTION + np.random.default_rng(4).uniform(-1.0, 1.0, (20, 3)) * [3.0, 3.0, 2.0]
    history = icp(*scans, starts).rms_history
    assert (np.diff(history, axis=0) <= 1e-12).all()


@pytest.mark.parametrize("metric", ["point", "line"])
def test_a_batch_is_its_problems_one_by_one(scans, metric):
    starts = MOTION + np.random.default_rng(5).uniform(-0.5, 0.5, (2, 3, 3))
    together = icp(*scans, starts, metric=metric)
    assert together.theta.shape == (2, 3, 3)
    assert together.thetas.shape[1:] == (2, 3, 3)
    assert_array_equal(together.thetas[0], starts)
    assert_array_equal(together.thetas[-1], together.theta)
    assert_array_equal(together.rms_history[-1], together.rms)
    for index in np.ndindex(2, 3):
        alone = icp(*scans, starts[index], metric=metric)
        assert_allclose(together.theta[index], alone.theta, atol=1e-12)
        assert together.iterations[index] == alone.iterations
        assert together.converged[index] == alone.converged


@pytest.mark.parametrize("metric", ["point", "line"])
@pytest.mark.parametrize("distance", [0.0, 1e3, 5e6])
def test_a_set_far_from_the_origin_is_turned(metric, distance):
    """Breaks if the lever is the distance to the origin: from a kilometre on, nothing turned."""
    place = distance * np.array([1.0, 0.7])
    turn = rigid.about(np.zeros(2), np.array([0.02, -0.01, np.deg2rad(1.5)]))
    posts = np.stack(np.meshgrid(np.arange(-4.0, 5.0), np.arange(-4.0, 5.0)), -1).reshape(-1, 2)
    posts += 0.2 * np.random.default_rng(7).standard_normal(posts.shape)
    moving = rigid.transform_means(rigid.inverse(turn), posts)
    result = icp(posts + place, moving + place, metric=metric)
    assert result.converged
    assert_allclose(result.theta[2], turn[2], atol=1e-6)
    assert_allclose(rigid.transform_means(result.theta, moving + place), posts + place, atol=1e-6)


def test_bad_input_names_the_argument():
    for call, name in (
        (lambda: fit_rigid(RNG_POINTS, RNG_POINTS[:5]), "moving must have the shape"),
        (lambda: fit_rigid(RNG_POINTS, RNG_POINTS * np.nan), "moving"),
        (lambda: line_normals(RNG_POINTS, 30), "neighbours"),
        (lambda: icp(RNG_POINTS[:, :1], RNG_POINTS), "fixed"),
        (lambda: icp(1e160 * RNG_POINTS, RNG_POINTS), "fixed must be at most"),
        (lambda: icp(RNG_POINTS, RNG_POINTS, [0.0, 0.0]), "initial"),
        (lambda: icp(RNG_POINTS, RNG_POINTS, [0.0, 0.0, 90.0]), "initial must be in radians"),
        (lambda: icp(RNG_POINTS, RNG_POINTS, metric="plane"), "metric"),
        *(
            (lambda name=name, value=value: icp(RNG_POINTS, RNG_POINTS, **{name: value}), name)
            for name, values in {
                "tolerance": (-1.0, 0.0, np.nan, None, "1"),
                "max_iterations": (-1, 2.5, np.nan, True, None),
            }.items()
            for value in values
        ),
    ):
        with pytest.raises(ValueError, match=name):
            call()
