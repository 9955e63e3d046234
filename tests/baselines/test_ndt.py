"""Cells against a plain loop, scores against published formulas, gradients against differences."""

import numpy as np
import pytest

from d2d import RegistrationCost, gaussian, rigid
from d2d.baselines import grid_cells, ndt_d2d, ndt_p2d, pooled_cells
from d2d.baselines.ndt import D2D, P2D, bare_points
from d2d.study.point_sets.room_scans import (
    MOTION,
    ROOM,
    random_room,
    ray_ranges,
    room_pair,
    room_scan,
    segments,
)

THETA = np.array([0.45, 0.35, 0.15])


@pytest.fixture(scope="module")
def scans():
    before, after = room_pair(np.random.default_rng(1))
    return before.points, after.points


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
        np.testing.assert_allclose(got_mean, mean, atol=1e-12)
        np.testing.assert_allclose(got_sigma, sigma, atol=1e-12)


def test_points_on_a_line_get_the_floor_of_biber_and_strasser():
    points = np.stack([np.linspace(0.1, 0.9, 9), np.full(9, 0.5)], axis=-1)
    values = np.linalg.eigvalsh(grid_cells(points).covariances)[0]
    assert values[0] == pytest.approx(1e-3 * values[1])


def test_cells_with_too_few_points_and_without_extent_are_left_out():
    line = np.stack([np.linspace(0.1, 0.9, 9), np.linspace(0.1, 0.9, 9)], axis=-1)
    lonely, stacked = np.array([[5.5, 5.5], [5.6, 5.5]]), np.tile([[8.5, 8.5]], (4, 1))
    assert grid_cells(np.concatenate([line, lonely, stacked])).size == 1
    with pytest.raises(ValueError, match="points"):
        grid_cells(lonely)


def test_shifted_grids_count_every_point_again(scans):
    points = scans[0]
    pooled = pooled_cells(points)
    parts = [grid_cells(points, shift=s) for s in ((0, 0), (0.5, 0), (0, 0.5), (0.5, 0.5))]
    assert pooled.size == sum(part.size for part in parts)
    np.testing.assert_array_equal(pooled.means, np.concatenate([p.means for p in parts]))
    moved = grid_cells(points + np.array([0.5, 0.0]))
    np.testing.assert_allclose(moved.means - [0.5, 0.0], parts[1].means, atol=1e-12)


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
    axis = np.arange(-6.0, 8.0, 0.02)
    where = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)

    def sum_of_densities(cells):
        return sum(
            gaussian.density(where, mean, sigma)
            for mean, sigma in zip(cells.means, cells.covariances, strict=True)
        )

    one, other = fixed.inflated(3.0), moving.inflated(3.0).transformed(THETA)
    product = (sum_of_densities(one) * sum_of_densities(other)).sum() * 0.02**2
    cost = D2D.value(THETA, type(one)(one.means, one.covariances), moving.inflated(3.0))
    assert np.exp(-cost) * fixed.size == pytest.approx(product, rel=1e-3)


@pytest.mark.parametrize("metric", ["p2d", "d2d"])
def test_gradients_and_hessians_agree_with_differences(scans, metric):
    fixed = pooled_cells(scans[0])
    moving = bare_points(scans[1]) if metric == "p2d" else grid_cells(scans[1])
    cost = RegistrationCost(metric=metric, fusion="summing")
    _, gradient, hessian = cost.derivatives(THETA, fixed, moving)
    step = 1e-6 * np.eye(3)
    ahead, _, _ = cost.derivatives(THETA + step, fixed, moving)
    behind, _, _ = cost.derivatives(THETA - step, fixed, moving)
    scale = np.abs(gradient).max()
    np.testing.assert_allclose(gradient, (ahead - behind) / 2e-6, atol=1e-7 * scale)
    slopes = [cost.derivatives(THETA + s, fixed, moving)[1] for s in (*step, *-step)]
    differences = (np.array(slopes[:3]) - np.array(slopes[3:])) / 2e-6
    np.testing.assert_allclose(hessian, differences, atol=1e-7 * np.abs(hessian).max())


@pytest.mark.parametrize("method", [ndt_p2d, ndt_d2d])
def test_two_scans_of_a_room_are_registered(scans, method):
    estimate = method(*scans, MOTION + np.array([0.1, -0.1, 0.03]))
    assert estimate.converged
    np.testing.assert_allclose(estimate.theta, MOTION, atol=0.03)
    assert np.abs(estimate.gradient).max() < 1e-4


def test_a_batch_of_starts_is_one_call(scans):
    starts = MOTION + np.zeros((2, 5, 3))
    assert ndt_d2d(*scans, starts).theta.shape == (2, 5, 3)


POINTS = np.random.default_rng(0).uniform(0.0, 2.0, (50, 2))


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: grid_cells(np.zeros((4, 3))), "points"),
        (lambda: grid_cells(POINTS * np.inf), "points"),
        (lambda: grid_cells(POINTS, 0.0), "size"),
        (lambda: grid_cells(POINTS, 1e-20), "size"),
        (lambda: grid_cells(POINTS * 1e20), "size"),
        (lambda: grid_cells(POINTS, shift=(0.5,)), "shift"),
        (lambda: grid_cells(POINTS, min_points=1), "min_points"),
        (lambda: grid_cells(POINTS, smallest_ratio=0.0), "smallest_ratio"),
        (lambda: pooled_cells(POINTS, shifts=()), "shifts"),
        (lambda: ndt_p2d(POINTS, np.zeros((0, 2))), "moving"),
        (lambda: ndt_p2d(np.zeros(3), POINTS), "fixed"),
        (lambda: ndt_d2d(POINTS, POINTS, d2=0.0), "d2"),
        (lambda: ndt_d2d(POINTS, POINTS, [0.0, 0.0]), "theta|initial"),
    ],
)
def test_bad_input_names_the_argument(call, name):
    with pytest.raises(ValueError, match=name):
        call()


# ---- The room that chapter 3 scans ---------------------------------------------------------------


def test_rays_end_on_the_walls():
    azimuth = np.linspace(-np.pi, np.pi, 90)
    pose = np.array([0.5, 0.3, 0.4])
    ends = pose[:2] + ray_ranges(pose, azimuth)[:, None] * np.stack(
        [np.cos(pose[2] + azimuth), np.sin(pose[2] + azimuth)], axis=-1
    )
    start, along = segments(ROOM)[:, 0], np.diff(segments(ROOM), axis=1)[:, 0]
    share = np.einsum("nsi,si->ns", ends[:, None] - start, along) / (along**2).sum(axis=-1)
    foot = start + np.clip(share, 0, 1)[..., None] * along
    assert np.linalg.norm(ends[:, None] - foot, axis=-1).min(axis=1).max() < 1e-9


def test_scans_without_noise_agree_on_the_room():
    """The second scan, moved by the motion, lies on the walls that the first scanner sees."""
    _, after = room_pair(np.random.default_rng(0))
    noise_free = room_scan(np.random.default_rng(0), MOTION, sigma_range=1e-12)
    moved = rigid.transform_means(MOTION, noise_free.points)
    seen = ray_ranges(np.zeros(3), np.arctan2(moved[:, 1], moved[:, 0]))
    visible = np.hypot(*moved.T) <= seen + 1e-6
    np.testing.assert_allclose(np.hypot(*moved.T)[visible], seen[visible], atol=1e-6)
    assert visible.mean() > 0.9
    assert len(after.points) == len(noise_free.points)


def test_the_share_of_outliers_is_exact_and_seeded():
    one, two = (room_scan(np.random.default_rng(3), outliers=0.2) for _ in range(2))
    assert one.outlier.sum() == 36
    np.testing.assert_array_equal(one.points, two.points)
    assert not room_scan(np.random.default_rng(3)).outlier.any()


def test_random_rooms_hold_the_scanner_before_and_after_the_motion():
    for seed in range(200):
        rng = np.random.default_rng(seed)
        room_pair(rng, walls=random_room(rng))


def test_targets_cover_the_gap_between_rays():
    scan = room_scan(np.random.default_rng(4))
    across = np.sqrt(np.linalg.eigvalsh(scan.targets().covariances))
    gap = scan.range * 2.0 * np.pi / 180
    widest = np.maximum(0.5 * gap, 0.03)
    np.testing.assert_allclose(across[:, 1], widest, rtol=1e-9)


def test_bad_rooms_name_the_argument():
    for name, bad in (("pose", [50.0, 0.0, 0.0]), ("outliers", 1.5), ("field_of_view", 7.0)):
        with pytest.raises(ValueError, match=name):
            room_scan(np.random.default_rng(), **{name: bad})
