"""Tracks of a log or a mounting that is wrong in one of the usual ways."""

import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes

from d2d.radar import (
    Mounting,
    RadarScan,
    Reference,
    Track,
    diagnose,
    over_ground_undone,
    track,
)
from d2d.study.book.grammar import BLACK, PINK, TRUTH, cost_line
from d2d.study.book.style import label_planar_axes
from d2d.study.book.table import Table, table
from d2d.study.guides.rows import NAN, Row, row
from d2d.study.guides.stated_sigmas import front_drive, scaled

Scans = list[RadarScan]
Fault = Callable[[Scans, Mounting, Reference], tuple[Scans, Mounting]]
_NYQUIST = 8.0  # m/s: a sensor that folds its velocities into this, to either side


class Symptom(NamedTuple):
    """Signs in a track of one fault.

    ``forward`` and ``turning`` are the slopes of the accepted v_x and omega over the true ones;
    ``message`` is an error or what `diagnose` finds, empty if there is nothing.
    """

    row: Row
    forward: float
    turning: float
    message: str


def _each(change: Callable[[RadarScan], RadarScan]) -> Fault:
    return lambda scans, mounting, truth: ([change(scan) for scan in scans], mounting)


def _placed(change: Callable[[Mounting], Mounting]) -> Fault:
    return lambda scans, mounting, truth: (scans, change(mounting))


def _folded(scan: RadarScan) -> RadarScan:
    return replace(scan, doppler=(scan.doppler + _NYQUIST) % (2.0 * _NYQUIST) - _NYQUIST)


FAULTS: dict[str, Fault] = {
    "nothing": _each(lambda scan: scan),
    "Doppler sign flipped": _each(lambda scan: replace(scan, doppler=-scan.doppler)),
    "azimuth sign flipped": _each(lambda scan: replace(scan, azimuth=-scan.azimuth)),
    "mounted backwards": _placed(lambda m: replace(m, yaw=m.yaw + np.pi)),
    "mounting 5 deg off": _placed(lambda m: replace(m, yaw=m.yaw + np.deg2rad(5.0))),
    "mounting place left out": _placed(lambda m: Mounting(0.0, 0.0, m.yaw)),
    # as some sensors report it: the velocity of a static target is subtracted
    "Doppler over ground": lambda s, m, truth: (over_ground_undone(s, -truth.theta, m), m),
    "Doppler folded at 8 m/s": _each(_folded),
    "sigmas 5 x too small": _each(lambda scan: scaled(scan, 0.2)),
    "sigmas 5 x too large": _each(lambda scan: scaled(scan, 5.0)),
    "azimuths in degrees": _each(lambda scan: replace(scan, azimuth=np.rad2deg(scan.azimuth))),
    "times in microseconds": _each(lambda scan: replace(scan, time=1e6 * scan.time)),
}


@cache
def symptoms() -> list[Symptom]:
    """Track a lap of the car with one fault of `FAULTS` after the other."""
    drive = front_drive()
    return [_tried(name, drive.scans, drive.mounting, drive.truth) for name in FAULTS]


def _tried(name: str, scans: Scans, mounting: Mounting, truth: Reference) -> Symptom:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        try:
            log = FAULTS[name](scans, mounting, truth)
            driven = track(log)
        except ValueError as error:
            nothing = Row(name, NAN, NAN, NAN, NAN, NAN, "")
            return Symptom(nothing, NAN, NAN, f"ValueError: {error}")
    message = "; ".join(map(str, diagnose(log, driven)))
    forward, turning = (_slope(driven, truth, component) for component in (0, 2))
    return Symptom(row(name, driven, truth), forward, turning, message)


def _slope(driven: Track, truth: Reference, component: int) -> float:
    """Estimated over true velocity, by least squares through the origin; nan without estimates."""
    if not driven.converged.any():
        return NAN
    true = truth.at(driven.times).theta[driven.converged, component]
    return float(driven.theta[driven.converged, component] @ true / (true @ true))


def symptom_table(symptoms: Sequence[Symptom], caption: str = "") -> Table:
    """A row for each fault, with the reason of most failures or the end of the error's message."""
    rows = []
    for fault, forward, turning, message in symptoms:
        # the reason without its numbers, or what an error asks at its end
        asked = f"error: {message.split('are these ')[-1]}" if message else None
        reason = re.sub(r" of [-\d].*", "", fault.reason) or asked
        anees = float(f"{fault.anees:.2g}")
        rows.append((fault.name, fault.accepted, forward, turning, anees, reason))
    columns = [("accepted", "", ".1%"), ("v_x", "", ".1f"), ("omega", "", ".1f")]
    return table(rows, ["what is wrong", *columns, "ANEES", "most failures"], caption)


def draw_wrong_paths(axes: Sequence[Axes], faults: Mapping[str, str]) -> None:
    """The path of a lap with each fault beside the true one; values are what it looks like."""
    drive = front_drive()
    truth = drive.truth
    for ax, (fault, words) in zip(axes, faults.items(), strict=True):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # the picture shows what they say
            driven = track(FAULTS[fault](drive.scans, drive.mounting, truth))
        ax.plot(*truth.poses[:, :2].T, **TRUTH)
        poses = driven.poses(truth.poses[0])
        ax.plot(*poses[:, :2].T, **cost_line("robust"))
        failed = ~driven.converged
        ax.plot(*poses[1:][failed, :2].T, "x", color=PINK, ms=2)
        ax.plot(*truth.poses[0, :2], "o", color=BLACK, ms=4)
        label_planar_axes(ax, words)
