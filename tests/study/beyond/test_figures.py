"""The figures of the exhaustive evaluation."""

import matplotlib.pyplot as plt
import numpy as np
from numpy.testing import assert_allclose

from d2d.study.beyond import exhaustive, figures
from d2d.study.beyond.exhaustive import Trial


def test_cross_range_sigma_is_that_of_a_target_at_mean_range() -> None:
    assert_allclose(figures.cross_range_sigma(Trial("f", "robust", noise=2.0)), 1.41)


def test_start_map_averages_the_directions() -> None:
    """Breaks if rows and columns are exchanged, or a direction is lost."""
    rows = exhaustive.read_table()
    _, ax = plt.subplots()
    figures.start_map(ax, rows, "robust", "1", "robust")
    image = ax.images[0].get_array()
    distance, turn = exhaustive.DISTANCES[2], exhaustive.TURNS[1]
    wanted = {"cost": "robust", "scales": "1", "distance_m": distance, "turn_deg": turn}
    chosen = exhaustive.select(rows, "start", **wanted)
    assert len(chosen) == 4
    assert_allclose(image[1, 2], np.mean([o.at_truth / o.runs for _, o in chosen]))
