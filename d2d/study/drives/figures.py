"""The figures of the simulated drives: frames, platform, street, errors, targets."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.patches import Arc, Rectangle, Wedge
from numpy.typing import ArrayLike, NDArray

from d2d import rigid
from d2d._types import Array
from d2d.radar import Comparison, Mounting
from d2d.radar.simulation.drive import STEPS, Sensor
from d2d.radar.simulation.world import KINDS, World
from d2d.study.book.drawing import error_bands, intervals, label
from d2d.study.book.grammar import (
    BLACK,
    COSTS,
    COVARIANCES,
    GREY,
    OCHRE,
    PINK,
    PURPLE,
    SKY,
    TRUTH,
    YELLOW,
    cost_line,
)
from d2d.study.book.style import write_out_ticks
from d2d.study.drives import budget_trial
from d2d.study.drives.budget_trial import TrialErrors
from d2d.study.drives.errors import IN_UNITS, UNITS

SYMBOLS = ("$v_x$", "$v_y$", "ω")
# Things of the street have colours of their own: parked cars sky, vegetation olive, movers purple.
COLOURS = dict(zip(KINDS, ("0.45", "#2B83BA", PINK, "#6B8E23", PURPLE, YELLOW), strict=True))
WALL, CAR = "0.85", SKY
ROBUST = COSTS["robust"].color  # every estimate of a drive is the robust likelihood's


def coordinate_frames(ax: Axes, mounting: Mounting, labels: Mapping[str, str]) -> None:
    """Draw the frames of vehicle and sensor, and range, azimuth and Doppler velocity of a target.

    ``labels`` has the words for ``x``, ``y``, ``omega``, ``sensor x``, ``yaw``, ``range``,
    ``azimuth``, ``doppler``, ``offset x`` and ``offset y``.
    """
    sensor, azimuth, distance = mounting.pose[:2], np.deg2rad(35.0), 4.2
    sight = _towards(mounting.yaw + azimuth)
    target, end = sensor + distance * sight, sensor + 3.0 * _towards(mounting.yaw)
    ax.add_patch(Rectangle((-1.0, -0.9), 4.7, 1.8, facecolor="0.94", edgecolor="0.6"))
    ax.plot([0.0, mounting.x, mounting.x], [0.0, 0.0, mounting.y], ":", color="0.3", lw=1.2)
    ax.plot([mounting.x, mounting.x + 2.4], [mounting.y] * 2, ":", color="0.3", lw=1.2)
    ax.plot(*np.stack([sensor, target]).T, color=OCHRE, lw=1.2)
    for start, tip, color, name, shift in (
        (np.zeros(2), (2.0, 0.0), BLACK, "x", (-20, 6)),
        (np.zeros(2), (0.0, 2.0), BLACK, "y", (6, -4)),
        (sensor, end, PURPLE, "sensor x", (5, -4)),
        (target, target + 1.2 * sight, GREY, "doppler", (6, -6)),
    ):
        _arrow(ax, start, tip, color, lw=1.5)
        label(ax, tip, labels[name], color, shift)
    origin, place = (0.0, 0.0), (mounting.x, mounting.y)
    for centre, size, low, high, color, name, shift in (
        (place, 2.8, 0.0, mounting.yaw, PURPLE, "yaw", (4, -4)),
        (place, 5.4, mounting.yaw, mounting.yaw + azimuth, OCHRE, "azimuth", (3, 4)),
        (origin, 1.5, 0.3, 1.3, BLACK, "omega", (4, 2)),
    ):
        angles = {"theta1": np.rad2deg(low), "theta2": np.rad2deg(high)}
        ax.add_patch(Arc(centre, size, size, color=color, **angles))
        middle = np.add(centre, 0.5 * size * _towards(0.5 * (low + high)))
        label(ax, middle, labels[name], color, shift)
    _arrow(ax, 0.75 * _towards(1.1), 0.75 * _towards(1.35), BLACK)
    label(ax, 0.45 * sensor + 0.55 * target, labels["range"], OCHRE, (-34, 4))
    label(ax, (0.5 * mounting.x, 0.0), labels["offset x"], PURPLE, (0, -15))
    label(ax, (mounting.x, 0.5 * mounting.y), labels["offset y"], PURPLE, (5, -5))
    for point, marker, color in ((target, "^", OCHRE), (place, "s", PURPLE), (origin, "o", BLACK)):
        ax.plot(*point, marker, color=color, ms=8)
    ax.set(xlim=(-1.4, 8.2), ylim=(-1.6, 6.9), xlabel="x (m)", ylabel="y (m)", aspect="equal")


def _towards(angle: float) -> Array:
    return np.array([math.cos(angle), math.sin(angle)])


def _arrow(ax: Axes, start: Any, end: Any, color: str, **style: Any) -> None:
    arrow = {"arrowstyle": "-|>", "color": color, "shrinkA": 0, "shrinkB": 0, **style}
    ax.annotate("", end, start, arrowprops=arrow)


def platform(axes: NDArray[np.object_], mounting: Mounting, sensor: Sensor) -> None:
    """The robot with its radar from above, and its field of view, in m."""
    near, far = axes
    half, reach = np.rad2deg(sensor.field_of_view), sensor.max_range
    for side in (-0.34, 0.34):
        for wheel in (-0.35, 0.0, 0.35):
            corner = (wheel - 0.13, side - 0.06)
            near.add_patch(Rectangle(corner, 0.26, 0.12, facecolor="0.35", edgecolor="none"))
    near.add_patch(Rectangle((-0.5, -0.27), 0.9, 0.54, facecolor="0.9", edgecolor="0.4"))
    near.plot(mounting.x, mounting.y, "s", color=PURPLE, ms=8)
    label(near, (mounting.x, 0.5), "radar", PURPLE, (-14, 0))
    far.plot(0.0, 0.0, "s", color=BLACK, ms=3)
    label(far, (0.0, 0.0), "robot", BLACK, (-32, -4))
    for tip, name, shift in (((0.3, 0), "$x$", (-6, 4)), ((0, 0.3), "$y$", (-12, -12))):
        _arrow(near, (0, 0), tip, BLACK)
        label(near, tip, name, BLACK, shift)
    near.set(xlim=(-0.75, 1.05), ylim=(-1.0, 1.0), title="the robot", anchor="N")
    far.set(xlim=(-19.0, 54.0), ylim=(-36.0, 36.0), title="what its radar sees", anchor="N")
    for panel in axes:
        _field_of_view(panel, mounting, sensor, length=reach, alpha=0.35)
        panel.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    label(far, (0.4 * reach, 0.0), f"±{half:.0f}°,\nto {reach:g} m", PURPLE, (0, -8))


def specification(sensor: Sensor) -> tuple[tuple[str, str, str], ...]:
    """The specification of the simulated sensor: names, values and units."""
    azimuth = np.rad2deg(sensor.sigma_azimuth)
    steps = (f"{step:g}" for step in STEPS[:, 0])
    names = ("range step", "azimuth step", "Doppler step")
    return (
        ("carrier", "77", "GHz"),
        ("rate", f"{sensor.rate:g}", "Hz"),
        ("targets", f"at most {sensor.max_targets}", ""),
        ("range", f"{sensor.min_range:g} to {sensor.max_range:g}", "m"),
        ("σ range", f"{sensor.sigma_range:g} to {2 * sensor.sigma_range:g}", "m"),
        ("σ azimuth", f"{azimuth:.1f} to {2 * azimuth:.1f}", "deg"),
        ("σ Doppler", f"{sensor.sigma_doppler:g} to {2 * sensor.sigma_doppler:g}", "m/s"),
        *zip(names, steps, ("m", "rad", "m/s"), strict=True),
        ("false targets", f"{sensor.clutter:g}", "a scan"),
    )


def street(ax: Axes, world: World, pose: ArrayLike = (0.0, 0.0, 0.0)) -> None:
    """Draw houses, parked cars and the reflection points of what stands still, seen from a pose."""
    to_frame = rigid.inverse(pose)
    for outlines, face, edge in ((world.buildings, WALL, "0.4"), (world.cars, CAR, "none")):
        corners = rigid.transform_means(to_frame, outlines.reshape(-1, 2)).reshape(outlines.shape)
        ax.add_collection(PolyCollection(list(corners), facecolor=face, edgecolor=edge))
    for kind, size in (("wall", 1.0), ("car", 1.5), ("vegetation", 1.5), ("pole", 4.0)):
        points = rigid.transform_means(to_frame, world.points[world.kind == kind])
        name = kind if kind != "car" else "parked car"
        ax.plot(*points.T, ".", color=COLOURS[kind], ms=size, label=name)


def surroundings(ax: Axes, world: World, pose: ArrayLike, time: float, mounting: Mounting) -> None:
    """Draw the street and its movers at a time in the vehicle frame, and what the sensor sees."""
    street(ax, world, pose)
    movers = rigid.transform_means(rigid.inverse(pose), world.movers.at(np.asarray(time))[0])
    ax.plot(*movers.T, "o", color=COLOURS["moving"], ms=3, label="moving")
    _field_of_view(ax, mounting, Sensor(), length=Sensor().max_range, alpha=0.2)


def _field_of_view(
    ax: Axes, mounting: Mounting, sensor: Sensor, length: float, alpha: float
) -> None:
    middle, half = np.rad2deg(mounting.yaw), np.rad2deg(sensor.field_of_view)
    place, angles = (mounting.x, mounting.y), (middle - half, middle + half)
    ax.add_patch(Wedge(place, length, *angles, facecolor=SKY, alpha=alpha, lw=0))


def error_bounds(axes: NDArray[np.object_], judged: Mapping[str, Comparison]) -> None:
    """Draw errors in bands of three stated sigmas, with the share inside: a column a track."""
    for column, (name, found) in zip(axes.T, judged.items(), strict=True):
        color = GREY if name == "without Doppler" else ROBUST
        for k, (ax, symbol, unit) in enumerate(zip(column, SYMBOLS, UNITS, strict=True)):
            values, sigma = found.errors[:, k] * IN_UNITS[k], found.sigmas[:, k]
            error_bands(ax, found.times, values, sigma, f"{symbol} ({unit})", color)
            ratio = np.abs(values) / sigma
            inside = 100.0 * np.mean(ratio[np.isfinite(ratio)] < 3.0)
            ax.set_title(f"{name}: {inside:.0f} % inside")
        column[-1].set_xlabel("time (s)")


def rejected_kinds(ax: Axes, shares: Mapping[str, Mapping[str, float]]) -> None:
    """Mark the rejected share of each kind of target, for the named tracks in one row."""
    kinds = list(next(iter(shares.values())))
    rows = np.arange(len(kinds))
    for k, (share, color) in enumerate(zip(shares.values(), (GREY, ROBUST), strict=True)):
        values, places = 100.0 * np.array(list(share.values())), rows + 0.34 * k - 0.17
        ax.hlines(places, 0.0, values, color=color, lw=1.0)
        ax.plot(values, places, "os"[k], color=color, ms=6)
    ax.set_yticks(rows, kinds)
    ax.invert_yaxis()
    ax.set(xlim=(0.0, 104.0), xlabel="rejected (%)", xticks=[0, 50, 100])
    ax.grid(axis="y", visible=False)


def track_lines(ax: Axes, poses: Array, true: Array) -> None:
    """The integrated path over the true one, with lines that join poses of the same time."""
    links = np.stack([poses[::100, :2], true[::100, :2]], axis=1)
    ax.add_collection(LineCollection(list(links), colors="0.5", linewidths=0.8))
    ax.plot(*poses[:, :2].T, **cost_line("robust", label="estimate"))
    ax.plot(*true[:, :2].T, **TRUTH, label="truth")
    ax.plot(*true[0, :2], "o", color=BLACK, ms=4)


def ingredients(ax: Axes, trial: Mapping[str, TrialErrors]) -> None:
    """ANEES of each covariance, a row for each ingredient; a bar is a 95 % interval."""
    rows = np.arange(len(trial))
    anees = np.array([errors.anees for errors in trial.values()])
    bounds = np.array([errors.interval for errors in trial.values()])
    for k, name in enumerate(budget_trial.COVARIANCES):
        places = rows + 0.22 * (k - 1)
        marks = COVARIANCES[name].marks
        intervals(ax, anees[:, k], bounds[:, :, k], places, **marks)
    ax.axvline(1.0, **TRUTH)
    ax.set_yticks(rows, list(trial))
    ax.invert_yaxis()
    ax.set(xscale="log", xlabel="ANEES")
    write_out_ticks(ax.xaxis, (1, 2, 5, 10, 20, 50))
    ax.grid(axis="y", visible=False)
