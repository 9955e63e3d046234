"""Containers do not change: neither they nor their copies, nor when the user's arrays do."""

import copy
import pickle
from dataclasses import fields

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from d2d import CorruptedGaussian, LinearMeasurement, PointSet, register
from d2d.radar import Mounting, RadarScan

ONE, GAIN, WIDE = np.ones(3), np.ones((3, 3)), 100.0 * np.eye(2)
MEANS, EYES = np.arange(6.0).reshape(3, 2), np.tile(np.eye(2), (3, 1, 1))
MAKERS = {
    "PointSet": lambda: PointSet(MEANS, EYES, ONE),
    "CorruptedGaussian": lambda: CorruptedGaussian(0.2, WIDE),
    "LinearMeasurement": lambda: LinearMeasurement(ONE, ONE, ONE, GAIN, GAIN),
    "RadarScan": lambda: RadarScan(0.0, ONE, ONE, ONE, ONE, ONE, ONE),
}


def arrays_of(thing):
    found = {field.name: getattr(thing, field.name) for field in fields(thing)}
    return {name: value for name, value in found.items() if isinstance(value, np.ndarray)}


@pytest.mark.parametrize("kind", MAKERS)
def test_no_array_of_a_copy_can_be_written(kind):
    """Breaks if an edit of a copy goes through and what was computed for the old values stays."""
    original = MAKERS[kind]()
    if kind == "RadarScan":
        original.doppler_measurement(Mounting(0.4), 0.1)
    if kind == "PointSet":
        register(original, original)
    for duplicate in (
        original,
        copy.copy(original),
        copy.deepcopy(original),
        pickle.loads(pickle.dumps(original)),
    ):
        for name, array in arrays_of(duplicate).items():
            assert_array_equal(array, getattr(original, name))
            with pytest.raises(ValueError, match="read-only"):
                array[...] = 0.0
    assert len(pickle.dumps(original)) == len(pickle.dumps(MAKERS[kind]()))  # no cached values


def test_an_edit_of_the_users_array_reaches_no_container():
    """Breaks if a container keeps the array that it was given."""
    made = [make() for make in MAKERS.values()]
    before = [copy.deepcopy(thing) for thing in made]
    given = (ONE, GAIN, WIDE, MEANS, EYES)
    try:
        for array in given:
            array *= 2.0
        for thing, same in zip(made, before, strict=True):
            for name, array in arrays_of(thing).items():
                assert_array_equal(array, getattr(same, name))
    finally:
        for array in given:
            array *= 0.5
