"""What is checked of each scan as it arrives, and mended: its time, and targets given twice."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from d2d.radar.scans.scan import RadarScan
from d2d.radar.tracks.finding import Finding, warn_of
from d2d.radar.tracks.rounds import repeats

_JUMP = 1.0  # s; a clock that steps back by less has scans in the wrong order, which is refused
_FEW = 6  # targets, of which some may be equal by chance where a radar rounds coarsely
_FRESH = 5.0  # cycles that a jump is taken to last


class Intake:
    """Takes the scans of named sensors and gives them back as they are to be used.

    A clock that jumps back is set on, so that times go on increasing; one that jumps ahead by more
    than ``max_interval`` (s) is left as it is.  Where half of a scan's targets or more are there
    twice, one of each is dropped.  A sensor that freezes repeats its scan, which `Rounds` leaves
    out.  A warning names the sensor, once for each of these.
    """

    def __init__(self, names: Sequence[str], max_interval: float) -> None:
        self._names = names
        self._longest = max_interval
        self._latest: dict[int, float] = {}
        self._intervals: dict[int, float] = {}
        self._offsets = dict.fromkeys(range(len(names)), 0.0)  # s, added to the times of a sensor
        self._scans: dict[int, RadarScan] = {}  # the latest of each sensor
        self._told: set[tuple[str, str]] = set()

    def taken(self, sensor: int, scan: RadarScan, after: float = -math.inf) -> RadarScan:
        """A sensor's next scan, to be used; raises a ValueError if it is not the next one.

        A scan long before ``after`` (s), when other sensors have measured, shows a jump too.
        """
        name, offset = self._names[sensor], self._offsets[sensor]
        time, latest = scan.time + offset, self._latest.get(sensor)
        if latest is not None and latest - _JUMP < time <= latest:
            raise ValueError(
                f"{name} must be in strictly increasing time, but a scan is at "
                f"{scan.time:.6f} s after {latest - offset:.6f} s"
            )
        own = latest is not None and time <= latest
        before = latest if latest is not None and own else after
        if time <= before - _JUMP:
            whose = "it was" if own else "another sensor is"
            self._tell(
                f"jump {offset}",
                Finding("the clock jumps", name, time - before, "s", False, "back"),
                f"the clock of {name} jumps by {time - before:.3f} s to {scan.time:.3f} s, where "
                f"{whose} at {before - offset:.3f} s; its times are taken as if it had gone on "
                "after a gap",
            )
            offset = self._offset_after(sensor, before - scan.time, own)
            self._offsets[sensor] = offset
            time = scan.time + offset
        elif latest is not None and time - latest > self._longest:
            self._tell(
                "ahead",
                Finding("the clock jumps", name, time - latest, "s", False, "or a gap"),
                f"{name} has a gap, or its clock jumps, by {time - latest:.3f} s at "
                f"{scan.time:.3f} s",
            )
        if latest is not None:
            self._intervals[sensor] = time - latest
        self._latest[sensor] = time
        self._look_for_repetition(sensor, scan)
        scan = scan if offset == 0.0 else replace(scan, time=time)
        return self._without_twins(sensor, scan)

    def leave_out(self, sensor: int, scan: RadarScan, last: float) -> None:
        """Say that a sensor's scan comes after the estimate at a later time."""
        name, late = self._names[sensor], last - scan.time
        self._tell(
            "old",
            Finding("the clock of a sensor is off", name, late, "s", False, "or it arrives late"),
            f"{name} has a scan at {scan.time:.3f} s that comes after the estimate at {last:.3f} s "
            "and is left out; do its scans arrive late?",
        )

    def _offset_after(self, sensor: int, back: float, own: bool) -> float:
        """What to add after a jump: what another sensor's clock has just got, if it fits.

        How long a clock's own jump took is not known: no pair may reach over it, so it becomes a
        gap.
        """
        gap = max(_FRESH * self._intervals.get(sensor, 0.0), _JUMP)
        others = [self._offsets[other] for other in self._offsets if other != sensor]
        alike = (known for known in others if 0.0 < known - back < 2.0 * gap)
        return next(alike, back + gap if own else back)

    def _look_for_repetition(self, sensor: int, scan: RadarScan) -> None:
        name, before = self._names[sensor], self._scans.get(sensor)
        if before is not None and repeats(before, scan):
            told = f"first at {scan.time:.3f} s"
            self._tell(
                "frozen",
                Finding("a scan is repeated", name, scan.time, "s", False, told),
                f"{name} repeats its scan at {scan.time:.3f} s target by target while it moves; "
                "such scans are left out",
            )
        self._scans[sensor] = scan

    def _without_twins(self, sensor: int, scan: RadarScan) -> RadarScan:
        if scan.size < _FEW:
            return scan
        measured = np.column_stack([scan.range, scan.azimuth, scan.doppler])
        order = np.lexsort(measured.T)
        same = (measured[order[1:]] == measured[order[:-1]]).all(axis=1)
        if 2 * int(same.sum()) < scan.size - 1:
            return scan
        name, share = self._names[sensor], float(same.sum()) / scan.size
        self._tell(
            "twins",
            Finding("targets are given twice", name, share, "share", False, "one is used"),
            f"{name} has targets twice in the same scan, as at {scan.time:.3f} s; "
            "one of each is used",
        )
        kept = np.ones(scan.size, dtype=np.bool_)
        kept[order[1:][same]] = False
        return scan[kept]

    def _tell(self, what: str, finding: Finding, text: str) -> None:
        if (what, finding.sensor) not in self._told:
            self._told.add((what, finding.sensor))
            warn_of(finding, text)
