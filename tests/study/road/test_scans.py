"""The summary of scans that cannot be shown."""

import numpy as np

from d2d.radar import RadarScan
from d2d.study.road.scan_profile import EDGES, scan_profile


def scan(time, distance, azimuth, doppler) -> RadarScan:
    return RadarScan(time, distance, azimuth, doppler, 0.1, 0.01, 0.1)


def test_a_profile_counts_each_target_in_its_bin():
    """Breaks if scans are weighted wrongly, or azimuths are counted in radians."""
    scans = [
        scan(0.0, [5.0, 15.0, 15.0], np.deg2rad([-40.0, 20.0, 20.0]), [-12.0, -12.0, 3.0]),
        scan(0.1, [5.0], np.deg2rad([20.0]), [3.0]),
    ]
    profile = scan_profile(scans)
    assert (profile["scans"], profile["targets"]) == (2, 2.0)
    assert profile["range (m)"][:3] == [1.0, 1.0, 0.0]
    of_azimuth = dict(zip(EDGES["azimuth (°)"], profile["azimuth (°)"], strict=False))
    assert (of_azimuth[-45.0], of_azimuth[15.0]) == (0.5, 1.5)
    assert sum(profile["Doppler velocity (m/s)"]) == 2.0
