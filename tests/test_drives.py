"""How a drive is judged: errors, what is left out, units."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d import credibility
from d2d.radar import Reference, Track
from d2d.study.drives import DriveErrors

N = 50


def example(seed: int = 0) -> tuple[Track, Reference]:
    """A track with Gaussian errors of its covariances, and the truth at the times of all scans."""
    rng = np.random.default_rng(seed)
    times = np.arange(N + 1) / 10.0
    truth = rng.uniform([5.0, -0.5, -0.3], [15.0, 0.5, 0.3], (N + 1, 3))
    root = rng.standard_normal((N, 3, 4)) * np.array([0.1, 0.2, 0.02])[:, None]
    covariance = root @ np.swapaxes(root, -1, -2)
    errors = np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), rng.standard_normal((N, 3)))
    converged = np.ones(N, dtype=bool)
    return (
        Track(times[1:], np.diff(times), truth[1:] + errors, covariance, converged),
        Reference(times, truth, np.zeros((N + 1, 3))),
    )


def test_errors_are_estimate_minus_reference_at_the_later_scan():
    """Breaks if the sign or the pairing of n pairs with n + 1 scans is off."""
    driven, reference = example()
    judged = DriveErrors.of(driven, reference)
    for i in (0, 17, N - 1):
        assert_array_equal(judged.errors[i], driven.theta[i] - reference.theta[i + 1])
    assert_array_equal(judged.times, driven.times)
    assert_array_equal(judged.covariances, driven.covariance)
    assert judged.share == 1.0


def test_rmse_and_sigmas_are_in_metres_and_degrees():
    """Breaks if omega stays in radians, or a variance is reported for a standard deviation."""
    driven, reference = example()
    judged = DriveErrors.of(driven, reference)
    e = driven.theta - reference.theta[1:]
    for i, unit in enumerate((1.0, 1.0, 180.0 / np.pi)):
        assert judged.rmse[i] == pytest.approx(unit * np.sqrt((e[:, i] ** 2).sum() / N))
        assert_allclose(judged.sigmas[:, i], unit * np.sqrt(driven.covariance[:, i, i]))


def test_pairs_that_did_not_converge_or_have_no_reference_are_left_out():
    """Breaks if a prediction is judged as an estimate, or nan spreads over the drive."""
    driven, reference = example()
    driven.converged[4] = False
    driven.theta[4] = 1e6
    driven.covariance[4] = np.nan
    reference.theta[11, 1] = np.nan  # of pair 10
    reference.theta[0] = np.nan  # of no pair
    judged = DriveErrors.of(driven, reference)
    left = np.delete(np.arange(N), [4, 10])
    assert_array_equal(judged.times, driven.times[left])
    assert_array_equal(judged.errors, (driven.theta - reference.theta[1:])[left])
    assert judged.share == pytest.approx(48 / 50)
    assert np.isfinite(judged.rmse).all()
    assert judged.rmse[0] < 10.0


def test_errors_given_directly_are_judged_alike():
    """Breaks if a results file is judged by another rule than a fresh track."""
    driven, reference = example()
    of = DriveErrors.of(driven, reference)
    given = DriveErrors.from_errors(driven, driven.theta - reference.theta[1:])
    assert_array_equal(of.errors, given.errors)
    assert of.share == given.share


def test_credibility_is_that_of_the_errors_in_si_units():
    """Breaks if degrees are judged with a covariance in radians."""
    driven, reference = example(seed=1)
    judged = DriveErrors.of(driven, reference)
    direct = credibility(driven.theta - reference.theta[1:], driven.covariance)
    assert judged.credibility.anees == direct.anees
    assert judged.credibility.consistent


def test_summary_says_what_was_measured():
    """Breaks if a number is printed in another place or unit than it says."""
    driven, reference = example()
    driven.converged[:5] = False
    judged = DriveErrors.of(driven, reference)
    text = judged.summary()
    for part in (
        f"v_x {judged.rmse[0]:.3f} m/s",
        f"v_y {judged.rmse[1]:.3f} m/s",
        f"omega {judged.rmse[2]:.3f} deg/s",
        "usable 90.0%",
        f"ANEES {judged.credibility.anees:.2f} [",
        f"I2 {judged.credibility.inclination:+.1f} dB",
    ):
        assert part in text
    assert "\n" not in text
