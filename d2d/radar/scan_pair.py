"""Two scans of one sensor, as a pair of point sets in the vehicle frame."""

from collections.abc import Iterable

from d2d._checks import check_instance, check_rows
from d2d.problem import Pair
from d2d.radar.options import EgoMotionModel
from d2d.radar.scan import Mounting, RadarScan

ScanPair = tuple[RadarScan, RadarScan, Mounting]


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
