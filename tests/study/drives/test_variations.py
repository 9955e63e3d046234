"""Variations of a drive: a sparse world, fixed starts."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d.radar import estimate_ego_motion, simulate_drive
from d2d.study.drives.variations import sparse, track_from


def test_a_sparse_world_has_fewer_points_and_nobody_about(driven):
    """Breaks if positions, strengths and kinds are thinned apart."""
    world = driven[0].world
    few = sparse(world, np.random.default_rng(0))
    count = len(world.reflectors.kind)
    assert len(few.reflectors.kind) == pytest.approx(0.2 * count, abs=4.0 * np.sqrt(0.16 * count))
    where = {tuple(at): k for k, at in enumerate(world.reflectors.positions)}
    rows = [where[tuple(at)] for at in few.reflectors.positions]
    assert_allclose(few.reflectors.strength, 4.0 * world.reflectors.strength[rows])
    assert_array_equal(few.reflectors.kind, world.reflectors.kind[rows])
    lonely = simulate_drive(np.random.default_rng(0), 0.5, world=few)
    assert "moving" not in set(np.concatenate([true.kind for true in lonely.targets]))


def test_track_from_starts_every_pair_at_the_same_place(driven):
    drive, result = driven
    start = np.array([1.0, 0.5, 0.0])
    alone = track_from(drive, start, doppler=False, scales=(2.0, 1.0))
    assert_array_equal(alone.times, result.times)
    assert_array_equal(alone.intervals, result.intervals)
    for i in (0, 30, 59):
        pair = drive.scans[i], drive.scans[i + 1], drive.mounting
        direct = estimate_ego_motion(*pair, doppler=False, initial=start, scales=(2.0, 1.0))
        assert_array_equal(alone.theta[i], direct.theta)
        assert_array_equal(alone.covariance[i], direct.covariance)
        assert alone.converged[i] == direct.converged
