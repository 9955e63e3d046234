"""What the tests of drives share."""

import numpy as np
import pytest

from d2d.radar import simulate_drive, track


@pytest.fixture(scope="package")
def driven():
    """A short simulated drive and its track."""
    drive = simulate_drive(np.random.default_rng(2), 6.0)
    return drive, track(drive)
