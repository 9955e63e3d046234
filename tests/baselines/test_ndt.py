"""Cells against a plain loop, scores against published formulas, gradients against differences."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from d2d import rigid
from d2d.baselines import grid_cells, ndt_d2d, ndt_p2d, pooled_cells
from d2d.baselines.ndt import D2D, P2D, bare_points
from d2d.study.mixtures import gaussian
from d2d.study.point_sets.room_scans import MOTION
from tests.strategies import reals, seeds

THETA = np.array([0.45, 0.35, 0.15])


def plain_cells(points, size, min_points, ratio):
    """The cells with a dictionary and one point after the other."""
    members = {}
    for x, y in points:
        members.setdefault((int(x // size), int(y // size)), []).append((x, y))
    cells = {}
    for place, inside in members.items():
        if len(inside) >= min_points:
            inside = np.array(inside)
            centred = inside - inside.mean(axis=0)
            values, vectors = np.linalg.eigh(centred.T @ centred / len(inside))
            values[0] = max(values[0], ratio * values[1])
            cells[place] = inside.mean(axis=0), vectors @ np.diag(values) @ vectors.T
    return cells


def test_cells_are_those_of_a_plain_loop(scans):
    points = scans[0]
    cells = grid_cells(points)
    expected = plain_cells(points, 1.0, 3, 1e-3)
    assert cells.size == len(expected)
    for (_, (mean, sigma)), got_mean, got_sigma in zip(
        sorted(expected.items()), cells.means, cells.covariances, strict=True
    ):
        assert_allclose(got_mean, mean, atol=1e-12)
        assert_allclose(got_sigma, sigma, atol=1e-12)


def test_cells_with_too_few_points_and_without_extent_are_left_out():
    line = np.stack([np.linspace(0.1, 0.9, 9), np.linspace(0.1, 0.9, 9)], axis=-1)
    lonely, stacked = np.array([[5.5, 5.5], [5.6, 5.5]]), np.tile([[8.5, 8.5]], (4, 1))
    assert grid_cells(np.concatenate([line, lonely, stacked])).size == 1
    with pytest.raises(ValueError, match="points"):
        grid_cells(lonely)


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
    shifted = grid_cells(points, 2.0, shift=(0.5, 0.5))
    assert_array_equal(pooled.means, np.concatenate([cells.means, shifted.means]))
    # each component peaks at 1
    peak = 2.0 * np.pi * np.sqrt(np.linalg.det(pooled.covariances))
    assert_allclose(pooled.weights / peak, 1.0, rtol=1e-12)


def test_p2d_is_the_published_score(scans):
    """exp(-cost) is the sum of exp(-d' S^-1 d / 2), not normalised, over points and cells."""
    fixed, moving = scans
    cells = pooled_cells(fixed)
    moved = rigid.transform_means(THETA, moving)
    score = 0.0
    for mean, sigma in zip(cells.means, cells.covariances, strict=True):
        d = moved - mean
        score += np.exp(-0.5 * np.einsum("ni,ij,nj->n", d, np.linalg.inv(sigma), d)).sum()
    found = np.exp(-P2D.value(THETA, cells, bare_points(moving)))
    assert found == pytest.approx(score, rel=1e-12)


def test_d2d_is_the_inner_product_of_the_mixtures(scans):
    """Thesis eq. 4.6: sum of N(0 | d, R Sigma_k R' + Sigma_i), by integration on a grid."""
    fixed, moving = (grid_cells(points, 2.0) for points in scans)
    axis = np.arange(-6.0, 8.0, 0.03)
    where = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)

    def sum_of_densities(cells):
        return sum(
            gaussian.density(where, mean, sigma)
            for mean, sigma in zip(cells.means, cells.covariances, strict=True)
        )

    one, other = fixed.inflated(3.0), moving.inflated(3.0).transformed(THETA)
    product = (sum_of_densities(one) * sum_of_densities(other)).sum() * 0.03**2
    cost = D2D.value(THETA, type(one)(one.means, one.covariances), moving.inflated(3.0))
    assert np.exp(-cost) * fixed.size == pytest.approx(product, rel=1e-3)


@pytest.mark.parametrize("method", [ndt_p2d, ndt_d2d])
def test_two_scans_of_a_room_are_registered(scans, method):
    estimate = method(*scans, MOTION + np.array([0.1, -0.1, 0.03]))
    assert estimate.converged
    assert_allclose(estimate.theta, MOTION, atol=0.03)
    assert np.abs(estimate.gradient).max() < 1e-4


POINTS = np.random.default_rng(0).uniform(0.0, 2.0, (50, 2))


def test_bad_input_names_the_argument():
    for call, name in (
        (lambda: grid_cells(np.zeros((4, 3))), "points"),
        *((lambda size=size: grid_cells(POINTS, size), "size") for size in (0.0, 1e300)),
        (lambda: grid_cells(POINTS + 5e6, 1e-13), "size"),
        (lambda: grid_cells(POINTS, min_points=2.5), "min_points"),
        (lambda: grid_cells(POINTS, smallest_ratio=np.nan), "smallest_ratio"),
        (lambda: grid_cells(POINTS, shift=(np.nan, 0.0)), "shift"),
        (lambda: pooled_cells(POINTS, shifts=()), "shifts"),
        (lambda: ndt_p2d(POINTS, np.zeros((0, 2))), "moving"),
        (lambda: ndt_d2d(POINTS, POINTS, [0.0, 0.0]), "theta|initial"),
        (lambda: ndt_d2d(POINTS, POINTS, d2=1e-110), "d2"),
    ):
        with pytest.raises(ValueError, match=name):
            call()


def test_points_on_a_line_get_the_floor_of_biber_and_strasser():
    points = np.stack([np.linspace(0.1, 0.9, 9), np.full(9, 0.5)], axis=-1)
    values = np.linalg.eigvalsh(grid_cells(points).covariances)[0]
    assert values[0] == pytest.approx(1e-3 * values[1])
