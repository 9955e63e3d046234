"""The trials of "Your own radar": what must show, and what undoes it."""

from __future__ import annotations

import math

import matplotlib.pyplot as plt
import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d.radar import Mounting, Reference, Track, track
from d2d.study.guides import hard_cases, symptoms
from d2d.study.guides.conventions import draw_conventions
from d2d.study.guides.rows import Row, halves, row, row_table, two_sensors
from d2d.study.guides.stated_sigmas import (
    FACTORS,
    draw_stated_sigmas,
    front_drive,
    rounded,
    scaled,
    stated_sigmas,
)


def test_a_row_has_the_errors_the_credibility_and_the_reason():
    """Breaks if a failed estimate counts as an error, or its reason is lost."""
    times = np.arange(1, 11) / 10.0
    theta = np.tile([5.0, 0.0, 0.1], (10, 1))
    good = times < 0.95
    covariance = np.where(good[:, None, None], 0.04 * np.eye(3), np.nan)
    reasons = np.where(good, "", "a side slip of -0.50 m/s")
    errors = 0.2 * np.random.default_rng(0).choice([-1.0, 1.0], (10, 3))
    driven = Track(times, np.full(10, 0.1), theta + errors, covariance, good, reasons)
    truth = Reference(times, theta, np.zeros((10, 3)))
    found = row("mine", driven, truth)
    assert found.accepted == 0.9
    assert_allclose(found.rmse, [0.2, 0.2, np.rad2deg(0.2)])
    assert found.anees == pytest.approx(1.0)
    assert found.reason == "a side slip of ... m/s"
    assert row_table([found]).rows == (("mine", "90.0%", "0.200", "0.200", "11.46", "1"),)


def test_a_track_that_failed_is_no_error():
    """Breaks if the table of symptoms ends where a fault is too large."""
    nothing = Track(
        np.arange(1.0, 6.0), np.ones(5), np.zeros((5, 3)), np.full((5, 3, 3), np.nan),
        np.zeros(5, dtype=bool), np.full(5, "no optimum near the start"),
    )  # fmt: skip
    found = row("none", nothing, front_drive().truth)
    assert found.accepted == 0.0
    assert math.isnan(found.anees)
    assert found.reason == "no optimum near the start"


def test_azimuth_and_doppler_decide_on_the_covariance():
    """Breaks if a wrong standard deviation changes something else than the page says."""
    found = stated_sigmas()
    at = {name: dict(zip(FACTORS, rows, strict=True)) for name, rows in found.items()}
    assert 0.8 < at["azimuth"][1.0].anees < 1.4
    assert at["azimuth"][0.5].anees > 2.0 * at["azimuth"][1.0].anees
    assert at["doppler"][0.5].anees > 1.6 * at["doppler"][1.0].anees
    assert at["range"][0.5].anees < 1.3 * at["range"][1.0].anees
    for name in at:
        for factor in (0.5, 2.0):
            assert at[name][factor].rmse[2] < 1.3 * at[name][1.0].rmse[2]
    _, axes = plt.subplots(1, 3)
    draw_stated_sigmas(axes, found)
    assert [len(ax.lines) for ax in axes] == [4, 4, 4]
    plt.close("all")


def test_scans_are_rounded_and_scaled():
    """Breaks if the steps, or what is told of them, are not those asked for."""
    scan = front_drive().scans[0]
    (coarse,) = rounded([scan], 0.5, 0.3)
    assert_allclose(coarse.doppler * 2.0, np.round(coarse.doppler * 2.0))
    assert np.abs(coarse.doppler - scan.doppler).max() <= 0.25
    assert_allclose(coarse.sigma_doppler**2, scan.sigma_doppler**2 + 0.09)
    half = scaled(scan, 0.5)
    assert_allclose(half.sigma_range, 0.5 * scan.sigma_range)
    assert_allclose(half.sigma_azimuth, 0.5 * scan.sigma_azimuth)
    assert_allclose(half.sigma_doppler, 0.5 * scan.sigma_doppler)
    assert_allclose(half.doppler, scan.doppler)


def by_name(rows: list[Row]) -> dict[str, Row]:
    return {each.name: each for each in rows}


def test_few_targets_need_to_know_the_vehicle():
    """Breaks if limits and side slip no longer help, or three radars are no better than one."""
    found = by_name(hard_cases.few_targets())
    assert found["one: as it is"].anees > 20.0
    assert found["one: no side slip, limits"].anees < 0.3 * found["one: no side slip"].anees
    assert found["one: no side slip, limits"].accepted > found["one: as it is"].accepted
    assert found["three: no side slip, limits"].anees < 1.5
    assert found["three: no side slip, limits"].accepted > 0.95


def test_a_side_radar_needs_to_know_that_the_car_does_not_slip():
    """Breaks if a small side slip no longer makes the yaw rate much more accurate."""
    found = by_name(hard_cases.side_radar())
    assert found["side slip of 0.05 m/s"].rmse[2] < 0.5 * found["as it is"].rmse[2]
    assert found["side slip of 0.05 m/s"].accepted > found["as it is"].accepted
    assert found["baseline 2"].rmse[2] > 0.5 * found["as it is"].rmse[2]


def test_a_standing_vehicle_is_estimated_as_any_other():
    """Breaks if a Doppler velocity of zero is an exception."""
    found = by_name(hard_cases.standing())
    for each in found.values():
        assert each.accepted == 1.0
        assert 0.7 < each.anees < 1.4
    assert found["baseline 3"].rmse[2] < 0.5 * found["as it is"].rmse[2]


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
    assert found["Doppler folded at 8 m/s"].forward < 0.9
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


@pytest.mark.parametrize("error", [0.0, 1.0])
def test_velocities_over_ground_and_folded_ones_are_undone(error):
    """Breaks if a cure needs more than a rough velocity, or does not cure."""
    drive = front_drive()
    scans, place, truth = drive.scans[:30], drive.mounting, drive.truth
    rough = truth.theta[:30] + np.array([error, 0.0, 0.0])
    folded, _ = symptoms.FAULTS["Doppler folded at 8 m/s"](scans, place, truth)
    back = symptoms.unfolded(folded, rough, place, limit=8.0)
    static = [np.abs(a.doppler - b.doppler) < 1e-9 for a, b in zip(back, scans, strict=True)]
    assert np.concatenate(static).mean() > 0.95
    if not error:
        cut = Reference(truth.times[:30], truth.theta[:30], truth.poses[:30])
        ground, _ = symptoms.FAULTS["Doppler over ground"](scans, place, cut)
        measured = symptoms.over_ground_undone(ground, rough, place)
        for one, other in zip(measured, scans, strict=True):
            assert_allclose(one.doppler, other.doppler, atol=1e-12)


def test_evidence_in_one_number_each():
    """Breaks if the page's numbers are not those of the package's functions."""
    drive = front_drive()
    view = drive.scans[:60], drive.mounting
    found = halves(view)
    assert list(found) == ["halves by target", "halves by object"]
    assert all(0.5 < each < 2.5 for each in found.values())
    parts = [([scan[start::2] for scan in drive.scans[:60]], view[1]) for start in (0, 1)]
    assert 0.5 < two_sensors(*parts) < 2.5


def test_the_picture_has_the_conventions():
    """Breaks if a name is missing from the picture, or drawn for another mounting."""
    _, ax = plt.subplots()
    draw_conventions(ax, Mounting(3.4, 0.8, 0.7))
    words = " ".join(text.get_text() for text in ax.texts)
    for word in ("x, forward", "y, left", "boresight", "azimuth > 0", "doppler > 0", "x = 3.4 m"):
        assert word in words
    plt.close("all")


def test_a_lap_with_true_sigmas_is_credible():
    """Breaks if the drive that everything is compared with is itself at fault."""
    drive = front_drive()
    found = row("right", track(drive), drive.truth)
    assert found.accepted > 0.97
    assert 0.8 < found.anees < 1.4
