"""Doppler velocities as measured, out of those that a sensor has changed."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from d2d._types import Array
from d2d.radar.scans.scan import Mounting, RadarScan, doppler_velocity


def over_ground_undone(
    scans: Sequence[RadarScan], theta: Array, mounting: Mounting
) -> list[RadarScan]:
    """Scans as measured, of a sensor that compensated its motion by velocities (n, 3) ``theta``."""
    return [
        replace(scan, doppler=scan.doppler + doppler_velocity(velocity, scan.azimuth, mounting))
        for scan, velocity in zip(scans, theta, strict=True)
    ]


def unfolded(
    scans: Sequence[RadarScan], theta: Array, mounting: Mounting, limit: float
) -> list[RadarScan]:
    """Unfold Doppler velocities from +-``limit`` (m/s), to the values nearest to static targets'.

    Velocities (n, 3) of the vehicle need not be exact: to within ``limit`` is enough.
    """
    cured = []
    for scan, velocity in zip(scans, theta, strict=True):
        gap = doppler_velocity(velocity, scan.azimuth, mounting) - scan.doppler
        turns = np.round(gap / (2.0 * limit))
        cured.append(replace(scan, doppler=scan.doppler + 2.0 * limit * turns))
    return cured
