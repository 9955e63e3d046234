"""Many gradient descents at once end where one after the other does."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from d2d.study.estimation import descent
from d2d.study.estimation.optimisers import cost
from d2d.study.plane.scenarios import OVERLAPPED


def problems(count: int) -> list[descent.PairedTargets]:
    fixed, moving = OVERLAPPED.sample(count, np.random.default_rng(3))
    return [descent.PairedTargets(fixed[run], moving[run]) for run in range(count)]


def test_many_descents_are_those_of_one_at_a_time(monkeypatch):
    """Breaks if a descent goes on after it has converged, or one stops with another."""
    monkeypatch.setattr(descent, "MAX_DESCENTS", 6000)  # which not all of these keep to
    given = problems(4)
    starts = OVERLAPPED.theta + np.random.default_rng(1).uniform(-0.5, 0.5, (4, 3))
    together = descent.gradient_descents(given, starts)
    alone = descent.ends_of(
        [
            descent.run_all(each, start)[descent.FIRST_ORDER]
            for each, start in zip(given, starts, strict=True)
        ]
    )
    assert 0 < together.converged.sum() < 4
    assert_array_equal(together.converged, alone.converged)
    assert_allclose(together.iterations, alone.iterations, atol=1)
    assert_allclose(together.cost, alone.cost, rtol=1e-9)


def test_the_profile_is_the_least_over_the_third_parameter():
    """Breaks if the surface under the paths is not that of the problem."""
    (pairs,) = problems(1)
    t_y, angle = np.array([-0.5, 1.0]), np.array([0.2, 0.3])
    surface = descent.profile(pairs, t_y, angle)
    t_x = np.linspace(0.0, 10.0, 4001)
    for a, phi in enumerate(angle):
        for b, y in enumerate(t_y):
            costs = [cost(pairs, np.array([x, y, phi])) for x in t_x]
            assert_allclose(surface[a, b], min(costs), rtol=1e-5)
