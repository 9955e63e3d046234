"""The Monte Carlo that shows whether a shared azimuth error is treated as one."""

import numpy as np

from d2d.radar import Mounting
from d2d.study.drives.shared_azimuth import COVARIANCES, shared_azimuth


def test_only_the_shared_error_predicts_the_scatter_of_a_fast_car():
    """Breaks if the scene no longer shares the error, or the propagation loses its sign."""
    found = shared_azimuth(np.random.default_rng(1), np.array([12.0, 0.0, 0.8]), Mounting(3.6))
    assert 1.5 < found.weight < 1.9
    assert found.errors.shape == (1000, 3)
    inverse, apart, shared = (found.variance_ratios(name) for name in COVARIANCES)
    for ratios in (inverse, apart):
        assert ratios[0] < 0.65
        assert ratios[-1] > 1.35
    assert 0.8 < shared[0] <= shared[-1] < 1.25
    assert found.credibility(COVARIANCES[2]).nci < 0.4 < found.credibility(COVARIANCES[0]).nci
