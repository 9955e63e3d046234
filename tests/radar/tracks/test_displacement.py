"""Displacements: exact for a steady motion, and as certain as they say."""

import numpy as np
import pytest

from d2d import rigid
from d2d.radar import Track
from d2d.radar.scans.budget import CovarianceParts
from d2d.radar.tracks.track import integrate

STEP, COUNT = 0.1, 400
TIMES = STEP * np.arange(1, COUNT + 1)
NOISE = np.diag([0.05, 0.08, 0.01]) ** 2
STAYS = 15.0  # s, as long as the errors of v_x do on RadarScenes
SLOW = np.array([[9e-4, 0.0, 0.0], [0.0, 4e-4, 3e-5], [0.0, 3e-5, 9e-6]])


def driven(theta, converged=None, parts=True):
    """A track of these velocities (COUNT, 3)."""
    good = np.ones(COUNT, dtype=bool) if converged is None else converged
    noise, none, slow = (
        np.where(good[:, None, None], each, np.nan) for each in (NOISE, 0.0 * NOISE, SLOW)
    )
    return Track(
        TIMES,
        np.full(COUNT, STEP),
        theta,
        noise + slow,
        good,
        parts=CovarianceParts(noise, none, slow) if parts else None,
    )


def test_a_steady_turn_is_exact():
    """Breaks if the frame is not that at the start, or parts of an interval are lost."""
    theta = np.tile([8.0, 0.3, 0.2], (COUNT, 1))
    start, end = np.array([0.0, 3.14, 11.0]), np.array([0.05, 9.9, 31.7])
    found = driven(theta).displacement(start, end)
    expected = rigid.exponential((end - start)[:, None] * theta[:3])
    found.motion[:, 2] = np.remainder(found.motion[:, 2], 2 * np.pi)
    expected[:, 2] = np.remainder(expected[:, 2], 2 * np.pi)
    np.testing.assert_allclose(found.motion, expected, atol=1e-9)


def test_a_slow_radar_has_displacements():
    """Breaks if each interval of a radar of 1 Hz is a gap, or a gap of three of them is none."""
    times = 1.1 * np.arange(1, 11)
    good = np.ones(10, dtype=bool)
    good[5:8] = False
    own = np.where(good[:, None, None], NOISE, np.nan)
    track = Track(times, np.full(10, 1.1), np.tile([5.0, 0.0, 0.0], (10, 1)), own, good)
    found = track.displacement([0.0, 1.1, 5.0], [3.3, 5.5, 10.0]).motion[:, 0]
    np.testing.assert_allclose(found, [16.5, 22.0, np.nan])


def test_it_is_what_the_poses_say():
    rng = np.random.default_rng(0)
    theta = np.array([5.0, 0.0, 0.1]) + 0.2 * rng.standard_normal((COUNT, 3))
    track = driven(theta)
    poses = integrate(theta, track.intervals)
    expected = rigid.compose(rigid.inverse(poses[20]), poses[200])
    found = track.displacement([TIMES[19]], [TIMES[199]])
    np.testing.assert_allclose(found.motion[0], expected, atol=1e-9)


@pytest.mark.parametrize("seconds", [1.0, 5.0, 20.0])
def test_the_errors_are_as_large_as_stated(seconds):
    """Breaks if noise adds up like slow errors, or slow errors average out like noise."""
    rng = np.random.default_rng(1)
    true = np.tile([6.0, 0.0, 0.15], (COUNT, 1))
    kept = np.exp(-STEP / STAYS)
    values, vectors = np.linalg.eigh(SLOW)
    root, nees = vectors * np.sqrt(values) @ vectors.T, []
    for _ in range(150):
        errors, slow = np.empty((COUNT, 3)), rng.standard_normal(3)
        for i in range(COUNT):
            errors[i] = root @ slow
            slow = kept * slow + np.sqrt(1.0 - kept**2) * rng.standard_normal(3)
        errors += rng.standard_normal((COUNT, 3)) * np.sqrt(np.diag(NOISE))
        found = driven(true + errors).displacement([5.0], [5.0 + seconds])
        error = found.motion[0] - rigid.exponential(seconds * true[0])
        nees.append(error @ np.linalg.solve(found.covariance[0], error))
    assert 2.4 < np.mean(nees) < 3.6  # 3, known to 0.2


def test_slow_errors_grow_like_an_integrated_process_of_15_s():
    """Breaks if they are taken to last for much longer or shorter than errors on the road."""
    times = np.array([1.0, 5.0, 15.0, 35.0])
    sigma = np.sqrt(
        driven(np.tile([6.0, 0.0, 0.0], (COUNT, 1)))
        .displacement(np.full(4, 1.0), 1.0 + times)
        .covariance[:, 0, 0]
    )
    ratio = times / STAYS
    slow = SLOW[0, 0] * 2.0 * STAYS**2 * (ratio - 1.0 + np.exp(-ratio))
    expected = np.sqrt(slow + NOISE[0, 0] * STEP * times)
    np.testing.assert_allclose(sigma, expected, rtol=0.03)


def test_without_parts_all_errors_average_out():
    alone = driven(np.tile([6.0, 0.0, 0.0], (COUNT, 1)), parts=False)
    sigma = np.sqrt(alone.displacement([1.0, 1.0], [2.0, 5.0]).covariance[:, 0, 0])
    assert sigma[1] / sigma[0] == pytest.approx(2.0, rel=0.01)


def test_nothing_is_known_outside_the_track_and_in_a_gap():
    good = np.ones(COUNT, dtype=bool)
    good[100:104] = False  # short: the motion goes on
    good[200:215] = False
    track = driven(np.tile([6.0, 0.0, 0.0], (COUNT, 1)), good)
    found = track.displacement([-1.0, 9.0, 15.0, 39.0], [1.0, 12.0, 25.0, 41.0])
    np.testing.assert_array_equal(np.isfinite(found.motion[:, 0]), [False, True, False, False])
    np.testing.assert_array_equal(
        np.isfinite(found.covariance[:, 0, 0]), [False, True, False, False]
    )
    assert track.displacement([], []).motion.shape == (0, 3)


@pytest.mark.parametrize(
    ("start", "end", "said"),
    [
        ([1.0], [1.0], "end must be after start"),
        ([1.0, 2.0], [3.0], "end must have the shape"),
        (1.0, 2.0, "start must have the shape"),
    ],
)
def test_wrong_times_are_refused(start, end, said):
    with pytest.raises(ValueError, match=said):
        driven(np.zeros((COUNT, 3))).displacement(start, end)
