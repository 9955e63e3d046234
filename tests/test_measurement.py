"""LinearMeasurement: its arrays, and what it does where it is extreme.

Its density and derivatives are tested in test_cost, with everything else.
"""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from d2d import LinearMeasurement
from tests.strategies import MEASURED, random_problem


def test_arrays_broadcast():
    """Breaks if a common sigma or a batch of values is not spread over the targets."""
    rng = np.random.default_rng(6)
    gain, slope = rng.standard_normal((2, 4, 3))
    value = rng.standard_normal((5, 1, 4))
    m = LinearMeasurement(value, 0.1, rng.uniform(0.0, 1.0, (6, 1)), gain, slope)
    assert m.batch_shape == (5, 6)
    assert (m.size, m.parameters) == (4, 3)
    assert m.sigma.shape == m.sigma_input.shape == m.value.shape == (5, 6, 4)
    assert m.gain.shape == m.slope.shape == (5, 6, 4, 3)
    assert_array_equal(m.value[3, 2], value[3, 0])


def test_inflation_multiplies_both_sigmas():
    """Breaks if one sigma, the kind of coordinates or the value changes with the scale."""
    for measured in MEASURED[1:]:
        m = random_problem(np.random.default_rng(7), measured=measured).measurement
        wide = m.inflated(3.0)
        assert_allclose(wide.sigma, 3.0 * m.sigma)
        assert_allclose(wide.sigma_input, 3.0 * m.sigma_input)
        for name in ("value", "gain", "slope", "of_twist"):
            assert_array_equal(getattr(wide, name), getattr(m, name))
