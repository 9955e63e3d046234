"""Two scans of one sensor, as a pair of point sets in the vehicle frame."""

from bisect import bisect_left
from collections.abc import Iterable, Sequence

import numpy as np

from d2d._checks import check_count, check_instance, check_positive, check_rows, check_seconds
from d2d.problem import Pair
from d2d.radar.motion.model import EgoMotionModel
from d2d.radar.scans.scan import Mounting, RadarScan

_LONGEST_HORIZON = 60.0  # s

_MOVING = 0.5  # m/s; at a standstill a coarse radar may measure the same twice

ScanPair = tuple[RadarScan, RadarScan, Mounting]


def check_separation(baseline: int, horizon: float | None) -> None:
    """Raise a ValueError unless one of the two says how far apart the scans of a pair are."""
    check_count("baseline", baseline)
    if horizon is None:
        return
    check_positive("horizon", check_seconds("horizon", horizon, _LONGEST_HORIZON))
    if baseline != 1:
        raise ValueError(
            f"horizon and baseline must not both be given, but are {horizon:g} s and {baseline}"
        )


def check_distinct(name: str, sensors: Iterable[Iterable[RadarScan]]) -> None:
    """Raise a ValueError if two sensors have a scan in common: it would count twice."""
    owners: dict[tuple[object, ...], int] = {}
    for number, scans in enumerate(sensors):
        for scan in scans:
            measured = (scan.range, scan.azimuth, scan.doppler)
            key = (scan.time, *(array.tobytes() for array in measured))
            owner = owners.setdefault(key, number)
            if owner != number and scan.size > 1:  # one target may be seen alike by chance
                raise ValueError(
                    f"{name} must be different ones, but {name}[{owner}] and {name}[{number}] "
                    f"have the same scan at {scan.time:.6f} s; is one sensor given twice?"
                )


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


def repeats(previous: RadarScan, current: RadarScan) -> bool:
    """Whether a scan has the targets of an earlier one although the sensor moves.

    A frozen sensor, or a message that is delivered twice, gets a new time: its positions say that
    the vehicle stands still.
    """
    measured = ("range", "azimuth", "doppler")
    return (
        all(np.array_equal(getattr(previous, name), getattr(current, name)) for name in measured)
        and float(np.median(np.abs(current.doppler))) > _MOVING
    )


def check_pairs(pairs: Iterable[ScanPair]) -> list[ScanPair]:
    """At least one (previous, current, mounting); else a ``ValueError`` names ``pairs``."""
    rows = check_rows("pairs", pairs, RadarScan, RadarScan, Mounting)
    if not rows:
        raise ValueError("pairs must hold at least one pair of scans, but is empty")
    return rows


def scan_pair(
    previous: RadarScan, current: RadarScan, mounting: Mounting, model: EgoMotionModel
) -> Pair:
    """The previous scan as the fixed set, the current one as the moving set, with its velocities.

    See `d2d.radar.estimate_ego_motion` for the arguments and for the errors.
    """
    for name, scan in (("previous", previous), ("current", current)):
        check_instance(name, scan, RadarScan)
    interval = current.time - previous.time
    if not interval > 0:
        raise ValueError(
            f"current must be later than previous, but is at {current.time:.6f} s after "
            f"{previous.time:.6f} s"
        )
    for name, scan in (("previous", previous), ("current", current)):
        if not scan.size:
            raise ValueError(f"{name} holds no targets")
    measurement = current.doppler_measurement(mounting, interval, of_twist=not model.first_order)
    return Pair(
        previous.point_set(mounting),
        current.point_set(mounting),
        measurement if model.doppler else None,
        interval,
    )


def scan_pairs(previous, current, mounting):  # type: ignore[no-untyped-def]
    """Placeholder until the merge."""
    if isinstance(previous, RadarScan):
        return [(previous, current, mounting)]
    return list(zip(previous, current, mounting, strict=True))
