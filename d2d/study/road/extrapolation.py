"""Radars that report too large Doppler velocities in turns, and errors of their mounting angles.

A static target of a sensor that turns with omega moves across its line of sight with omega r.
Extrapolated along the direction of its motion for a time t, it would be farther away and recede by
omega^2 r t.  The Doppler velocities of these radars contain this, and each mounting angle that is
wrong by beta makes the sensor seem to move sideways with beta v_x.  Both are fitted by least
squares to the Doppler velocities of all targets that agree with the reference, together with an
error of the speed of each radar.  Intervals contain 95 % of the values that are found when whole
seconds are drawn anew.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from d2d import block_bootstrap
from d2d._types import Array
from d2d.radar.scans.scan import doppler_gradients
from d2d.study.book.grammar import OTHERS, TRUTH
from d2d.study.book.style import headline, letter_panels, use_style
from d2d.study.results import results_path
from d2d.study.road.drive import Drive, Source
from d2d.study.road.markdown import markdown, write_page

SCENES = ("scene-0061", "scene-0916", "scene-1077")  # of one vehicle; the first is fitted to
TURNS = np.deg2rad(10.0)  # rad/s: a scene in which the yaw rate never gets larger tells nothing
FAST = np.deg2rad(18.0)  # rad/s, for the figure's second panel
RATES = np.deg2rad(np.arange(-30.0, 31.0, 3.0))  # rad/s, edges of the figure's bins
RANGES = np.array([0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 65.0, 80.0, 100.0])  # m
FEW = 100  # targets that a point of the figure needs
CYCLE = 37.5  # ms, half a cycle of the radars
MILLI = 1e3
_AGREES = 1.0  # m/s: a target that is farther off moves
_TRIMMED = 0.3  # m/s, of the residuals of the fit
_ITERATIONS = 15


def load_stated(source: Source) -> Drive:
    """Load a scene with what the radars report and the mounting angles as stated."""
    return source.load(prediction_time=0.0, stated_mounting=True)


def doppler_residuals(drive: Drive) -> pd.DataFrame:
    """By how much Doppler velocities exceed those that the reference predicts for static targets.

    A row for each target that may be static, where the reference is known: the ``excess`` in m/s;
    ``outward``, omega^2 r in m/s^2; ``ahead``, the cosine of the direction in the vehicle frame,
    and ``sideways``, its sine times v_x in m/s; the ``sensor``; the ``time`` in s; ``turning``,
    omega in rad/s; the ``distance`` in m.
    """
    tables = []
    for sensor, recording in enumerate(drive.recordings):
        for scan, theta in zip(recording.scans, recording.reference.theta, strict=True):
            if not scan.size or not np.isfinite(theta).all():
                continue
            direction = scan.azimuth + recording.mounting.yaw
            excess = scan.doppler - doppler_gradients(scan.azimuth, recording.mounting)[0] @ theta
            columns = {
                "excess": excess,
                "outward": theta[2] ** 2 * scan.range,
                "ahead": np.cos(direction),
                "sideways": theta[0] * np.sin(direction),
                "sensor": sensor,
                "time": scan.time,
                "turning": theta[2],
                "distance": scan.range,
            }
            tables.append(pd.DataFrame(columns)[np.abs(excess) < _AGREES])
    return pd.concat(tables, ignore_index=True)


class Fit(NamedTuple):
    """A least-squares fit to the residuals of a scene after the largest are cut off."""

    time: float  # s, for which a target is extrapolated
    mountings: Array  # (S,) rad, to be added to the stated angles
    bounds: Array  # (2,) s, of the time
    rms: float  # m/s, of the targets that are kept
    rms_without: float  # m/s, of these targets without the extrapolation
    corrected: Array  # (n,) m/s, excess without the errors of mountings and speeds
    keep: NDArray[np.bool_]  # (n,)


def fit_turning(residuals: pd.DataFrame) -> Fit:
    """Fit the time of the extrapolation, and errors of each sensor's mounting angle and speed."""
    sensor = residuals["sensor"].to_numpy()
    own = sensor[:, None] == np.arange(sensor.max() + 1)
    errors = [own * residuals[name].to_numpy()[:, None] for name in ("sideways", "ahead")]
    design = np.column_stack([residuals["outward"], *errors])
    excess = residuals["excess"].to_numpy()
    keep: NDArray[np.bool_] = np.ones(len(design), dtype=np.bool_)
    for _ in range(_ITERATIONS):
        found = np.linalg.lstsq(design[keep], excess[keep], rcond=None)[0]
        keep = np.abs(excess - design @ found) < _TRIMMED
    return Fit(
        float(found[0]),
        found[1 : 1 + own.shape[1]],
        _bounds(design[keep], excess[keep], residuals["time"].to_numpy()[keep]),
        _left(design[keep], excess[keep]),
        _left(design[keep, 1:], excess[keep]),
        excess - design[:, 1:] @ found[1:],
        keep,
    )


def _left(design: Array, excess: Array) -> float:
    """The RMS residual of a least-squares fit."""
    found = np.linalg.lstsq(design, excess, rcond=None)[0]
    return float(np.sqrt(np.mean((excess - design @ found) ** 2)))


def _bounds(design: Array, excess: Array, times: Array) -> Array:
    """The interval (2,) of the first parameter."""
    second = np.unique(np.floor(times - times[0]), return_inverse=True)[1]
    parts = [second == s for s in range(second.max() + 1)]
    squares = [design[own].T @ design[own] for own in parts]
    products = [design[own].T @ excess[own] for own in parts]

    def refit(squares: Array, products: Array) -> Array:
        found = np.linalg.lstsq(squares.sum(axis=0), products.sum(axis=0), rcond=None)[0]
        return np.asarray(found[:1])

    return block_bootstrap(refit, [squares, products], 1, np.random.default_rng(0))[:, 0]


def fit_scenes(sources: Mapping[str, Source]) -> dict[str, Any]:
    """Prediction time (s) and corrections of the mounting angles (deg), scene by scene."""
    found = {}
    for name in SCENES:
        fit = fit_turning(doppler_residuals(load_stated(sources[name])))
        degrees = np.rad2deg(fit.mountings).tolist()
        found[name] = {"prediction_time": fit.time, "mounting_errors": degrees}
    return found


def scene_cells(name: str, residuals: pd.DataFrame, found: Fit) -> tuple[str, ...]:
    """The line of a scene in the table."""
    lowest, highest = np.rad2deg([residuals["turning"].min(), residuals["turning"].max()])
    low, high = MILLI * found.bounds
    return (
        name.removeprefix("scene-"),
        f"{round(lowest):+d} to {round(highest):+d}",
        f"{residuals['outward'].max():.1f}",
        f"{MILLI * found.time:.0f} [{low:.0f}, {high:.0f}]",
        f"{found.rms_without:.3f} → {found.rms:.3f}",
    )


def medians(by: pd.Series, values: pd.Series, edges: Array) -> tuple[Array, Array]:
    """Medians (m,) of both in the bins that hold enough."""
    both = pd.DataFrame({"by": by, "value": values}).groupby(np.digitize(by, edges))
    found = both.median()[(both.size() >= FEW) & both.size().index.isin(range(1, len(edges)))]
    return found["by"].to_numpy(), found["value"].to_numpy()


def draw(scenes: Mapping[str, tuple[pd.DataFrame, Fit]], path: Path) -> None:
    """Draw medians of the excess by yaw rate and by range, and what the extrapolation predicts."""
    use_style()
    figure, axes = plt.subplots(2, figsize=(5.5, 6.2))
    for (name, (residuals, found)), color, mark in zip(scenes.items(), OTHERS, "oDs", strict=False):
        seen = residuals.assign(excess=found.corrected)[found.keep]
        look: dict[str, Any] = {"color": color, "marker": mark, "ls": "", "ms": 4.5}
        rates, excess = medians(seen["turning"], MILLI * seen["excess"] / seen["distance"], RATES)
        axes[0].plot(np.rad2deg(rates), excess, label=name.removeprefix("scene-"), **look)
        fast = seen[np.abs(seen["turning"]) > FAST]
        ranges, excess = medians(fast["distance"], fast["excess"] / fast["turning"] ** 2, RANGES)
        axes[1].plot(ranges, excess, **look)
    rates, ranges = np.linspace(-0.5, 0.5), np.array([0.0, 90.0])
    axes[0].plot(np.rad2deg(rates), CYCLE * rates**2, **TRUTH, label=f"ω² r · {CYCLE:g} ms")
    axes[1].plot(ranges, CYCLE / MILLI * ranges, **TRUTH)
    axes[0].set(title="excess / range (10⁻³/s)", xlabel="yaw rate (°/s)")
    axes[1].set(title="excess / ω² (m s)", xlabel="range (m)")
    letter_panels(axes)
    axes[0].legend(loc="upper center", labelcolor="linecolor")
    headline(figure, "The radars report the velocity of half a cycle later")
    figure.savefig(path, dpi=244, metadata={"Software": None})
    plt.close(figure)


def write(sources: Mapping[str, Sequence[Source]]) -> None:
    """Write the table and the figure of scenes of nuScenes."""
    scenes = {}
    for source in sorted(sources["nuScenes"], key=lambda source: source.name):
        residuals = doppler_residuals(load_stated(source))
        scenes[source.name] = residuals, fit_turning(residuals)
    head = ("scene", "ω, °/s", "ω² r up to, m/s²", "time, ms", "RMS residual, m/s")
    lines = [scene_cells(name, *found) for name, found in scenes.items()]
    command = "d2d.study.road extrapolation"
    write_page("extrapolation.md", command, [markdown(head, lines)])
    turning = {n: found for n, found in scenes.items() if found[0]["turning"].abs().max() > TURNS}
    draw(turning, results_path("extrapolation.png"))
