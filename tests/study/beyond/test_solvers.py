"""Other solvers and other schedules, each against the plain call that it stands for."""

import numpy as np
from numpy.testing import assert_allclose

from d2d.study import scenarios
from d2d.study.beyond.solvers import SOLVERS, annealed_share, solved
from d2d.study.plane.evaluation import ROBUST, at_truth, evaluated, same_draws
from d2d.study.runs import scheduled


def test_solvers_start_where_they_are_told() -> None:
    """Breaks if ``off`` is measured from zero, or the batch differs from the loop."""
    expected = evaluated(scenarios.OVERLAPPED, ROBUST, "zero").errors[:20]
    assert_allclose(solved(scenarios.OVERLAPPED, "likelihood", 1.0, 20).result.errors, expected)
    for name in SOLVERS:
        found = solved(scenarios.OVERLAPPED, name, 0.0, 20).result
        assert np.hypot(*found.errors[:, :2].T).max() < 1.0, name


def test_annealed_share_follows_the_schedule() -> None:
    """Breaks if a scale is skipped, or the outlier component is widened unasked."""
    fixed, moving = same_draws(scenarios.CLUSTERS, 100)
    for scales in ((4.0, 2.0, 1.0), (8.0, 4.0, 2.0, 1.0)):
        found = scheduled(fixed, moving, ROBUST, np.zeros(3), scales)
        expected = at_truth(found.theta - scenarios.CLUSTERS.theta).mean()
        assert annealed_share(scenarios.CLUSTERS, scales, runs=100) == expected
    # the outlier component matters at all
    scales = (4.0, 2.0, 1.0)
    plain = annealed_share(scenarios.OVERLAPPED, scales, robust=False, runs=100)
    assert plain > 0.5 > annealed_share(scenarios.OVERLAPPED, scales, runs=100)
