"""The simulated street: a lap that closes, walls that hide, bodies that move as they say."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d.radar.simulation.world import LAP, build_world, lap_poses, visible

WORLD = build_world(np.random.default_rng(0))


def test_a_point_is_hidden_where_a_wall_crosses_its_ray():
    """Breaks if a ray through a wall's prolongation is stopped, one through the wall is not, or a
    wall that reaches beyond all points is left out."""
    rng = np.random.default_rng(1)
    walls = np.cumsum(rng.uniform(-6.0, 6.0, (40, 2, 2)), axis=1) + rng.uniform(-18, 18, (40, 1, 2))
    for points in (rng.uniform(-20.0, 20.0, (200, 2)), *rng.uniform(-20.0, 20.0, (200, 1, 2))):
        for point, seen in zip(points, visible(points, walls), strict=True):
            crossings = [
                np.linalg.solve(np.column_stack([point, start - end]), start)
                for start, end in walls
            ]
            within = [(shares > 0.0).all() and (shares < 1.0).all() for shares in crossings]
            assert seen == (not any(within))


def test_points_of_a_mover_keep_their_distances():
    """Breaks if a body is bent around the corner."""
    positions, _ = WORLD.movers.at(np.linspace(0.0, 60.0, 50))
    car = positions[:, :6]
    spread = np.linalg.norm(car[:, :, None] - car[:, None], axis=-1)
    assert_allclose(spread, np.broadcast_to(spread[0], spread.shape), rtol=0, atol=1e-7)
    assert spread.max() > 1.0


def test_the_path_is_free():
    """Breaks if something is built on, or stands in, the lane that the vehicle drives."""
    path = lap_poses(np.arange(0.0, LAP, 1.0))[:, :2]
    for seed in range(3):
        world = build_world(np.random.default_rng(seed))
        start, end = world.walls[:, :1], world.walls[:, 1:]
        walls = start + np.linspace(0.0, 1.0, 60)[:, None] * (end - start)
        moving, _ = world.movers.at(np.linspace(0.0, 60.0, 100))
        for obstacles in (walls, world.points, moving):
            apart = np.linalg.norm(obstacles.reshape(-1, 1, 2) - path, axis=-1)
            assert apart.min() > 1.4


def test_a_wall_is_a_row_of_points_in_front_of_it():
    """Breaks if points lie inside the house, where they would hide behind their own wall."""
    points = WORLD.points[WORLD.kind == "wall"]
    edges = np.stack([WORLD.buildings, np.roll(WORLD.buildings, -1, axis=1)], axis=2)
    along = edges[:, :, 1] - edges[:, :, 0]
    outward = np.stack([along[..., 1], -along[..., 0]], axis=-1)
    outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
    off = np.einsum("pbex,bex->pbe", points[:, None, None] - edges[None, :, :, 0], outward)
    # the nearest house is the one of whose edges the greatest offset is the least
    gap = off.max(axis=2).min(axis=1)
    length = np.linalg.norm(along, axis=-1).sum()
    assert len(points) == pytest.approx(length / 0.7, abs=4.0 * np.sqrt(length / 0.7))
    assert (gap < 0.26).all()
    assert np.quantile(gap, 0.2) > 0.02  # a few lie inside a house that overlaps
