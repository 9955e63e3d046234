"""The scans of one sensor or several in rounds, and the pairs of scans of each round."""

from bisect import bisect_left
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from typing import Any, Protocol

import numpy as np

from d2d._bounds import SECONDS
from d2d._checks import (
    check_count,
    check_members,
    check_positive_scalar,
)
from d2d._types import Array
from d2d.radar.motion.pairs import ScanPair
from d2d.radar.scans.scan import Mounting, RadarScan

# Times between two scans, and horizons, that are longer than this are taken to be in another unit.
MAX_INTERVAL = 60.0  # s

SensorScans = tuple[list[RadarScan], Mounting]


class _WithScans(Protocol):
    """A `Recording`, a simulated `Drive`, or what else has both."""

    @property
    def scans(self) -> Iterable[RadarScan]: ...

    @property
    def mounting(self) -> Mounting: ...


OneSensor = _WithScans | tuple[Iterable[RadarScan], Mounting]
Sensors = OneSensor | Iterable[OneSensor] | Mapping[Any, OneSensor]


def check_sensors(sensors: Sensors, max_interval: float = MAX_INTERVAL) -> list[SensorScans]:
    """The scans and the mounting of each sensor, checked, whichever way they are given."""
    named = {
        name: (check_members(name, scans, RadarScan), mounting)
        for name, (scans, mounting) in _named(sensors).items()
    }
    for name, (scans, _) in named.items():
        check_increasing(name, scans, max_interval)
    check_distinct({name: scans for name, (scans, _) in named.items()})
    return list(named.values())


def _named(sensors: Any) -> dict[str, tuple[Any, Mounting]]:
    """The scans and the mounting of each sensor, by the name of the scans in error messages."""
    alone = _parts(sensors)
    if alone is not None:
        return {"scans": alone}
    if isinstance(sensors, Mapping):
        given = dict(sensors)
    else:
        given = dict(enumerate(check_members("sensors", sensors, object)))
    named = {}
    for key, sensor in given.items():
        parts = _parts(sensor)
        if parts is None:
            raise ValueError(
                f"sensors[{key!r}] must be a Recording or a tuple (scans, Mounting), but is a "
                f"{type(sensor).__name__}"
            )
        named[f"sensors[{key!r}].scans"] = parts
    return named


def _parts(sensor: Any) -> tuple[Any, Mounting] | None:
    """The scans and the mounting of one sensor; None if it is something else."""
    if isinstance(sensor, tuple) and len(sensor) == 2:
        scans, mounting = sensor
    else:
        scans, mounting = getattr(sensor, "scans", None), getattr(sensor, "mounting", None)
    return (scans, mounting) if isinstance(mounting, Mounting) else None


def check_increasing(name: str, scans: Sequence[RadarScan], max_interval: float) -> None:
    """Raise a ValueError unless times increase strictly, by at most ``max_interval`` (s)."""
    times = np.array([scan.time for scan in scans])
    intervals = np.diff(times)
    if not (intervals > 0).all():
        late = int(np.argmin(intervals > 0)) + 1
        raise ValueError(
            f"{name} must be in strictly increasing time, but scan {late} is at "
            f"{times[late]:.6f} s after {times[late - 1]:.6f} s"
        )
    check_intervals(name, times, max_interval)


def check_intervals(name: str, times: Array, max_interval: float) -> None:
    """Raise a ValueError if times (n,) in s are farther apart than ``max_interval``."""
    longest = check_positive_scalar("max_interval", max_interval)
    intervals = np.diff(times)
    if (intervals > longest).any():
        far = int(np.argmax(intervals))
        raise ValueError(
            f"{name} must have times in seconds (s), at most max_interval = {longest:g} apart, but "
            f"{times[far + 1]:.6f} comes after {times[far]:.6f}; are these milli- or microseconds?"
        )


def check_distinct(sensors: Mapping[str, Iterable[RadarScan]]) -> None:
    """Raise a ValueError if two sensors have a scan in common: it would count twice."""
    owners: dict[tuple[object, ...], str] = {}
    for name, scans in sensors.items():
        for scan in scans:
            measured = (scan.range, scan.azimuth, scan.doppler)
            key = (scan.time, *(array.tobytes() for array in measured))
            owner = owners.setdefault(key, name)
            if owner != name and scan.size > 1:  # one target may be seen alike by chance
                raise ValueError(
                    f"{owner} and {name} must be different, but have the same scan at "
                    f"{scan.time:.6f} s; is one sensor given twice?"
                )


def check_separation(baseline: int, horizon: float | None) -> None:
    """Raise a ValueError unless one of the two says how far apart the scans of a pair are."""
    check_count("baseline", baseline)
    if horizon is None:
        return
    SECONDS._replace(above=0.0, most=MAX_INTERVAL).number("horizon", horizon)
    if baseline != 1:
        raise ValueError(
            f"horizon and baseline must not both be given, but are {horizon:g} s and {baseline}"
        )


def rounds(scans: Iterable[Sequence[RadarScan]]) -> list[list[tuple[int, int]]]:
    """Rounds of (sensor, scan) indices: all scans in time order, no sensor twice in a round.

    Scans of the same time are in the same round, so that the sensors' order does not count.
    """
    order = sorted((scan.time, s, i) for s, own in enumerate(scans) for i, scan in enumerate(own))
    groups: list[list[tuple[int, int]]] = []
    seen: set[int] = set()
    for _, entries in groupby(order, key=lambda entry: entry[0]):
        together = [(sensor, scan) for _, sensor, scan in entries]
        sensors = {sensor for sensor, _ in together}
        if not groups or sensors & seen:
            groups.append([])
            seen = set()
        groups[-1] += together
        seen |= sensors
    return groups


def round_pairs(
    sensors: Sequence[SensorScans],
    group: Iterable[tuple[int, int]],
    baseline: int = 1,
    horizon: float | None = None,
) -> list[ScanPair]:
    """Each scan of a round, paired with an earlier one of its sensor.

    A sensor's first scan and pairs with an empty scan are left out.
    """
    chosen = [
        ScanPair(scan_before(sensors[s][0], i, baseline, horizon), sensors[s][0][i], sensors[s][1])
        for s, i in group
        if i > 0
    ]
    return [pair for pair in chosen if pair.previous.size and pair.current.size]


def scan_before(
    scans: Sequence[RadarScan], i: int, baseline: int, horizon: float | None
) -> RadarScan:
    """The scan with which scan i > 0 is registered: ``baseline`` earlier, or ``horizon`` s earlier.

    The first scan if there are not that many.
    """
    if horizon is None:
        return scans[max(i - int(baseline), 0)]
    wanted = scans[i].time - horizon
    after = bisect_left(scans, wanted, hi=i, key=lambda scan: scan.time)
    near = [j for j in (after, after - 1) if 0 <= j < i]
    # rounding of times must not decide between two scans that are equally near
    return scans[min(near, key=lambda j: round(abs(scans[j].time - wanted), 6))]
