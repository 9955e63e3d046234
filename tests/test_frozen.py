"""What is frozen stays so in every copy, and no copy carries values computed for another."""

import copy
import pickle
from dataclasses import fields
from functools import cached_property

import joblib
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from d2d import CorruptedGaussian, LinearMeasurement, PointSet, UniformOutlier
from d2d._frozen import Frozen
from d2d.radar import Comparison, EgoMotionModel, Mounting, RadarScan, Track, World, build_world
from d2d.radar.motion.model import DEFAULT_OUTLIER
from d2d.radar.simulation.drive import simulate_drive
from d2d.study.mixtures.gaussian import GaussianMixture
from tests.radar.tracks.test_track import N, example

EYES = np.tile(np.eye(2), (3, 1, 1))
SCANS = simulate_drive(np.random.default_rng(0), 0.2).scans
MOUNTING = Mounting(0.4)

# Each with all that it can compute lazily in use.
MAKERS = {
    "PointSet": lambda: PointSet([[8.0, 1.0], [5.0, -3.0], [6.0, 4.0]], EYES),
    "PointSet-from_polar": lambda: PointSet.from_polar([8.0, 5.0], [0.1, -0.4], 0.2, 0.01),
    "PointSet-shifted": lambda: PointSet(np.ones((3, 2)), EYES).shifted(np.ones(2)),
    "RadarScan": lambda: RadarScan(0.0, [5.0, 8.0], [0.1, 0.2], [1.0, 2.0], 0.1, 0.01, 0.1),
    "RadarScan-part": lambda: SCANS[0][:5],
    "LinearMeasurement": lambda: LinearMeasurement(
        np.zeros(3), 1.0, 0.1, np.ones((3, 3)), np.ones((3, 3))
    ),
    "LinearMeasurement-doppler": lambda: SCANS[0].doppler_measurement(MOUNTING, 0.1),
    "CorruptedGaussian": lambda: CorruptedGaussian(0.2, 100.0 * np.eye(2)),
    "CorruptedGaussian-default": lambda: DEFAULT_OUTLIER,
    "UniformOutlier": lambda: UniformOutlier(0.1),
    "EgoMotionModel": lambda: EgoMotionModel(),
    "GaussianMixture": lambda: GaussianMixture([1.0], [[0.0, 1.0]], [np.eye(2)]),
    "World": lambda: build_world(np.random.default_rng(0)),
    "Track": example,
    "Comparison": lambda: Comparison.from_errors(example(), np.zeros((N, 3))),
}

WAYS = {
    "itself": lambda thing: thing,
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda thing: pickle.loads(pickle.dumps(thing)),
}


def lazy_names(thing: Frozen) -> list[str]:
    kind = type(thing)
    return [name for name in dir(kind) if isinstance(getattr(kind, name), cached_property)]


@pytest.mark.parametrize("kind", MAKERS)
def test_every_copy_is_read_only_and_computes_its_own_values(kind):
    """Breaks if an edit of a copy, or of the original, goes through and a cache does not see it.

    Also if what was computed for the original travels along, or changes what is stored: a sweep
    would run a condition anew because its sets had been registered before.
    """
    original = MAKERS[kind]()
    names = lazy_names(original)
    for name in names:
        getattr(original, name)
    for way, duplicate in WAYS.items():
        other = duplicate(original)
        assert type(other) is type(original)
        if way != "itself":
            assert not other.__dict__.keys() & set(names)
        for field in fields(original):
            value, expected = getattr(other, field.name), getattr(original, field.name)
            if isinstance(value, np.ndarray):
                assert_array_equal(value, expected)
            for array in value if isinstance(value, tuple) else (value,):
                if isinstance(array, np.ndarray):
                    with pytest.raises(ValueError, match="read-only"):
                        array[...] = array.flat[0]
        for name in names:
            assert joblib.hash(getattr(other, name)) == joblib.hash(getattr(original, name))
    if kind != "CorruptedGaussian-default":  # of which there is only one
        assert joblib.hash(MAKERS[kind]()) == joblib.hash(original)


def test_an_edit_of_the_users_array_reaches_no_container():
    one, points, gain, corners = np.ones(3), np.ones((3, 2)), np.ones((3, 3)), np.ones((1, 4, 2))
    eyes, wide, mixed = EYES.copy(), 100.0 * np.eye(2), np.full(3, 1.0 / 3.0)
    times, spread = np.arange(3.0), np.tile(np.eye(3), (3, 1, 1))
    world = MAKERS["World"]()
    made = [
        PointSet(points, eyes, one),
        RadarScan(0.0, one, one, one, one, one, one),
        LinearMeasurement(one, one, one, gain, gain),
        CorruptedGaussian(0.2, wide),
        GaussianMixture(mixed, points, eyes),
        World(corners, corners, world.reflectors, world.movers),
        Track(times, one, gain, spread, [True] * 3),
    ]
    before = copy.deepcopy(made)
    for array in (one, points, gain, corners, eyes, wide, mixed, times, spread):
        array *= 2.0
    for thing, same in zip(made, before, strict=True):
        for field in fields(thing):
            value = getattr(thing, field.name)
            if isinstance(value, np.ndarray):
                assert_array_equal(value, getattr(same, field.name))
