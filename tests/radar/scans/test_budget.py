"""The numbers of an error budget."""

import numpy as np
import pytest

from d2d.radar import ErrorBudget


def test_a_budget_of_no_standard_deviation_is_refused():
    """Breaks if a budget makes covariances nan or smaller."""
    for name in ("azimuth", "doppler", "scale", "lag", "neighbours", "v_x", "v_y", "omega"):
        for value in (-0.1, np.nan, np.inf, 1e150, "a", [0.1, 0.2]):
            with pytest.raises(ValueError, match=f"^{name} must"):
                ErrorBudget(**{name: value})
