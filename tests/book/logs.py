"""Logs for the command line and for the page, and a comparison of the files that both write."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from d2d.radar import Mounting, RadarScan, Track, simulate_drive

COLUMNS = ("range", "azimuth", "doppler", "sigma_range", "sigma_azimuth", "sigma_doppler")
SHARED = {"azimuth": 0.1, "doppler": 0.04, "scale": 0.002, "lag": 0.02, "neighbours": 1.0}
AHEAD, ASIDE = Mounting(0.4, 0.1, 0.1), Mounting(-0.3, 0.4, 1.5)
EXACT = 1e-6

Sensors = dict[str, tuple[Sequence[RadarScan], Mounting]]


class Case(NamedTuple):
    """A log, and the options of both programs: ``words`` of one, ``settings`` of the other."""

    sensors: Sensors
    words: Sequence[str] = ()
    settings: dict[str, Any] = {}  # noqa: RUF012 - nothing changes it

    @property
    def places(self) -> dict[str, list[float]]:
        """The mountings in m, m, degrees."""
        return {
            name: [at.x, at.y, float(np.rad2deg(at.yaw))] for name, (_, at) in self.sensors.items()
        }

    @property
    def text(self) -> str:
        """The log, each sensor's scans in the order given: `write_csv` would sort them."""
        lines = [",".join(["sensor", "time", *COLUMNS])]
        for sensor, (scans, _) in self.sensors.items():
            for scan in scans:
                columns = [getattr(scan, name).tolist() for name in COLUMNS]
                rows = zip(*columns, strict=True)
                lines += [",".join([sensor, repr(scan.time), *map(repr, row)]) for row in rows]
        return "\n".join(lines)


def several(duration: float = 20.0, shift: float = 0.03) -> Sensors:
    """Two sensors of different rates on one vehicle, which do not run in step."""
    ahead = simulate_drive(np.random.default_rng(0), duration, mounting=AHEAD)
    aside = simulate_drive(np.random.default_rng(0), duration, mounting=ASIDE, world=ahead.world)
    late = [replace(scan, time=scan.time + shift) for scan in aside.scans]
    return {
        "ahead": (ahead.scans, AHEAD),
        "aside": ([scan for i, scan in enumerate(late) if i % 3], ASIDE),
    }


def assert_same_files(expected: Path, found: Path) -> None:
    """Two tracks, PREFIX.tum and PREFIX_velocities.txt of each, are the same number by number.

    Velocities to 1e-6 m/s and rad/s, covariances and their parts to 1e-6 of the sigmas.
    """
    paths = [np.loadtxt(prefix.with_name(f"{prefix.name}.tum")) for prefix in (expected, found)]
    np.testing.assert_allclose(*paths, atol=EXACT)
    tables = [prefix.with_name(f"{prefix.name}_velocities.txt") for prefix in (expected, found)]
    heads = [
        [line for line in table.read_text().splitlines() if line.startswith("#")]
        for table in tables
    ]
    assert heads[0] == heads[1]
    one, other = map(Track.read_velocities, tables)
    np.testing.assert_array_equal(one.times, other.times)
    np.testing.assert_array_equal(one.intervals, other.intervals)
    np.testing.assert_array_equal(one.converged, other.converged)
    np.testing.assert_allclose(one.theta, other.theta, atol=EXACT)
    assert one.parts is not None
    assert other.parts is not None
    sigmas = np.sqrt(np.diagonal(one.covariance, axis1=1, axis2=2))
    scale = sigmas[:, :, None] * sigmas[:, None, :]
    for own, known in zip(
        (other.covariance, *other.parts), (one.covariance, *one.parts), strict=True
    ):
        np.testing.assert_allclose(own / scale, known / scale, atol=EXACT)
