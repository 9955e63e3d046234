"""A line for each way to track a drive, and evidence without a reference."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d.radar import Reference, Track
from d2d.study.guides.rows import halves, row, row_table, two_sensors
from d2d.study.guides.stated_sigmas import front_drive


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


def test_evidence_in_one_number_each():
    """Breaks if the page's numbers are not those of the package's functions."""
    drive = front_drive()
    view = drive.scans[:60], drive.mounting
    found = halves(view)
    assert list(found) == ["halves by target", "halves by object"]
    assert all(0.5 < each < 2.5 for each in found.values())
    parts = [([scan[start::2] for scan in drive.scans[:60]], view[1]) for start in (0, 1)]
    assert 0.5 < two_sensors(*parts) < 2.5
