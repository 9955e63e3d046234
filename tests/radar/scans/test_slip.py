"""The lateral velocity that a slip law gives."""

import numpy as np
from numpy.testing import assert_allclose

from d2d.radar import SlipLaw


def test_velocities_that_are_not_known_give_nan():
    """Breaks if one hole of an odometry stops a program, or becomes a number."""
    v_x, omega = np.array([10.0, np.nan, 10.0]), np.array([0.1, 0.1, np.nan])
    for law, known in ((SlipLaw(1.0, 0.005), 0.05), (SlipLaw(), 0.0)):
        assert_allclose(law.lateral(v_x, omega), [known, np.nan, np.nan])
