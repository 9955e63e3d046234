"""What the tests of the study share."""

import matplotlib.pyplot as plt
import pytest


@pytest.fixture(autouse=True)
def _closed():
    """Figures that a test leaves open are closed after it."""
    yield
    plt.close("all")
