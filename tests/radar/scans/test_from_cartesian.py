"""Scans from positions and velocity vectors, checked against polar ones and against draws."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d.radar import Mounting, RadarScan, quantisation_sigma
from tests.radar.scans.test_scan import random_scan

X, Y = np.array([10.0, -4.0, 0.0]), np.array([3.0, 20.0, -7.0])
RANGE, AZIMUTH = np.hypot(X, Y), np.arctan2(Y, X)
ERRORS = {"sigma_range": 0.1, "sigma_azimuth": 0.01, "sigma_doppler": 0.05}
DOPPLER = np.array([-5.0, 1.0, 0.0])


def test_a_scan_goes_to_positions_and_back():
    """Breaks if x and y change places, or sigmas are changed by the way."""
    scan = random_scan()
    x, y = scan.range * np.cos(scan.azimuth), scan.range * np.sin(scan.azimuth)
    sigmas = {name: getattr(scan, name) for name in ERRORS}
    back = RadarScan.from_cartesian(scan.time, x, y, doppler=scan.doppler, **sigmas)
    assert back.time == scan.time
    for name in ("range", "azimuth", "doppler", *ERRORS):
        assert_allclose(getattr(back, name), getattr(scan, name), rtol=1e-12, err_msg=name)


@pytest.mark.parametrize("reported", ["whole", "along x", "noise across"])
def test_a_velocity_is_projected_onto_the_line_of_sight(reported):
    """Breaks if the speed or v_x is taken instead."""
    sight = np.stack([np.cos(AZIMUTH), np.sin(AZIMUTH)], axis=-1)
    across = np.stack([-sight[:, 1], sight[:, 0]], axis=-1)
    velocity = DOPPLER[:, None] * sight
    if reported == "along x":
        velocity[:2] = np.column_stack([DOPPLER[:2] / sight[:2, 0], [0.0, 0.0]])
    elif reported == "noise across":
        velocity += np.array([[3.0], [-7.0], [9.0]]) * across
    scan = RadarScan.from_cartesian(0.0, X, Y, velocity=velocity, **ERRORS)
    assert_allclose(scan.doppler, DOPPLER, atol=1e-12)


def test_a_covariance_is_projected_along_and_across():
    """Breaks if the axes are mixed up: against the scatter of 200 000 draws."""
    rng = np.random.default_rng(0)
    root = rng.normal(0.0, 0.05, (3, 2, 2))
    covariance = root @ root.swapaxes(-1, -2) + 1e-4 * np.eye(2)
    scan = RadarScan.from_cartesian(
        0.0, X, Y, doppler=DOPPLER, covariance=covariance, sigma_doppler=0.1
    )
    for k in range(3):
        draws = rng.multivariate_normal([X[k], Y[k]], covariance[k], 200_000)
        angle = np.arctan2(draws[:, 1], draws[:, 0])
        turned = (angle - AZIMUTH[k] + np.pi) % (2 * np.pi) - np.pi
        assert np.hypot(*draws.T).std() == pytest.approx(scan.sigma_range[k], rel=0.01)
        assert turned.std() == pytest.approx(scan.sigma_azimuth[k], rel=0.01)
    same = RadarScan.from_cartesian(
        0.0, X, Y, doppler=DOPPLER, covariance=covariance[1], sigma_doppler=0.1
    )
    assert same.sigma_range[1] == scan.sigma_range[1]


def test_a_covariance_along_and_across_comes_back_as_it_was():
    """Breaks if the projection is not the inverse of what a point set is made of."""
    scan = random_scan()
    placed = scan.point_set(Mounting())
    x, y = placed.means.T
    again = RadarScan.from_cartesian(
        scan.time, x, y, doppler=scan.doppler, covariance=placed.covariances, sigma_doppler=1.0
    )
    assert_allclose(again.point_set(Mounting()).covariances, placed.covariances, rtol=1e-9)


def test_errors_add_up():
    """Breaks if one source replaces another, or standard deviations are added instead."""
    covariance = 0.04 * np.eye(2)
    scan = RadarScan.from_cartesian(
        0.0, X, Y, doppler=DOPPLER, covariance=covariance, grid=0.6, step=0.5, **ERRORS
    )
    assert_allclose(scan.sigma_range**2, 0.1**2 + 0.04 + 0.03)
    assert_allclose(scan.sigma_azimuth**2, 0.01**2 + 0.07 / RANGE**2)
    assert_allclose(scan.sigma_doppler**2, 0.05**2 + 0.25 / 12)


def test_quantisation_sigma_is_that_of_rounding():
    """Breaks if the error is thought to reach a whole step."""
    values = np.random.default_rng(1).uniform(-50.0, 50.0, 100_000)
    rounded = 0.2 * np.round(values / 0.2)
    assert (rounded - values).std() == pytest.approx(quantisation_sigma(0.2), rel=0.01)


def test_no_targets_make_an_empty_scan():
    """Breaks if an empty list of objects ends a drive."""
    scan = RadarScan.from_cartesian(1.0, [], [], velocity=np.zeros((0, 2)), grid=0.2, step=0.25)
    assert len(scan) == scan.size == 0


def test_length_and_repr():
    """Breaks if the arrays fill the screen, or a scan cannot be counted."""
    scan = random_scan(5)
    assert len(scan) == 5
    assert len(scan[1:3]) == 2
    assert repr(scan) == "RadarScan(time=1.500000 s, 5 targets)"


def test_what_is_not_finite_or_out_of_shape_is_refused_by_name():
    """Breaks if NumPy's words get through."""
    good = {"x": X, "y": Y, "doppler": DOPPLER, **ERRORS}
    cases = [
        ({"x": X[:2]}, "x and y must have the same shape"),
        ({"x": 1.0, "y": 2.0}, "x and y must have the same shape"),
        ({"x": [0.0, 1.0, 2.0], "y": [0.0, 1.0, 2.0]}, "x and y must not both be zero"),
        ({"y": [np.nan, 1.0, 2.0]}, "y must be finite"),
        ({"doppler": DOPPLER[:2]}, "doppler must have the shape"),
        ({"doppler": None}, "either doppler or velocity"),
        ({"velocity": np.zeros((3, 2))}, "either doppler or velocity"),
        ({"doppler": None, "velocity": np.zeros(3)}, "velocity must have the shape"),
        ({"covariance": np.ones((3, 2))}, "covariance must have the shape"),
        ({"covariance": np.tile(np.eye(2), (4, 1, 1))}, "covariance must have the shape"),
        ({"covariance": -np.eye(2)}, "covariance must be positive definite"),
        ({"grid": 0.0}, "grid must be positive"),
        ({"step": [0.1]}, "step must be a number"),
        ({"sigma_range": -0.1}, "sigma_range must not be negative"),
        ({"sigma_azimuth": np.ones(4)}, "sigma_azimuth must have the shape"),
        ({"sigma_range": 0.0}, "sigma_range must be positive"),
        ({"sigma_doppler": 0.0}, "sigma_doppler must be positive"),
    ]
    for change, says in cases:
        with pytest.raises(ValueError, match=says):
            RadarScan.from_cartesian(0.0, **(good | change))
    with pytest.raises(ValueError, match="step must be positive"):
        quantisation_sigma(-1.0)


def test_the_arguments_stay_as_they_were():
    """Breaks if an array of the caller is changed or shared."""
    x, doppler = X.copy(), DOPPLER.copy()
    scan = RadarScan.from_cartesian(0.0, x, Y, doppler=doppler, **ERRORS)
    x[0] = doppler[0] = 99.0
    assert_array_equal(scan.doppler, DOPPLER)
