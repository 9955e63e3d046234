"""What the tests of the study share."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from d2d import PointSet
from d2d.study.plane.scenarios import OVERLAPPED


@pytest.fixture(autouse=True)
def _closed():
    """Figures that a test leaves open are closed after it."""
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def sets() -> tuple[PointSet, PointSet]:
    """One draw of the overlapped scene."""
    fixed, moving = OVERLAPPED.sample(1, np.random.default_rng(3))
    return fixed[0], moving[0]
