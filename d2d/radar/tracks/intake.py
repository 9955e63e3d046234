"""Select the scans that are used: each once, each target once, at its sensor's own time."""

import math
import sys
import warnings
from collections.abc import Mapping, Sequence

import numpy as np

from d2d.radar.scans.scan import MEASURED, RadarScan
from d2d.radar.tracks.rounds import Round, Rounds, SensorScans, same_targets

_STEP = 1.0  # s; a scan that is less before another one is in the wrong order, which is refused
_CYCLES = 5.0  # of a sensor that pauses before a scan is out of step: some scans may be lost
_WAITED = 1.5  # cycles after which a sensor would have been heard, as for a round
_FEW = 6  # targets, of which some may be equal by chance where a radar rounds coarsely
_MOVING = 0.5  # m/s; at a standstill a coarse radar may measure the same twice


class ScanWarning(UserWarning):
    """Says which scans or targets of a log are left out, or that its clock steps back."""


class ScanGate:
    """Takes the scans of sensors as they arrive, and gives rounds those to be used.

    A scan is out of step if it is more than a second before the last one of its sensor, or a second
    and five cycles after all of them.  It is held back until the next scans tell.  If any of them
    is in step, or its sensor comes back to the last one, the stamp was wrong, and the scan is left
    out.  If its sensor goes on from there while no other one is in step, its clock has been set, or
    all of them paused: then a new segment begins with all scans that were held back.  A warning
    names the sensor, once for each reason.
    """

    def __init__(self, names: Sequence[str], rounds: Rounds) -> None:
        self._names, self._rounds = names, rounds
        self._arrived: dict[int, RadarScan] = {}  # the last of each sensor
        self._latest: dict[int, RadarScan] = {}  # the last of each that is used, in this segment
        self._held: dict[int, list[RadarScan]] = {}
        self._told: set[tuple[str, int]] = set()
        rounds.late = self._leave_out_late

    def push(self, sensor: int, scan: RadarScan) -> tuple[list[RadarScan], list[Round]]:
        """The scans used now, mostly this one, seldom none or those held back, and rounds ended.

        Raises a ValueError if the scan is not later than the one before of its sensor.
        """
        before, latest = self._arrived.get(sensor), self._latest.get(sensor)
        scan = self._without_twins(sensor, scan)
        if before is not None and _repeats(before, scan):
            self._warn("repeated", sensor, f"repeats its scan at {scan.time:.3f} s; such scans are")
            return [], []
        last = max((each.time for each in self._latest.values()), default=scan.time)
        later = latest is None or scan.time > latest.time
        known = {s: h.cycle for s, h in enumerate(self._rounds.histories) if h.cycle < math.inf}
        reach = max(_STEP, _CYCLES * max(known.values(), default=math.inf))
        in_step = later and scan.time <= last + reach
        back = before is not None and scan.time <= before.time
        if before is not None and back and not in_step and scan.time > before.time - _STEP:
            raise ValueError(
                f"{self._names[sensor]} must be in strictly increasing time, but a scan is at "
                f"{scan.time:.6f} s after {before.time:.6f} s"
            )
        self._arrived[sensor] = scan
        if in_step:
            self._leave_out(*self._held)
            return self._use([(sensor, scan)])
        if back or (before is not None and abs(scan.time - last) < scan.time - before.time):
            self._leave_out(sensor)
        self._held.setdefault(sensor, []).append(scan)
        others = max((cycle for s, cycle in known.items() if s != sensor), default=0.0)
        start = self._held[sensor][0].time
        if scan.time - start <= _WAITED * others:
            return [], []
        held = [(s, each) for s, scans in self._held.items() for each in scans]
        self._held, ended = {}, []
        if start <= last:
            self._latest, ended = {}, self._rounds.step_back()
            self._say(
                f"the clock of {self._names[sensor]} steps back from {last:.3f} s to {start:.3f} s:"
                " a new segment begins there"
            )
        used, after = self._use(held)
        return used, ended + after

    def finish(self) -> list[Round]:
        """The last round; scans that are still held back are left out."""
        self._leave_out(*self._held)
        return self._rounds.finish()

    def _use(self, used: list[tuple[int, RadarScan]]) -> tuple[list[RadarScan], list[Round]]:
        self._latest |= used
        return [scan for _, scan in used], self._rounds.take(used)

    def _leave_out_late(self, sensor: int, scan: RadarScan, last: float) -> None:
        """Say that a scan comes after an estimate at a later time."""
        text = f"has a scan at {scan.time:.3f} s that comes after the estimate at {last:.3f} s and"
        self._warn("late", sensor, f"{text} is", "do its scans arrive late?")

    def _leave_out(self, *sensors: int) -> None:
        """Leave out the scans of sensors that are held back, if there are any."""
        for sensor in {*sensors} & self._held.keys():
            text = f"has a scan at {self._held.pop(sensor)[0].time:.3f} s, out of step, which is"
            self._warn("stamp", sensor, text, "is its time stamp wrong?")

    def _without_twins(self, sensor: int, scan: RadarScan) -> RadarScan:
        """The scan with one of each two equal targets, if half of them are there twice."""
        # most scans: more than half of their ranges differ
        steps = np.diff(np.sort(scan.range))
        if scan.size < _FEW or 2 * np.count_nonzero(steps) >= scan.size:
            return scan
        measured = np.column_stack([getattr(scan, name) for name in MEASURED])
        first = np.unique(measured, axis=0, return_index=True)[1]
        if 2 * (scan.size - len(first)) < scan.size - 1:
            return scan
        self._warn("twins", sensor, f"has targets twice, as at {scan.time:.3f} s; one of each is")
        return scan[np.sort(first)]

    def _warn(self, reason: str, sensor: int, text: str, question: str = "") -> None:
        if (reason, sensor) not in self._told:
            self._told.add((reason, sensor))
            self._say(f"{self._names[sensor]} {text} left out" + f"; {question}" * bool(question))

    def _say(self, text: str) -> None:
        """Warn at the line outside of the package that led to it."""
        frame, level = sys._getframe(), 1
        while frame.f_back is not None and frame.f_globals["__name__"].startswith("d2d."):
            frame, level = frame.f_back, level + 1
        warnings.warn(ScanWarning(text), stacklevel=level)


def usable(sensors: Mapping[str, SensorScans]) -> dict[str, SensorScans]:
    """The scans of whole logs that are used, and the mountings, by the sensors' names."""
    found = {}
    for name, (scans, mounting) in sensors.items():
        gate = ScanGate([name], Rounds([mounting]))
        found[name] = [used for scan in scans for used in gate.push(0, scan)[0]], mounting
        gate.finish()
    return found


def _repeats(previous: RadarScan, current: RadarScan) -> bool:
    """Whether a scan has all targets of the one before, at the same time or while it moves.

    A message that is delivered twice has the same time, a frozen sensor gives a new one: its
    positions say that the vehicle stands still.
    """
    if not same_targets(previous, current):
        return False
    moves = current.size and float(np.median(np.abs(current.doppler))) > _MOVING
    return previous.time == current.time or bool(moves)
