"""The log of a made-up car with three radars, and what is wrong with them."""

import os
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from d2d.radar import Drive, Mounting, Reference, Sensor, SensorErrors, build_world, simulate_drive
from d2d.radar.simulation.drive import CAR_SPEED

SEED = 4
DURATION = 40.0  # s, a lap around the block
RATE = 13.0  # Hz
DOPPLER_STEP = 0.1  # m/s, to which the log's Doppler velocities are rounded
ODOMETRY_LAG = 0.12  # s by which the radars' time stamps are late
ODOMETRY_FACTOR = 1.02  # of the true speed over the odometry's

# The true ones; the engineer measured the places and assumed the angles, see `STATED`.
TRUE = {
    "front": Mounting(3.7, 0.0, float(np.deg2rad(0.4))),
    "left": Mounting(3.4, 0.8, float(np.deg2rad(46.2))),
    "right": Mounting(3.4, -0.8, float(np.deg2rad(-45.3))),
}
STATED = {
    "front": Mounting(3.7, 0.0, 0.0),
    "left": Mounting(3.4, 0.8, float(np.deg2rad(45.0))),
    "right": Mounting(3.4, -0.8, float(np.deg2rad(-45.0))),
}
_SENSOR = Sensor(rate=RATE, quantised=False)
_ERRORS = SensorErrors(extent=0.2, neighbours=1.0)


class OwnDrive(NamedTuple):
    """Facts about the drive that its log does not hold."""

    truth: Reference  # at the times of the front radar's scans
    odometry: Reference  # speed and yaw rate as the car's bus reports them, on a clock of its own


@lru_cache(maxsize=1)
def _simulated() -> dict[str, Drive]:
    rng = np.random.default_rng(SEED)
    world = build_world(rng)
    return {
        name: simulate_drive(
            rng, DURATION, CAR_SPEED, mounting=mounting, sensor=_SENSOR, world=world, errors=_ERRORS
        )
        for name, mounting in TRUE.items()
    }


def write_log(path: str | os.PathLike[str]) -> OwnDrive:
    """Write the log as a CSV file, with its columns in another order and azimuths in degrees.

    The file has no standard deviations, and Doppler velocities rounded to `DOPPLER_STEP`.
    """
    lines = []
    for name, drive in _simulated().items():
        for scan in drive.scans:
            doppler = np.round(scan.doppler / DOPPLER_STEP) * DOPPLER_STEP
            degrees = np.rad2deg(scan.azimuth)
            for target in zip(doppler, scan.range, degrees, strict=True):
                lines.append((scan.time, name, *target))
    text = ["sensor,doppler,range,azimuth,time"]
    for time, name, doppler, distance, azimuth in sorted(lines):
        text.append(f"{name},{doppler:.2f},{distance:.3f},{azimuth:.3f},{time:.6f}")
    Path(path).write_text("\n".join(text) + "\n", encoding="utf-8")
    truth = _simulated()["front"].truth
    theta = truth.theta * [1.0 / ODOMETRY_FACTOR, 0.0, 1.0]
    return OwnDrive(truth, Reference(truth.times - ODOMETRY_LAG, theta, truth.poses))
