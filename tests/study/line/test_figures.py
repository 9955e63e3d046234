"""The panels of the scenes on a line."""

import matplotlib.pyplot as plt
import numpy as np
from numpy.testing import assert_array_equal

from d2d import RegistrationCost
from d2d.study.line import figures
from d2d.study.line.scene import CLUSTER_NAMES, SIGMA, cluster_positions, clustered


def test_true_and_observed_positions_are_below_the_curves_and_apart():
    """Breaks if marks change places, or lie on the axis or on each other."""
    true = cluster_positions(4.0 * SIGMA)
    fixed, _ = clustered(np.random.default_rng(1), 4.0 * SIGMA)
    _, ax = plt.subplots()
    figures.line_targets(ax, fixed, true, CLUSTER_NAMES)
    marks = [line for line in ax.lines if line.get_marker() == "o"]
    hollow, filled = (
        np.array([each.get_xydata()[0] for each in marks if (each.get_mfc() == "none") == empty])
        for empty in (True, False)
    )
    assert_array_equal(hollow[:, 0], true)
    assert_array_equal(filled[:, 0], fixed.means[:, 0])
    bottom, top = ax.get_ylim()
    assert bottom < filled[:, 1].max() < hollow[:, 1].min() < 0.0
    assert min(ax.get_yticks()) == 0.0
    assert max(line.get_ydata().max() for line in ax.lines) < top


def test_letters_give_way_where_there_is_no_room():
    """Breaks if crowded letters are printed over each other, or none where they fit."""
    _, axes = plt.subplots(2, 3, figsize=(4.85, 4.8))
    for ax, spacing, letters in zip(axes[0], (1.0, 4.0), (set(CLUSTER_NAMES), set()), strict=False):
        sets = clustered(np.random.default_rng(1), spacing * SIGMA)
        grid = np.arange(-1.0, 5.0, 0.01)
        figures.every_target(ax, grid, RegistrationCost(), sets, CLUSTER_NAMES)
        assert {letter for text in ax.texts for letter in text.get_text()} == letters
