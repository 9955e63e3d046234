"""Who pulls the velocity of blurred positions: points of the street, or places of the sensor."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from d2d.radar import RadarScan, Recording, Reference, estimate_ego_motion
from d2d.study.drives.extended import MOUNTING, THETA, extended_drive
from d2d.study.recordings.blur import _static, errors_with_extent, pulls


def recording(scans: list[RadarScan]) -> Recording:
    times = np.array([scan.time for scan in scans])
    theta = np.tile(THETA, (len(times), 1))
    return Recording(scans, MOUNTING, Reference(times, theta, np.zeros_like(theta)))


def street(count: int = 60) -> Recording:
    return recording(extended_drive(np.random.default_rng(0), 0.3, redrawn=False, count=count))


def sliding(share: float) -> Recording:
    """A street on which some targets stay where they are for the sensor, but look static."""
    still, scans = street().scans, []
    for scan in still:
        first = still[0][: int(share * still[0].size)]
        joined = {
            name: np.concatenate([getattr(scan, name), getattr(first, name)])
            for name in vars(scan)
            if name != "time"
        }
        scans.append(RadarScan(scan.time, **joined))
    return recording(scans)


def test_errors_are_those_of_the_estimates_with_that_extent():
    """Breaks if only one of the scans is widened, or the reference is that of another pair."""
    drive = street(12)
    found = errors_with_extent(drive, 0.4, doppler=True, every=5)
    assert found.shape == (3, 3)
    pair = (scan.with_extent(0.4) for scan in drive.scans[5:7])
    estimate = estimate_ego_motion(*pair, MOUNTING, initial=THETA)
    assert_allclose(found[1], estimate.theta - THETA, atol=1e-9)
    assert np.abs(errors_with_extent(drive, 0.0, doppler=False)[:, 0]).max() < 1.0


def test_targets_that_slide_along_pull_towards_standing():
    """Breaks if the sign is lost, or a street whose points stay where they are pulls as well."""
    at_rest, slides = (pulls(drive, 0.5, every=2) for drive in (street(), sliding(0.3)))
    error = at_rest.std() / np.sqrt(len(at_rest))
    assert abs(at_rest.mean()) < 3.0 * error + 0.1
    assert slides.mean() < -1.0


def test_scans_far_apart_show_what_stays_for_the_sensor():
    """Breaks if the other scan is not taken at the previous one's time, or is the previous one."""
    first, last = (
        pulls(sliding(0.3), 0.5, apart=40, every=2),
        pulls(street(), 0.5, apart=40, every=2),
    )
    assert len(first) == len(last) == 10
    assert first.mean() < last.mean() - 1.0


def test_only_static_targets_count():
    """Breaks if the Doppler velocity is compared without the sensor's place, or its sign."""
    scan = street(2).scans[0]
    faster = scan.doppler.copy()
    faster[:5] += 3.0
    sigmas = scan.sigma_range, scan.sigma_azimuth, scan.sigma_doppler
    moving = RadarScan(scan.time, scan.range, scan.azimuth, faster, *sigmas)
    assert _static(scan, THETA, MOUNTING).size > 0.98 * scan.size
    assert _static(moving, THETA, MOUNTING).size == _static(scan[5:], THETA, MOUNTING).size
