"""The lateral velocity that a slip law gives."""

import numpy as np
from numpy.testing import assert_allclose

from d2d.radar import SlipLaw


def test_damaged_velocities_give_nan_and_no_warning():
    """Breaks if one wrong number of an odometry stops a program, or becomes an infinite one."""
    v_x = np.array([10.0, np.nan, 1e200, np.inf, 10.0])
    omega = np.array([0.1, 0.1, 0.1, 0.0, np.nan])
    for law, known in ((SlipLaw(1.0, 0.005), 0.05), (SlipLaw(), 0.0)):
        assert_allclose(law.lateral(v_x, omega), [known, *[np.nan] * 4])
