"""Drives that are hard: few targets, one radar to the side, a vehicle that stands."""

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from d2d.radar import Drive, Mounting, Sensor, build_world, simulate_drive, track
from d2d.radar.simulation.drive import CAR_MOUNTING, CAR_SPEED
from d2d.study.guides.rows import Row, row

RATE = 13.0  # Hz
FEW = 6  # targets that a scan keeps
SIDE = Mounting(3.4, 0.8, float(np.deg2rad(90.0)))
CORNERS = (
    Mounting(3.4, 0.8, float(np.deg2rad(45.0))),
    Mounting(3.4, -0.8, float(np.deg2rad(-45.0))),
)

Ways = Mapping[str, dict[str, Any]]
FEW_WAYS: Ways = {"as it is": {}, "no side slip": {"side_slip": False}}
SIDE_WAYS: Ways = {
    "as it is": {},
    "side slip of 0.05 m/s": {"side_slip": 0.05},
    "no side slip": {"side_slip": False},
    "baseline 1": {"baseline": 1},
}
STANDING_WAYS: Ways = {"baseline 1": {"baseline": 1}, "as it is": {}}


@cache
def few_targets() -> list[Row]:
    """One radar that reports six targets per scan, and three of them together."""
    sensor = Sensor(rate=RATE, max_targets=FEW, clutter=0.5, quantised=False)
    world = build_world(np.random.default_rng(5))
    drives = [
        _drive(6 + number, mounting, sensor, world=world)
        for number, mounting in enumerate((CAR_MOUNTING, *CORNERS))
    ]
    sensors, truth = [(drive.scans, drive.mounting) for drive in drives], drives[0].truth
    together = [
        row(f"three: {way}", track(sensors, **options), truth) for way, options in FEW_WAYS.items()
    ]
    return [*_rows(drives[0], FEW_WAYS, "one: "), *together]


@cache
def side_radar() -> list[Row]:
    """A single radar that looks to the left, with 16 targets per scan."""
    sensor = Sensor(rate=RATE, max_targets=16, quantised=False)
    return _rows(_drive(5, SIDE, sensor), SIDE_WAYS)


@cache
def standing() -> list[Row]:
    """The car stands for ten seconds."""
    sensor = Sensor(rate=RATE, quantised=False)
    return _rows(_drive(1, CAR_MOUNTING, sensor, 10.0, 1e-6), STANDING_WAYS)


def _drive(
    seed: int,
    mounting: Mounting,
    sensor: Sensor,
    duration: float = 40.0,
    speed: float = CAR_SPEED,
    **options: Any,
) -> Drive:
    rng = np.random.default_rng(seed)
    return simulate_drive(rng, duration, speed, mounting=mounting, sensor=sensor, **options)


def _rows(drive: Drive, ways: Ways, prefix: str = "") -> list[Row]:
    return [
        row(prefix + way, track(drive, **options), drive.truth) for way, options in ways.items()
    ]
