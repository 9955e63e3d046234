"""The figures of a drive: what is around the vehicle is drawn where the scan shows it."""

import matplotlib.pyplot as plt
import numpy as np
from numpy.testing import assert_allclose

from d2d.radar import Mounting, build_world
from d2d.study.drives import figures


def test_the_surroundings_are_in_the_frame_of_the_vehicle():
    """Breaks if the map is turned or shifted against the scan beside it."""
    world = build_world(np.random.default_rng(0))
    _, ax = plt.subplots()
    figures.surroundings(ax, world, [3.0, 4.0, 0.5 * np.pi], 2.0, Mounting(0.4))
    poles = next(line for line in ax.lines if line.get_label() == "pole").get_xydata()
    there = world.reflectors.positions[world.reflectors.kind == "pole"] - [3.0, 4.0]
    assert_allclose(poles, np.stack([there[:, 1], -there[:, 0]], axis=1), atol=1e-9)
    movers = next(line for line in ax.lines if line.get_label() == "moving").get_xydata()
    there = world.movers.at(np.asarray(2.0))[0] - [3.0, 4.0]
    assert_allclose(movers, np.stack([there[:, 1], -there[:, 0]], axis=1), atol=1e-9)
