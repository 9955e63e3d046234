"""Drives are found in folders of data sets, evaluated in a row each, and followed."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import cumulative_trapezoid

from d2d.radar import (
    Reference,
    Track,
)
from d2d.study.road.displacements import (
    LENGTH,
    by_its_velocities,
    drift,
    span_errors,
)
from d2d.study.road.drive import find_drives, pick


def root(folder, *sequences: int):
    """A folder with the layout of RadarScenes, without its data."""
    for number in sequences:
        (folder / "data" / f"sequence_{number}").mkdir(parents=True)
    return folder


# ---- Where drives are


def test_finds_each_drive_once_and_in_order(tmp_path):
    """Breaks if a second folder's excerpt of the same sequence counts as another drive."""
    whole, excerpt = root(tmp_path / "a", 9, 108), root(tmp_path / "b", 9, 10)
    found = find_drives([whole, excerpt])["RadarScenes"]
    assert [(each.root, each.name) for each in found] == [
        *((whole, name) for name in ("9", "108")),
        (excerpt, "10"),
    ]
    assert pick(found, ["10", "9"]) == {"10": found[2], "9": found[0]}
    with pytest.raises(ValueError, match="109"):
        pick(found, ["9", "109"])
    with pytest.raises(ValueError, match="holds no drive"):
        find_drives([whole, tmp_path])


# ---- Displacements


def exact(motion, seconds: float) -> tuple[Track, Reference]:
    """A track of exact velocities at 10 Hz, and the reference, whose path is summed finely."""
    fine = np.arange(0.0, seconds, 1e-4)
    theta = motion(fine)
    yaw = cumulative_trapezoid(theta[:, 2], fine, initial=0.0)
    velocity = theta[:, 0] * np.exp(1j * yaw)
    path = cumulative_trapezoid(velocity, fine, initial=0.0)
    known = slice(None, None, 200)
    poses = np.column_stack([path.real, path.imag, yaw])[known]
    times = np.arange(0.1, seconds, 0.1)
    unit, good = np.tile(np.eye(3), (len(times), 1, 1)), np.ones(len(times), bool)
    driven = Track(times, np.full(len(times), 0.1), motion(times), 1e-4 * unit, good)
    return driven, Reference(fine[known], theta[known], poses)


def bends(times):
    """A car that brakes and turns to both sides."""
    forward, turning = 12.0 + 3.0 * np.sin(1.3 * times), 0.25 * np.sin(1.7 * times)
    return np.column_stack([forward, np.zeros_like(times), turning])


def straight(times):
    return np.tile([10.0, 0.0, 0.0], (len(times), 1))


@pytest.mark.parametrize("motion", [straight, bends])
def test_exact_velocities_do_not_drift(motion):
    """Breaks if estimates and reference are integrated by rules that differ, or by a wrong one."""
    driven, reference = exact(motion, 40.0)
    assert np.abs(drift(driven, reference)).max() < 0.05
    for truth in (reference, by_its_velocities(reference)):
        errors, covariances = span_errors(driven, truth, 5.0)
        assert len(errors) == len(covariances) == 14
        assert np.abs(errors).max() < 0.03
    own = by_its_velocities(reference).at(reference.times[:-1]).poses
    assert_allclose(own, reference.poses[:-1], atol=0.02)  # after 480 m


def test_errors_of_a_wrong_yaw_rate_and_of_a_wrong_speed():
    """On a straight road a yaw rate off by w turns by w s and moves the end by w s L / 2."""
    driven, reference = exact(straight, 40.0)
    seconds, off = LENGTH / 10.0, np.array([0.0, 0.0, 1e-4])
    turned = drift(replace(driven, theta=driven.theta + off), reference)
    # a stretch ends at an estimate, up to a metre later
    assert_allclose(turned[:, 1], 1e-4 * seconds, rtol=0.011)
    assert_allclose(turned[:, 0], 1e-4 * seconds * LENGTH / 2.0, rtol=0.022)
    slow = drift(replace(driven, theta=0.99 * driven.theta), reference)
    assert_allclose(slow[:, 0], 0.01 * LENGTH, rtol=0.011)
    errors, _ = span_errors(replace(driven, theta=driven.theta + 10.0 * off), reference, 1.0)
    assert_allclose(errors[:, 2], 1e-3, atol=2e-6)
