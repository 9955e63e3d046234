"""What is checked of each scan as it arrives, and mended: its time, and targets given twice."""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from statistics import median
from typing import NamedTuple

import numpy as np

from d2d._types import Array
from d2d.radar.scans.scan import RadarScan
from d2d.radar.tracks.finding import Finding, warn_of
from d2d.radar.tracks.rounds import MAX_INTERVAL, REMEMBERED, SensorScans, repeats

_JUMP = 1.0  # s; a clock that steps back by less has scans in the wrong order, which is refused
_FEW = 6  # targets, of which some may be equal by chance where a radar rounds coarsely
_FRESH = 5.0  # cycles that a jump is taken to last
_ALIKE = 1.5  # cycles by which a clock is set beside those of other sensors at least


class _Held(NamedTuple):
    """Scans of a sensor that wait until it is known whether its clock has jumped."""

    scans: list[RadarScan]
    jump: float  # s, from the scan before them
    latest: dict[int, RadarScan]  # of each sensor when the first one came
    offsets: dict[int, float]  # s, of each sensor


class Intake:
    """Takes the scans of named sensors and gives them back as they are to be used.

    A scan that is more than a second, and five cycles, after the one before, or more than a second
    before it, waits for the next one.  If that agrees with it, the clock has jumped, or there was a
    gap; else it was one wrong stamp, and the scan is left out.  A clock that jumps while other
    sensors go on is set beside theirs, which is known only if the scans of all come ``live``, as
    they are measured: it then waits until one of them measures, too.  Else one that jumps back is
    set on, so that times go on increasing, and one that jumps ahead is left as it is.

    Where half of a scan's targets or more are there twice, one of each is dropped.  A sensor that
    freezes repeats its scan, which `Rounds` leaves out.  A warning names the sensor, once for each
    of these; of a gap, if it is longer than ``max_interval`` (s) or others go on meanwhile.
    """

    def __init__(self, names: Sequence[str], max_interval: float, live: bool = False) -> None:
        self._names, self._longest, self._live = names, max_interval, live
        self._latest: dict[int, RadarScan] = {}
        self._intervals = {s: deque[float](maxlen=REMEMBERED) for s in range(len(names))}
        self._held: dict[int, _Held] = {}
        self._awaited: set[int] = set()  # of these, whose next scan the others wait for
        self._offsets = dict.fromkeys(range(len(names)), 0.0)  # s, added to the times of a sensor
        self._told: set[tuple[str, str]] = set()

    def taken(self, sensor: int, scan: RadarScan) -> list[RadarScan]:
        """What is to be used after a sensor's next scan: this one, none, or also the one before.

        Raises a ValueError if it is not the next one.
        """
        used = []
        for each in self._timed(sensor, scan):
            self._look_for_repetition(sensor, each)
            self._latest[sensor] = each
            used.append(self._without_twins(sensor, each))
        return used

    def waits(self, span: float) -> bool:
        """Whether scans that cover this time in s are to wait for the next one of a sensor.

        They wait only once for a sensor that is silent.
        """
        self._awaited = {s for s in self._awaited & self._held.keys() if span <= self._gap(s)}
        return bool(self._awaited)

    def look_for_pause(self, sensor: int, times: Array, others: Array) -> None:
        """Say if a sensor pauses while others go on: by a gap, or a clock that jumps ahead."""
        cycle, longest = self._cycle(sensor), _FRESH * self._cycle(sensor)
        if self._offsets[sensor] != 0.0:
            longest = 1.001 * self._gap(sensor)  # left by a mended jump
        for i in np.flatnonzero(np.diff(times) > longest):
            start, end = times[i], times[i + 1]
            if ((others > start + cycle) & (others < end - cycle)).any():
                self._tell_gap(sensor, float(end - start), float(end))

    def leave_out(self, sensor: int, scan: RadarScan, last: float) -> None:
        """Say that a sensor's scan comes after the estimate at a later time."""
        name, late = self._names[sensor], last - scan.time
        self._tell(
            "old",
            Finding("the clock of a sensor is off", name, late, "s", False, "or it arrives late"),
            f"{name} has a scan at {scan.time:.3f} s that comes after the estimate at {last:.3f} s "
            "and is left out; do its scans arrive late?",
        )

    def _timed(self, sensor: int, scan: RadarScan) -> list[RadarScan]:
        """The scans of a sensor whose time is now known, with this time."""
        offset, intervals = self._offsets[sensor], self._intervals[sensor]
        time, others = scan.time + offset, self._time_of_others(sensor)
        latest = self._latest[sensor].time if sensor in self._latest else None
        held, known = self._held.get(sensor), [scan]
        twice = held is not None and held.scans[-1].time == scan.time
        if latest is not None and (twice or latest - _JUMP < time <= latest):
            raise ValueError(
                f"{self._names[sensor]} must be in strictly increasing time, but a scan is at "
                f"{scan.time:.6f} s after {scan.time if twice else latest - offset:.6f} s"
            )
        reach = self._gap(sensor) if intervals else math.inf  # while there is only one scan
        goes_on = latest is None or latest < time <= latest + reach
        if held is not None and (goes_on or scan.time < held.scans[-1].time):
            self._tell_stamp(sensor, held)
            held = None
        self._held.pop(sensor, None)
        if latest is not None and not goes_on:
            if held is None:
                held = _Held([scan], time - latest, {**self._latest}, {**self._offsets})
                self._held[sensor] = held
                self._awaited.add(sensor)
                return []
            held.scans.append(scan)
            if not self._is_known(sensor, held):
                self._held[sensor] = held
                return []
            self._mend(sensor, held, time)
            known = held.scans
            intervals.append(scan.time - known[-2].time)
        elif time <= others - _JUMP:
            self._tell_jump(sensor, time - others, scan.time, others)
            self._offsets[sensor] = self._known_offset(
                sensor, others - scan.time, self._gap(sensor)
            )
        elif latest is not None:
            if time - latest > self._longest:
                self._tell_gap(sensor, time - latest, scan.time)
            intervals.append(time - latest)
        offset = self._offsets[sensor]
        return known if offset == 0.0 else [replace(s, time=s.time + offset) for s in known]

    def _time_of_others(self, sensor: int) -> float:
        """When another sensor has last measured, in s; minus infinity if that is not known."""
        others = [scan.time for s, scan in self._latest.items() if s != sensor and self._live]
        return max(others, default=-math.inf)

    def _is_known(self, sensor: int, held: _Held) -> bool:
        """Whether other sensors have shown since, or will not show, if a sensor's clock jumped."""
        others = held.latest.keys() - {sensor}
        waited = held.scans[-1].time - held.scans[0].time
        alone = not others or not self._live or waited > self._gap(sensor)
        return alone or bool(self._measured_since(held) or others & self._held.keys())

    def _measured_since(self, held: _Held) -> list[int]:
        """The sensors that have measured since a scan was held, if that is known."""
        known = held.latest if self._live else {}
        return [s for s, scan in known.items() if self._latest[s].time > scan.time]

    def _mend(self, sensor: int, held: _Held, time: float) -> None:
        """Set a sensor's clock after a jump, which the held scan and one at this time show."""
        latest, gap, cycle = self._latest[sensor].time, self._gap(sensor), self._cycle(sensor)
        stamp, since = held.scans[0].time, self._measured_since(held)
        others = [s for s in since if self._offsets[s] == held.offsets[s]]  # that go on
        now = max((self._latest[s].time for s in others), default=time)
        passed = max((held.latest[s].time for s in others), default=latest) - latest
        if cycle:
            passed = cycle * max(1, round(passed / cycle))
        if abs(time - now) > gap and passed > 0.0:
            self._tell_jump(sensor, held.jump, stamp, now)
            slack = _ALIKE * cycle
        elif held.jump > 0.0:
            if held.jump > self._longest:
                self._tell_gap(sensor, held.jump, stamp)
            return
        else:  # how long it took is not known: no pair may reach over it
            self._tell_jump(sensor, held.jump, stamp)
            passed = slack = gap
        self._offsets[sensor] = self._known_offset(sensor, latest - stamp + passed, slack)

    def _cycle(self, sensor: int) -> float:
        """The usual time between two scans of a sensor, in s; zero while there is only one."""
        return median(self._intervals[sensor] or [0.0])

    def _gap(self, sensor: int) -> float:
        """A time in s over which no pair of scans reaches."""
        return max(_FRESH * self._cycle(sensor), _JUMP)

    def _known_offset(self, sensor: int, guess: float, slack: float) -> float:
        """What to add after a jump: what another sensor's clock has got, if it is near, in s."""
        others = [self._offsets[other] for other in self._offsets if other != sensor]
        return next((known for known in others if abs(known - guess) < slack), guess)

    def _tell_jump(
        self, sensor: int, jump: float, stamp: float, others: float | None = None
    ) -> None:
        name, offset = self._names[sensor], self._offsets[sensor]
        about = "back" if jump < 0.0 else "ahead of the other sensors"
        if others is not None:
            where = f"another sensor is at {others - offset:.3f} s"
        else:
            where = f"it was at {self._latest[sensor].time - offset:.3f} s"
        self._tell(
            f"jump {offset}",
            Finding("the clock jumps", name, jump, "s", False, about),
            f"the clock of {name} jumps by {jump:.3f} s to {stamp:.3f} s, where {where}; its times "
            "are taken as if it had gone on",
        )

    def _tell_gap(self, sensor: int, jump: float, stamp: float) -> None:
        name = self._names[sensor]
        self._tell(
            "ahead",
            Finding("the clock jumps", name, jump, "s", False, "or a gap"),
            f"{name} has a gap, or its clock jumps, by {jump:.3f} s at {stamp:.3f} s",
        )

    def _tell_stamp(self, sensor: int, held: _Held) -> None:
        name, what = self._names[sensor], "ahead" if held.jump > 0.0 else "back"
        stamp = held.scans[0].time
        self._tell(
            "stamp",
            Finding("the clock jumps", name, held.jump, "s", False, "for one scan"),
            f"{name} has one scan at {stamp:.3f} s, {abs(held.jump):.3f} s {what}, which is left "
            "out; is its time stamp wrong?",
        )

    def _look_for_repetition(self, sensor: int, scan: RadarScan) -> None:
        name, before = self._names[sensor], self._latest.get(sensor)
        if before is not None and repeats(before, scan):
            told = f"first at {scan.time:.3f} s"
            self._tell(
                "frozen",
                Finding("a scan is repeated", name, scan.time, "s", False, told),
                f"{name} repeats its scan at {scan.time:.3f} s target by target while it moves; "
                "such scans are left out",
            )

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


def mended(
    sensors: Mapping[str, SensorScans], max_interval: float = MAX_INTERVAL
) -> dict[str, SensorScans]:
    """The scans of whole logs as `Intake` gives them, and the mountings, by the sensors' names."""
    intake, found = Intake(list(sensors), max_interval), {}
    for number, (name, (scans, mounting)) in enumerate(sensors.items()):
        found[name] = [each for scan in scans for each in intake.taken(number, scan)], mounting
    times = [np.array([scan.time for scan in scans]) for scans, _ in found.values()]
    for number, own in enumerate(times):
        intake.look_for_pause(
            number, own, np.concatenate([*times[:number], *times[number + 1 :], []])
        )
    return found
