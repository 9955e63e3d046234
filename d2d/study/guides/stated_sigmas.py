"""Estimates whose stated standard deviations are too small or too large."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from d2d.radar import Drive, RadarScan, Sensor, simulate_drive, track
from d2d.radar.simulation.drive import CAR_MOUNTING, CAR_SPEED
from d2d.study.guides.rows import Row, row

FACTORS = (0.25, 0.5, 1.0, 2.0, 4.0)
MEASURED = ("range", "azimuth", "doppler")
_IN_WORDS = {"doppler": "Doppler"}
_DURATION = 40.0  # s, a lap


@cache
def front_drive() -> Drive:
    """A lap of the car with a front radar that knows its errors exactly."""
    rng, sensor = np.random.default_rng(5), Sensor(quantised=False)
    return simulate_drive(rng, _DURATION, CAR_SPEED, mounting=CAR_MOUNTING, sensor=sensor)


@cache
def stated_sigmas() -> dict[str, list[Row]]:
    """Track the same drive with one of the three standard deviations multiplied by each factor.

    The limits of the vehicle are the default ones.  The errors themselves do not change.
    """
    drive = front_drive()
    right = track(drive)

    def tracked(name: str, factor: float) -> Row:
        scans = [scaled(scan, factor, (name,)) for scan in drive.scans]
        driven = right if factor == 1.0 else track((scans, drive.mounting))
        return row(f"{_IN_WORDS.get(name, name)} x {factor:g}", driven, drive.truth)

    return {name: [tracked(name, factor) for factor in FACTORS] for name in MEASURED}


def scaled(scan: RadarScan, factor: float, measured: Sequence[str] = MEASURED) -> RadarScan:
    """The scan with the standard deviations of what is ``measured`` multiplied by ``factor``."""
    names = (f"sigma_{name}" for name in measured)
    return replace(scan, **{name: factor * getattr(scan, name) for name in names})


def rounded(scans: Sequence[RadarScan], step: float, added: float = 0.0) -> list[RadarScan]:
    """Doppler velocities rounded to multiples of ``step``, and ``added`` to their sigmas."""
    return [
        replace(
            scan,
            doppler=np.round(scan.doppler / step) * step,
            sigma_doppler=np.hypot(scan.sigma_doppler, added),
        )
        for scan in scans
    ]
