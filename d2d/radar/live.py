"""Scans and estimates as lines of JSON, for any middleware."""

import json
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from statistics import mode
from typing import Any

import numpy as np

from d2d import rigid
from d2d._checks import SECONDS, check_finite
from d2d._types import Array
from d2d.radar.scans.scan import ANGLES, MEASURED, SIGMAS, UPWARDS, RadarScan
from d2d.radar.tracks.estimator import VelocityEstimate
from d2d.radar.tracks.track import NUMBER
from d2d.radar.tracks.tracker import Tracker

_COLUMNS = ("time", *MEASURED, *SIGMAS)
# 3000 years since 1970, before those in ms begin; float64 still holds them to 15 us
_TIME = SECONDS._replace(most=1e11, hint="; are these milli-, micro- or nanoseconds?")
_WATCHED, _FEW = 50, 1 / 3  # the last estimates, and the share of them that is accepted at least


def estimates_of(
    lines: Iterable[str],
    tracker: Tracker,
    complain: Callable[[str], None],
    gates: Mapping[str, Any],
    *,
    degrees: bool = False,
    **sigmas: float,
) -> Iterator[str]:
    """The estimates that lines with scans complete, as `python -m d2d.radar live --help` says.

    ``gates`` are arguments of `RadarScan.within`, ``sigmas`` those of all targets, in m, rad, m/s.
    What is wrong with a line goes to ``complain`` with its number, and the next one is read.
    """
    read = partial(_scan, degrees=degrees, sigmas=sigmas, gates=gates)

    def estimates() -> Iterator[VelocityEstimate]:
        for count, line in enumerate(lines, start=1):
            try:
                yield from _add(tracker, line, read)
            except (ValueError, RecursionError) as error:
                complain(f"line {count}: {error}")
        yield from tracker.finish()

    last, pose, reasons = None, np.zeros(3), deque[str](maxlen=_WATCHED)
    for estimate in estimates():
        # where an estimate was not accepted, its velocity is the last one that was
        before = estimate.theta if last is None else last.theta
        twist = 0.5 * estimate.interval * (before + estimate.theta)
        if np.isfinite(twist).all():  # else the clock stepped back, and nothing is known
            pose = rigid.compose(pose, rigid.exponential(twist))
        last = estimate
        yield _line(estimate, pose)
        reasons.append(NUMBER.sub("...", estimate.reason))
        accepted = reasons.count("")
        if len(reasons) == _WATCHED and accepted < _FEW * _WATCHED:
            said = f"only {accepted} of the last {_WATCHED} estimates were accepted; most often: "
            advice = 'the page "When a path looks wrong", and `track` on such a log, name mistakes'
            complain(f"{said}{mode(filter(None, reasons))}; {advice}")
            reasons = deque(maxlen=0)  # once is enough


def _add(
    tracker: Tracker, line: str, read: Callable[[dict[str, Any]], RadarScan]
) -> list[VelocityEstimate]:
    """The estimates that a line completes."""
    if not line.strip():
        return []
    entry = json.loads(line)
    if not isinstance(entry, dict):
        raise ValueError(f"a scan must be an object of JSON, but is {line.strip()[:40]}")
    if "time" in entry:
        if isinstance(entry["time"], bool):
            raise ValueError(f"time must be a number, but is {json.dumps(entry['time'])}")
        _TIME.number("time", entry["time"])
    if "yaw_rate" in entry:
        if "time" not in entry:
            raise ValueError("a yaw rate must have a time")
        tracker.add_gyro(*(np.atleast_1d(entry[name]) for name in ("time", "yaw_rate")))
        return []
    return tracker.add(str(entry.get("sensor")), read(entry))


def _scan(
    entry: dict[str, Any], degrees: bool, sigmas: dict[str, float], gates: Mapping[str, Any]
) -> RadarScan:
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
    return RadarScan(*(values[name] for name in _COLUMNS), **upwards).within(**gates)


def _line(estimate: VelocityEstimate, pose: Array) -> str:
    """An estimate as JSON, with null for what is not known."""
    names = ("time", "reason", "theta", "covariance", "targets", "inliers")
    entry = {name: _plain(getattr(estimate, name)) for name in names}
    entry |= {"converged": estimate.converged, "pose": pose.tolist(), "filter_input": None}
    if estimate.filter_input is not None:
        entry["filter_input"] = {n: _plain(v) for n, v in estimate.filter_input._asdict().items()}
    return json.dumps(entry, allow_nan=False)


def _plain(value: Any) -> Any:
    """A value of JSON, or None if a number is nan."""
    if isinstance(value, str | int):
        return value
    return np.asarray(value).tolist() if np.isfinite(value).all() else None
