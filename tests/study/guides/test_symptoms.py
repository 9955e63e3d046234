"""What each fault of a log or a mounting looks like, and what undoes it."""

import numpy as np
from numpy.testing import assert_allclose

from d2d.radar import Reference
from d2d.study.guides import symptoms
from d2d.study.guides.stated_sigmas import front_drive


def test_velocities_over_ground_and_folded_ones_are_undone():
    """Breaks if a cure needs more than a rough velocity, or does not cure."""
    drive = front_drive()
    scans, place, truth = drive.scans[:30], drive.mounting, drive.truth
    folded, _ = symptoms.FAULTS["Doppler folded at 8 m/s"](scans, place, truth)
    rough = truth.theta[:30] + np.array([1.0, 0.0, 0.0])
    back = symptoms.unfolded(folded, rough, place, limit=8.0)
    static = [np.abs(a.doppler - b.doppler) < 1e-9 for a, b in zip(back, scans, strict=True)]
    assert np.concatenate(static).mean() > 0.95
    cut = Reference(truth.times[:30], truth.theta[:30], truth.poses[:30])
    ground, _ = symptoms.FAULTS["Doppler over ground"](scans, place, cut)
    measured = symptoms.over_ground_undone(ground, cut.theta, place)
    for one, other in zip(measured, scans, strict=True):
        assert_allclose(one.doppler, other.doppler, atol=1e-12)
