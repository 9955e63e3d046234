"""What each fault of a log or a mounting looks like, and what undoes it."""

import numpy as np
from numpy.testing import assert_allclose

from d2d.radar import Reference
from d2d.study.guides import symptoms
from d2d.study.guides.stated_sigmas import front_drive


def test_each_fault_shows_as_the_page_says():
    """Breaks if a symptom no longer leads to its cause."""
    found = {each.fault: each for each in symptoms.symptoms()}
    right = found["nothing"]
    assert (round(right.forward, 1), round(right.turning, 1)) == (1.0, 1.0)
    assert right.message == ""
    flipped = found["Doppler sign flipped"]
    assert round(flipped.forward, 1) == -1.0
    assert "contradict" in flipped.message
    assert round(found["azimuth sign flipped"].turning, 1) == -1.0
    assert round(found["mounted backwards"].forward, 1) == -1.0
    assert abs(found["Doppler over ground"].forward) < 0.1
    assert found["Doppler folded at 8 m/s"].accepted < 0.6, "rejected, because speeds jump"
    for name in ("mounting 5 deg off", "mounting place left out"):
        assert found[name].accepted < 0.9, "rejected, because they look like side slip"
        assert found[name].reason == "a side slip of ... m/s"
    assert found["sigmas 5 x too small"].anees > 10.0
    assert found["sigmas 5 x too large"].accepted < 0.1
    assert found["azimuths in degrees"].message.endswith("are these degrees?")
    assert found["times in microseconds"].message.endswith("microseconds?")
    shown = symptoms.symptom_table(list(found.values()))
    assert [line[0] for line in shown.rows] == list(symptoms.FAULTS)
    assert shown.rows[-1][-1] == "error: milli- or microseconds?"


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
