"""Which targets are rejected: weights by what they are, and walkers in every direction."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_array_equal

from d2d.radar import inlier_probabilities
from d2d.study.drives.moving_targets import TargetWeights, rejected_walkers, walkers_by_pair


def test_weights_are_the_probabilities_of_all_targets_of_all_good_pairs(driven):
    """Breaks if targets and labels of different scans are put together."""
    drive, result = driven
    good = np.arange(60) != 3
    bad = replace(result, converged=good, reasons=np.where(good, "", "lost"))
    weights = TargetWeights.of(drive, bad)
    kept = [i for i in range(60) if i != 3]
    assert_array_equal(weights.kind, np.concatenate([drive.targets[i + 1].kind for i in kept]))
    direct = [
        inlier_probabilities(result.theta[i], *drive.scans[i : i + 2], drive.mounting) for i in kept
    ]
    assert_array_equal(weights.probability, np.concatenate(direct))
    still = ~np.isin(weights.kind, ("moving", "clutter"))
    moving = weights.kind == "moving"
    assert weights.rejected(moving) > weights.rejected(still) + 0.5
    assert np.isnan(weights.rejected(weights.kind == "nothing"))
    blind = TargetWeights.of(drive, bad, doppler=False)
    assert blind.rejected(moving) < weights.rejected(moving)


def test_walkers_are_told_by_their_doppler_velocity_alone(driven):
    """Breaks if along and across change places, or the displacement is applied to other targets."""
    drive, result = driven
    angles = np.array([0.0, np.pi, 0.5 * np.pi])
    away, towards, across = rejected_walkers(drive, result, 1.5, angles)
    assert min(away, towards) > 0.95
    assert across < 0.3
    pairs = walkers_by_pair(drive, result, 1.5, angles)
    assert len(pairs) == 6  # every tenth of 60
    assert sum(pair[2].sum() for pair in pairs) == round(across * sum(map(np.size, pairs)) / 3)
    blind = rejected_walkers(drive, result, 1.5, angles, doppler=False)
    assert blind.max() < 0.5
    assert rejected_walkers(drive, result, 0.0, angles[:1])[0] < 0.2
    racing = rejected_walkers(drive, result, 40.0, angles[2:], doppler=False)
    assert racing[0] > across + 0.3, "moved by four metres"
