"""Extended objects: what their scatter does, and what the extent mends."""

from functools import cache

import numpy as np
from numpy.testing import assert_allclose

from d2d.radar import estimate_extent
from d2d.study.drives import extended
from d2d.study.drives.extended import (
    COVARIANCES,
    MODELS,
    MOUNTING,
    ExtendedStudy,
    extended_drive,
    extended_study,
)

NONE, LIKELIEST, TRUE = MODELS
INVERSE, PROPAGATED = COVARIANCES


@cache
def study(half_width: float, redrawn: bool = True) -> ExtendedStudy:
    rng = np.random.default_rng(2)
    return extended_study(rng, half_width, redrawn=redrawn)


def test_of_single_targets_the_scatter_is_found_of_several_less(monkeypatch):
    """Breaks if the estimate has another bias than its documentation says."""
    found = study(1.0).estimate
    monkeypatch.setattr(extended, "MOST", 1)
    single = estimate_extent(extended_drive(np.random.default_rng(4), 1.0), MOUNTING)
    scatter = 1.0 / np.sqrt(3.0)
    assert_allclose(single.extent, scatter, rtol=0.1)
    assert 0.4 < found.extent / scatter < 0.75
    assert found.sigma < 0.02
