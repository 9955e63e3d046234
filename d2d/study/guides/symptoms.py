"""Tracks of a log or a mounting that is wrong in one of the usual ways."""

import re
import string
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from d2d._types import Array
from d2d.radar import (
    Mounting,
    RadarScan,
    Reference,
    Track,
    diagnose,
    doppler_velocity,
    over_ground_undone,
    track,
)
from d2d.study.book.grammar import BLACK, COSTS, MOVING, PINK, TRUTH
from d2d.study.book.table import Table, table
from d2d.study.guides.rows import NAN, Row, row
from d2d.study.guides.stated_sigmas import front_drive, scaled

Scans = list[RadarScan]
Fault = Callable[[Scans, Mounting, Reference], tuple[Scans, Mounting]]
_NYQUIST = 8.0  # m/s: a sensor that folds its velocities into this, to either side


class Symptom(NamedTuple):
    """Signs of a fault: slopes of v_x and omega over the true ones, and an error or a finding."""

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
    # 5 x too small is a matter of the last digit: of many optima, each depends on the one before
    "sigmas 3 x too small": _each(lambda scan: scaled(scan, 1.0 / 3.0)),
    "sigmas 3 x too large": _each(lambda scan: scaled(scan, 3.0)),
    "azimuths in degrees": _each(lambda scan: replace(scan, azimuth=np.rad2deg(scan.azimuth))),
    "times in microseconds": _each(lambda scan: replace(scan, time=1e6 * scan.time)),
}


@cache
def symptoms() -> list[Symptom]:
    """Track a lap of the car with one fault of `FAULTS` after the other."""
    return [_track_with(name) for name in FAULTS]


@cache
def _lap(name: str) -> tuple[Scans, Mounting, Track]:
    """The log of a lap with a fault, and its track."""
    drive = front_drive()
    scans, mounting = FAULTS[name](drive.scans, drive.mounting, drive.truth)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # tables and pictures show what they say
        return scans, mounting, track((scans, mounting))


def _track_with(name: str) -> Symptom:
    truth = front_drive().truth
    try:
        scans, mounting, driven = _lap(name)
    except ValueError as error:
        nothing = Row(name, NAN, NAN, NAN, NAN, NAN, "")
        return Symptom(nothing, NAN, NAN, f"ValueError: {error}")
    message = "; ".join(map(str, diagnose((scans, mounting), driven)))
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


def draw_atlas(figure: Figure, cards: Mapping[str, tuple[str, str]], columns: int) -> None:
    """Draw a card for each fault: the path, the Doppler velocities of one scan, and the cure.

    The values of ``cards`` are what the path looks like and what undoes the fault.
    """
    truth = front_drive().truth
    swift = np.where(truth.theta[:, 0] > _NYQUIST, np.abs(truth.theta[:, 2]), 0.0)
    bend = int(np.argmax(swift))  # where the car turns, and is fast enough to fold
    high = [0.15, *len(cards) // columns * [1.0]]  # the headline's row first
    places = figure.subfigures(len(high), columns, squeeze=False, height_ratios=high)[1:].ravel()
    edges = {"left": 0.21, "right": 0.95, "bottom": 0.31, "top": 0.9, "height_ratios": (1.7, 1.0)}
    for place, letter, (fault, (looks, cure)) in zip(
        places, string.ascii_lowercase, cards.items(), strict=False
    ):
        scans, mounting, driven = _lap(fault)
        path, fan = place.subplots(2, 1, gridspec_kw=edges)
        _draw_path(path, driven, truth)
        _draw_fan(fan, scans[bend], truth.theta[bend], mounting)
        share = f"{100 * driven.converged.mean():.0f} % accepted"
        place.suptitle(
            f"({letter}) {looks}", x=0.02, y=0.98, ha="left", fontsize=9, weight="normal"
        )
        words = fault.replace("nothing", "nothing wrong").replace(" deg", "°")
        place.text(0.02, 0.22, f"{words}\n{share}\n{cure}", fontsize=9, va="top")


def _draw_path(ax: Axes, driven: Track, truth: Reference) -> None:
    """The path with an arrow of its direction and crosses where it is guessed; the true one."""
    poses = driven.poses(truth.poses[0])
    ax.plot(*truth.poses[:, :2].T, **TRUTH)
    ax.plot(*poses[:, :2].T, color=COSTS["robust"].color)
    guessed = poses[1:][~driven.converged, :2]
    ax.plot(*guessed[::8].T, "x", color=PINK, ms=4, mew=1.4)  # all would run together
    ax.plot(*truth.poses[0, :2], "o", color=BLACK, ms=4)
    tail, head = poses[len(poses) // 12 + np.array([0, 6]), :2]
    ax.annotate("", head, tail, arrowprops={"arrowstyle": "-|>", "mutation_scale": 12, "fc": BLACK})
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_axis_off()


def _draw_fan(ax: Axes, scan: RadarScan, theta: Array, mounting: Mounting) -> None:
    """The Doppler velocities of a scan, and those of targets at rest as the mounting has them."""
    azimuth = np.deg2rad(np.linspace(-60.0, 60.0, 121))
    ax.plot(np.rad2deg(azimuth), doppler_velocity(theta, azimuth, mounting), **TRUTH)
    expected = doppler_velocity(theta, scan.azimuth, mounting)
    ax.vlines(np.rad2deg(scan.azimuth), expected, scan.doppler, MOVING, lw=0.8, alpha=0.5)
    ax.plot(np.rad2deg(scan.azimuth), scan.doppler, ".", color=MOVING, ms=5)
    ax.set(xlim=(-62, 62), ylim=(-13, 17), xticks=[-45, 0, 45], yticks=[-10, 0, 10])
    ax.set_title("m/s", fontsize=8, pad=2.0)
    ax.tick_params(labelsize=8)
    ax.xaxis.set_major_formatter("{x:.0f}°")
