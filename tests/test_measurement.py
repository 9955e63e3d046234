"""LinearMeasurement: its arrays, and what it does where it is extreme.

Its density and derivatives are tested in test_cost, with everything else.
"""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import norm

from d2d import LinearMeasurement, RegistrationCost, rigid
from tests.strategies import MEASURED, doppler_like, random_problem


@pytest.mark.parametrize("outlier", ["uniform", "corrupted"])
def test_the_outlier_component_does_not_know_it(outlier):
    """Breaks if an impossible measurement does not turn its target into an outlier."""
    problem = random_problem(np.random.default_rng(2), outlier=outlier, measured="motion")
    m = problem.measurement
    absurd = LinearMeasurement(m.value + 1e5, m.sigma, m.sigma_input, m.gain, m.slope)
    densities = problem.with_(measurement=absurd).densities()
    if outlier == "uniform":
        expected = np.full(problem.moving.size, problem.cost.outlier.density)
    else:
        # the inliers' share, times zero, plus that of the outliers
        model = problem.cost.outlier
        only = RegistrationCost(outlier=type(model)(1.0, model.covariance))
        expected = model.fraction * problem.with_(cost=only, measurement=None).densities()
    assert_allclose(densities, expected, rtol=1e-12)
    assert np.isfinite(problem.with_(measurement=absurd).derivatives()[2]).all()


def test_the_twist_is_the_velocity_of_an_arc():
    """Breaks if of_twist takes theta / tau for the body velocity while the vehicle turns."""
    problem = random_problem(np.random.default_rng(3))
    velocity = np.array([10.0, -1.0, 2.5])
    template = doppler_like(np.random.default_rng(4), velocity, problem.moving.size)
    exact = LinearMeasurement(
        template.gain @ velocity, 1e-3, 0.0, template.gain, template.slope, of_twist=True
    )
    on_arc = problem.with_(theta=rigid.exponential(velocity), measurement=exact)
    plain = on_arc.with_(measurement=None)
    peak = norm.pdf(0.0, 0.0, 1e-3)
    assert_allclose(on_arc.densities(), plain.densities() * peak, rtol=1e-9)
    on_chord = on_arc.with_(theta=velocity)
    assert (on_chord.densities() < 1e-3 * plain.with_(theta=velocity).densities()).all()


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
