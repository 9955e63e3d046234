"""Mistakes with a log, put in by hand, that the page must call what the command line calls them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from d2d.radar import Mounting, simulate_drive
from tests.book.logs import Case, Sensors, several
from tests.radar.scenes import CORNER, accelerating
from tests.radar.trust import test_findings as known

SPACED = {"words": ("--horizon", "0.3"), "settings": {"horizon": 0.3}}
# Faults that the beginning of the log does not show.
WHOLE = ("a gap", "the clock jumps", "one time stamp for each target", "a mounting is turned")


def changed(sensors: Sensors, name: str, **factors: float) -> Sensors:
    """The log with some columns of a sensor multiplied."""
    scans, at = sensors[name]
    wrong = [
        replace(scan, **{key: factor * getattr(scan, key) for key, factor in factors.items()})
        for scan in scans
    ]
    return {**sensors, name: (wrong, at)}


def alone(**factors: float) -> Sensors:
    """One sensor with some columns multiplied."""
    drive = simulate_drive(np.random.default_rng(1), duration=8.0, mounting=Mounting(0.4))
    return changed({"radar": (drive.scans, drive.mounting)}, "radar", **factors)


def at(sensors: Sensors, **places: Mounting) -> Sensors:
    return {name: (scans, places.get(name, own)) for name, (scans, own) in sensors.items()}


def begun(sensors: Sensors, scans: int = 16) -> Sensors:
    return {name: (own[:scans], mounting) for name, (own, mounting) in sensors.items()}


def ahead() -> Sensors:
    """One of two clocks jumps ahead, while the other sensor goes on."""
    sensors = several(10.0)
    scans, mounting = sensors["aside"]
    late = [replace(scan, time=scan.time + 2.0) for scan in scans[40:]]
    return {**sensors, "aside": ([*scans[:40], *late], mounting)}


def to_the_side() -> Sensors:
    """A single radar far ahead of the axle that looks aside."""
    corner = Mounting(3.6, 0.4, 1.5)
    return {"left": (simulate_drive(np.random.default_rng(2), 12.0, mounting=corner).scans, corner)}


def rare() -> Sensors:
    """Scans of a vehicle that accelerates, one a second: positions show its mean velocity."""
    harder = np.array([2.0, 0.0, 0.0])
    (sensor,), _ = accelerating([1.0], [0.0], harder, [CORNER], noise=1.0, end=6.0)
    return {"front": sensor}


CORRECT: dict[str, Callable[[], Sensors]] = {"none": alone, "two": lambda: several(10.0)}
# Told by a second search, because hardly an estimate is accepted.
HARDLY_ANY: dict[str, Callable[[], Sensors]] = {
    "milliseconds": lambda: known.alone(lambda s: replace(s, time=1e-3 * s.time)),
    "km/h": lambda: known.alone(lambda s: replace(s, doppler=3.6 * s.doppler)),
    "opposite sign": lambda: begun(known.changed(lambda s: replace(s, doppler=-s.doppler))),
}
FAULTS: dict[str, Callable[[], Sensors]] = {
    **HARDLY_ANY,
    "rare scans": rare,
    "at rest": lambda: alone(doppler=0.01),
    "turned": lambda: at(alone(), radar=Mounting(0.4, 0.0, 0.1)),
    "backwards": lambda: at(alone(), radar=Mounting(0.4, 0.0, np.pi)),
    "to the side": to_the_side,
    "one turned of two": lambda: at(several(10.0), aside=Mounting(-0.3, 0.4, 1.6)),
    "clockwise": lambda: changed(several(10.0), "aside", azimuth=-1.0),
    "late": lambda: several(30.0, 0.4),
    "ahead": ahead,
}
CASES: dict[str, Callable[[], Case]] = {
    **{name: lambda of=of: Case(of()) for name, of in (CORRECT | FAULTS).items()},
    **{
        name: lambda of=of, name=name: Case(of() if name in WHOLE else begun(of()), **SPACED)
        for name, (of, _) in known.FAULTS.items()
    },
}
