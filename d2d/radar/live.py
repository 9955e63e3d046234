"""Scans and estimates as lines of JSON, for any middleware."""

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from d2d import rigid
from d2d._checks import SECONDS, check_finite
from d2d._types import Array
from d2d.radar.scans.scan import ANGLES, MEASURED, SIGMAS, UPWARDS, RadarScan
from d2d.radar.tracks.estimator import VelocityEstimate
from d2d.radar.tracks.tracker import Tracker

_COLUMNS = ("time", *MEASURED, *SIGMAS)
# 3000 years since 1970, before those in ms begin; float64 still holds them to 15 us
_TIME = SECONDS._replace(most=1e11, hint="; are these milli-, micro- or nanoseconds?")


def estimates_of(
    lines: Iterable[str],
    tracker: Tracker,
    complain: Callable[[str], None],
    gates: Mapping[str, Any],
    *,
    degrees: bool = False,
    **sigmas: float,
) -> Iterator[str]:
    """The estimates, one line of JSON each, that lines of JSON with scans complete.

    A line holds ``sensor``, ``time`` and the lists ``range``, ``azimuth``, ``doppler``,
    ``sigma_range``, ``sigma_azimuth``, ``sigma_doppler``, perhaps ``elevation`` and
    ``sigma_elevation``, in the units of `RadarScan`; with ``degrees``, angles are in degrees.  A
    standard deviation may be a number for all targets; one of ``sigmas``, in m, rad and m/s, counts
    instead of the lines'.  ``gates`` are arguments of `RadarScan.within`.  What is wrong with a
    line goes to ``complain`` with its number, and the next one is read.
    """
    last, pose = None, np.zeros(3)
    for count, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            entry = _entry(line)
            if "yaw_rate" in entry:
                tracker.add_gyro(*(np.atleast_1d(entry[name]) for name in ("time", "yaw_rate")))
                continue
            sensor, scan = _scan(entry, degrees, sigmas)
            found = tracker.add(sensor, scan.within(**gates))
        except (ValueError, RecursionError) as error:
            complain(f"line {count}: {error}")
            continue
        for estimate in found:
            last, pose = _moved(last, pose, estimate)
            yield _line(estimate, pose)
    for estimate in tracker.finish():
        last, pose = _moved(last, pose, estimate)
        yield _line(estimate, pose)


def _moved(
    last: VelocityEstimate | None, pose: Array, estimate: VelocityEstimate
) -> tuple[VelocityEstimate, Array]:
    """The estimate, and the pose that the mean of the last velocity and its own leads to.

    Where it was not accepted, its velocity is the last one that was; a step of the clock back, over
    which nothing is known, leaves the pose.
    """
    before = estimate.theta if last is None else last.theta
    twist = 0.5 * estimate.interval * (before + estimate.theta)
    moved = rigid.compose(pose, rigid.exponential(twist)) if np.isfinite(twist).all() else pose
    return estimate, moved


def _entry(line: str) -> dict[str, Any]:
    entry = json.loads(line)
    if not isinstance(entry, dict):
        raise ValueError(f"a scan must be an object of JSON, but is {line.strip()[:40]}")
    if "time" in entry:
        if isinstance(entry["time"], bool):
            raise ValueError(f"time must be a number, but is {json.dumps(entry['time'])}")
        _TIME.number("time", entry["time"])
    return entry


def _scan(entry: dict[str, Any], degrees: bool, sigmas: dict[str, float]) -> tuple[str, RadarScan]:
    missing = [name for name in ("sensor", *_COLUMNS) if name not in entry | sigmas]
    if missing:
        raise ValueError(f"a scan must have {', '.join(missing)}")
    turned = {
        name: np.deg2rad(check_finite(name, entry[name]))
        for name in ANGLES
        if degrees and name in entry and name not in sigmas
    }
    values = entry | turned | sigmas
    upwards = {name: values[name] for name in UPWARDS if name in values}
    return str(entry["sensor"]), RadarScan(*(values[name] for name in _COLUMNS), **upwards)


def _line(estimate: VelocityEstimate, pose: Array) -> str:
    """An estimate as JSON, with null for what is not known."""
    raw = estimate.filter_input
    entry = {
        "time": estimate.time,
        "converged": estimate.converged,
        "reason": estimate.reason,
        "theta": estimate.theta.tolist(),
        "pose": pose.tolist(),
        "covariance": _known(estimate.covariance),
        "targets": estimate.targets,
        "inliers": estimate.inliers if math.isfinite(estimate.inliers) else None,
        "filter_input": raw
        and {
            **{n: getattr(raw, n).tolist() for n in ("velocity", "white", "delay", "slow")},
            "lag": raw.lag,
        },
    }
    return json.dumps(entry, allow_nan=False)


def _known(matrix: Any) -> list[list[float]] | None:
    return matrix.tolist() if np.isfinite(matrix).all() else None
