"""Drives that are hard: few targets, one radar to the side, a vehicle that stands."""

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from d2d.radar import Drive, Mounting, Sensor, VehicleLimits, build_world, simulate_drive, track
from d2d.radar.simulation.drive import CAR_MOUNTING, CAR_SPEED
from d2d.study.guides.rows import Row, row

RATE = 13.0  # Hz
FEW = 6  # targets that a scan keeps
SIDE = Mounting(3.4, 0.8, float(np.deg2rad(90.0)))
CORNERS = (
    Mounting(3.4, 0.8, float(np.deg2rad(45.0))),
    Mounting(3.4, -0.8, float(np.deg2rad(-45.0))),
)
CAR_LIMITS = VehicleLimits(acceleration=8.0)  # of a car in town

Ways = Mapping[str, Mapping[str, Any]]
FEW_WAYS: Ways = {
    "as it is": {},
    "limits of this car": {"limits": CAR_LIMITS},
    "no side slip": {"side_slip": False},
    "no side slip, limits": {"side_slip": False, "limits": CAR_LIMITS},
}
SIDE_WAYS: Ways = {
    "as it is": {},
    "side slip of 0.05 m/s": {"side_slip": 0.05},
    "no side slip": {"side_slip": False},
    "baseline 2": {"baseline": 2},
}
STANDING_WAYS: Ways = {"as it is": {}, "baseline 3": {"baseline": 3}}


@cache
def few_targets() -> list[Row]:
    """One radar that reports six targets per scan, and three of them together."""
    world = build_world(np.random.default_rng(5))
    places = (CAR_MOUNTING, *CORNERS)
    sensor = Sensor(rate=RATE, max_targets=FEW, clutter=0.5, quantised=False)
    drives = [
        simulate_drive(
            np.random.default_rng(6 + number),
            40.0,
            CAR_SPEED,
            mounting=place,
            sensor=sensor,
            world=world,
        )
        for number, place in enumerate(places)
    ]
    sensors = [(drive.scans, drive.mounting) for drive in drives]
    truth = drives[0].truth
    return [
        *(row(f"one: {way}", track(sensors[0], **o), truth) for way, o in FEW_WAYS.items()),
        *(
            row(f"three: {way}", track(sensors, **FEW_WAYS[way]), truth)
            for way in ("as it is", "no side slip, limits")
        ),
    ]


def _tried(drive: Drive, ways: Ways) -> list[Row]:
    return [row(way, track(drive, **options), drive.truth) for way, options in ways.items()]


@cache
def side_radar() -> list[Row]:
    """A single radar that looks to the left, with 16 targets per scan."""
    sensor = Sensor(rate=RATE, max_targets=16, quantised=False)
    rng = np.random.default_rng(5)
    return _tried(simulate_drive(rng, 40.0, CAR_SPEED, mounting=SIDE, sensor=sensor), SIDE_WAYS)


@cache
def standing() -> list[Row]:
    """The car stands for ten seconds."""
    rng, sensor = np.random.default_rng(1), Sensor(rate=RATE, quantised=False)
    return _tried(
        simulate_drive(rng, 10.0, 1e-6, mounting=CAR_MOUNTING, sensor=sensor), STANDING_WAYS
    )
