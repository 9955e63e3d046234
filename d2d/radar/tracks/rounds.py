"""The scans of one sensor or several in rounds, and the pairs of scans of each round."""

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import groupby, zip_longest
from statistics import median
from typing import Any, NamedTuple, Protocol

import numpy as np

from d2d._checks import SECONDS, check_count, check_members, check_positive_scalar
from d2d.radar.motion.pairs import ScanPair
from d2d.radar.scans.scan import MEASURED, Mounting, RadarScan, level

MAX_INTERVAL = 60.0  # s; longer times between scans, and horizons, are taken for another unit
HORIZON = 0.3  # s; on five drives the yaw rate was best at 0.15 to 0.3 s (appendix F)
_REMEMBERED = 9  # intervals of a sensor, whose median is its cycle
_ROUND = 1.5  # cycles, after which a round is over
# A pair may be this many times as long as the horizon, or bridge a scan that is missing.
_LONGER, _GAP = 1.5, 2.5  # times the usual interval, cycles

SensorScans = tuple[list[RadarScan], Mounting]


class _WithScans(Protocol):
    """A `Recording`, a simulated `Drive`, or what else has both."""

    @property
    def scans(self) -> Iterable[RadarScan]: ...

    @property
    def mounting(self) -> Mounting: ...


OneSensor = _WithScans | tuple[Iterable[RadarScan], Mounting]
Sensors = OneSensor | Iterable[OneSensor] | Mapping[Any, OneSensor]


def named_sensors(sensors: Sensors, max_interval: float = MAX_INTERVAL) -> dict[str, SensorScans]:
    """The scans and the mounting of each sensor, checked, whichever way they are given.

    By the names of their scans in messages.  Their order in time is not checked here.
    """
    longest, named = check_positive_scalar("max_interval", max_interval), {}
    given: Any = sensors
    if _parts(given) is not None:
        given = {"scans": given}
    else:
        if not isinstance(given, Mapping):
            given = dict(enumerate(check_members("sensors", given, object)))
        given = {f"sensors[{key!r}].scans": sensor for key, sensor in given.items()}
    for name, sensor in given.items():
        parts = _parts(sensor)
        if parts is None:
            raise ValueError(
                f"{name.removesuffix('.scans')} must be a Recording or a tuple (scans, Mounting), "
                f"but is a {type(sensor).__name__}"
            )
        scans, mounting = check_members(name, parts[0], RadarScan), parts[1]
        intervals = np.diff([scan.time for scan in scans])
        if len(intervals) and np.median(intervals) > longest:
            raise ValueError(
                f"{name} must have times in seconds (s), at most max_interval = {longest:g} apart, "
                f"but {scans[1].time:.6f} comes after {scans[0].time:.6f}; a log's time_unit "
                "(--time-unit) is s unless stated: are these nano-, milli- or microseconds?"
            )
        named[name] = scans, mounting
    check_distinct({name: scans for name, (scans, _) in named.items()})
    return {
        name: ([level(scan, mounting)[0] for scan in scans], mounting.flat)
        for name, (scans, mounting) in named.items()
    }


def _parts(sensor: Any) -> tuple[Any, Mounting] | None:
    """The scans and the mounting of one sensor; None if it is something else."""
    if isinstance(sensor, tuple) and len(sensor) == 2:
        scans, mounting = sensor
    else:
        scans, mounting = getattr(sensor, "scans", None), getattr(sensor, "mounting", None)
    return (scans, mounting) if isinstance(mounting, Mounting) else None


def check_distinct(sensors: Mapping[str, Iterable[RadarScan]]) -> None:
    """Raise a ValueError if two sensors have a scan in common: it would count twice."""
    seen: dict[float, list[tuple[str, RadarScan]]] = {}
    for name, scans in sensors.items():
        for scan in scans:
            for owner, other in seen.setdefault(scan.time, []):
                # one target may be seen alike by chance
                if owner != name and scan.size > 1 and same_targets(scan, other):
                    raise ValueError(
                        f"{owner} and {name} must be different, but have the same scan at "
                        f"{scan.time:.6f} s; is one sensor given twice?"
                    )
            seen[scan.time].append((name, scan))


def same_targets(scan: RadarScan, other: RadarScan) -> bool:
    """Whether two scans have all targets in common."""
    return scan.size == other.size and all(
        (getattr(scan, name) == getattr(other, name)).all() for name in MEASURED
    )


def check_clocks(sensors: Mapping[str, Sequence[RadarScan]]) -> None:
    """Raise a ValueError unless the clocks of all sensors step back together, and overlap."""
    parts = {name: _segments(scans) for name, scans in sensors.items() if scans}
    if len({len(segments) for segments in parts.values()}) > 1:
        name, other = (pick(parts, key=lambda n: len(parts[n])) for pick in (max, min))
        before, after = parts[name][-2][-1].time, parts[name][-1][0].time
        raise ValueError(
            f"the clock of {name} steps back from {before:.3f} s to {after:.3f} s, and that of "
            f"{other} does not; take the log before and after it, or without one of them"
        )
    for together in zip(*parts.values(), strict=True):
        named = zip(parts, together, strict=True)
        spans = [(name, own[0].time, own[-1].time) for name, own in named if len(own) > 1]
        for name, start, end in spans:
            others = [span for span in spans if span[0] != name]
            if others and all(end < first or last < start for _, first, last in others):
                other, first, last = others[0]
                raise ValueError(
                    f"{name} has times from {start:.3f} s to {end:.3f} s, and {other} from "
                    f"{first:.3f} s to {last:.3f} s: they do not overlap; is the clock of one "
                    "another?"
                )


class Round(NamedTuple):
    """Scans of about one time, at most one of each sensor, and the pairs that they are part of."""

    time: float  # s, the mean of the scans' times
    interval: float  # s, since the round before; nan if the clock has stepped back since
    scans: dict[int, RadarScan]  # by the number of the sensor
    pairs: list[ScanPair]
    sensors: list[int]  # the number of the sensor of each pair
    reason: str  # why there is no pair, if there is none


class Rounds:
    """Divides scans into rounds as they arrive, and pairs each with an earlier one of its sensor.

    `d2d.radar.track` says when a round ends, and what is left out.  A sensor's cycle is the median
    of its last intervals, that of a round the shortest of its sensors.  The scans of a pair are
    ``baseline`` scans or a ``horizon`` in s apart, by default `HORIZON`.  A scan that is no later
    than the last round is left out: ``late`` gets its sensor, the scan and that round's time.
    """

    def __init__(
        self,
        mountings: Sequence[Mounting],
        baseline: int | None = None,
        horizon: float | None = None,
    ) -> None:
        if baseline is not None:
            check_count("baseline", baseline)
        elif horizon is None:
            horizon = HORIZON
        if horizon is not None:
            SECONDS._replace(above=0.0, most=MAX_INTERVAL).number("horizon", horizon)
            if baseline not in (None, 1):
                raise ValueError(
                    "horizon and baseline must not both be given, but are "
                    f"{horizon:g} s and {baseline}"
                )
        self.histories = [History(mounting, baseline or 1, horizon) for mounting in mountings]
        self.late: Callable[[int, RadarScan, float], None] = lambda *_: None
        self._stepped_back = False
        self.open: dict[int, RadarScan] = {}  # the scans of the round that has not ended
        self._start = math.nan  # time of the open round's first scan
        self.last = math.nan  # s, time of the last round

    def take(self, scans: Iterable[tuple[int, RadarScan]]) -> list[Round]:
        """The rounds that the next scans of sensors end, in the order of their times.

        Of equal times, those of sensors that the open round already holds come first: they end it,
        so that scans of the same time stay together whichever sensor is named first.
        """
        ended = []
        order = sorted(scans, key=lambda entry: (entry[1].time, entry[0]))
        for _, entries in groupby(order, key=lambda entry: entry[1].time):
            for sensor, scan in sorted(entries, key=lambda entry: entry[0] not in self.open):
                ended += self.add(sensor, scan)
        return ended

    def add(self, sensor: int, scan: RadarScan) -> list[Round]:
        """The rounds that a sensor's next scan ends: often none, seldom two."""
        ended = []
        if self.open:
            cycle = min(self.histories[known].cycle for known in self.open)
            if sensor in self.open or abs(scan.time - self._start) > _ROUND * cycle:
                ended = self.finish()
        if scan.time <= self.last:
            self.late(sensor, scan, self.last)
            return ended
        if not self.open:
            self._start = scan.time
        self.open[sensor] = scan
        return ended + (self.finish() if len(self.open) == len(self.histories) else [])

    def finish(self) -> list[Round]:
        """The open round, if there is one, and not the first: that has nothing to pair with."""
        scans, self.open = self.open, {}
        if not scans:
            return []
        # neither the arrival nor the numbers of the sensors decide on the rounding of a sum
        at = [history.mounting for history in self.histories]
        order = sorted(scans, key=lambda s: (scans[s].time, at[s].x, at[s].y, at[s].yaw))
        chosen = {s: self.histories[s].paired(scans[s]) for s in order}
        pairs = {s: pair for s, pair in chosen.items() if pair is not None}
        time = sum(scans[s].time for s in order) / len(order)
        interval, self.last = time - self.last, time
        if math.isnan(interval) and not self._stepped_back:
            return []
        reason = "the first scan after a gap"
        if self._stepped_back:
            self._stepped_back, reason = False, "the first scan after the clock stepped back"
        elif not all(scan.size for scan in scans.values()):
            reason = "a scan without targets"
        return [Round(time, interval, scans, list(pairs.values()), list(pairs), reason)]

    def step_back(self) -> list[Round]:
        """End the open round, and begin a segment whose times may lie before it."""
        ended = self.finish()
        for history in self.histories:
            history.scans.clear()
        self._stepped_back, self.last = not math.isnan(self.last), math.nan
        return ended


class History:
    """The latest scans of one sensor."""

    def __init__(self, mounting: Mounting, baseline: int, horizon: float | None) -> None:
        self.mounting = mounting
        self._baseline, self._horizon = baseline, horizon
        self.scans: deque[RadarScan] = deque()  # which later ones may be paired with
        self._intervals: deque[float] = deque(maxlen=_REMEMBERED)
        self.cycle = math.inf  # s, the usual time from one scan to the next

    def paired(self, scan: RadarScan) -> ScanPair | None:
        """The next scan, paired with an earlier one; None if there is none near enough.

        One without targets is passed over, as if it had not been taken.
        """
        if not scan.size:
            return None
        scans, previous = self.scans, None
        if scans:
            self._intervals.append(scan.time - scans[-1].time)
            self.cycle = median(self._intervals)
            usual = self._baseline * self.cycle if self._horizon is None else self._horizon
            longest = max(_LONGER * usual, _GAP * self.cycle)
            while scans and scan.time - scans[0].time > longest:
                scans.popleft()
        if scans and self._horizon is not None:
            # rounding must not decide between two scans that are equally near: the later one wins
            wanted = scan.time - self._horizon
            previous = min(reversed(scans), key=lambda each: round(abs(each.time - wanted), 6))
        elif scans:
            previous = scans[max(len(scans) - self._baseline, 0)]
        scans.append(scan)
        return None if previous is None else ScanPair(previous, scan, self.mounting)


def rounds_of(
    sensors: Sequence[SensorScans], baseline: int | None = None, horizon: float | None = None
) -> list[Round]:
    """All rounds of a whole log but the first, as `Rounds` gives them one by one."""
    rounds = Rounds([mounting for _, mounting in sensors], baseline, horizon)
    found: list[Round] = []
    for together in zip_longest(*(_segments(scans) for scans, _ in sensors), fillvalue=[]):
        found += rounds.step_back()
        found += rounds.take((s, scan) for s, own in enumerate(together) for scan in own)
    return found + rounds.finish()


def _segments(scans: Iterable[RadarScan]) -> list[list[RadarScan]]:
    """The scans in parts, in each of which their times increase."""
    parts: list[list[RadarScan]] = []
    for scan in scans:
        if not parts or scan.time <= parts[-1][-1].time:
            parts.append([])
        parts[-1].append(scan)
    return parts
