"""Radars that report too large Doppler velocities in turns: by how much, and what it could be.

By how much the Doppler velocities of static targets exceed those that the reference predicts is
fitted by least squares, all radars together.  In every scene each radar has an error of its
mounting angle and of its speed beside the effect that is looked for (`d2d.study.road.turning`).
Intervals contain 95 % of the values that are found when whole seconds are drawn anew.
"""

import inspect
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import scipy

from d2d import block_bootstrap
from d2d._types import Array
from d2d.radar import Track, Tracker, compare, load_nuscenes
from d2d.study.book.grammar import OTHERS, TRUTH
from d2d.study.book.style import letter_panels, use_style
from d2d.study.results import results_path
from d2d.study.road.drive import CHANNELS, HORIZON, Drive, Source
from d2d.study.road.markdown import markdown, write_page
from d2d.study.road.scores import scores
from d2d.study.road.turning import (
    SCENES,
    doppler_residuals,
    load_stated,
    mounting_errors,
    per_sensor,
    trimmed_fit,
)

MILLI = 1e3
TURNS = np.deg2rad(10.0)  # rad/s: a scene in which the yaw rate never gets larger tells nothing
FAST = np.deg2rad(18.0)  # rad/s, for the figure's second panel
RATES = np.deg2rad(np.arange(-30.0, 31.0, 3.0))  # rad/s, edges of the figure's bins
RANGES = np.array([0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 65.0, 80.0, 100.0])  # m
FEW = 100  # targets that a point of the figure needs
CYCLE = 37.5  # ms, half a cycle of the radars
ITERATIONS = 50

# Columns that may explain the excess, by name.  Half a cycle of the rotation, projected on a line
# of sight that has turned, is omega^2 r; of the sensor's own velocity u across the line of sight it
# is omega u and u^2 / r.
OUTWARD = ("outward",)
ACROSS = ("omega u", "u^2 / r")
# The yaw rate of the reference may be wrong by a factor, each radar mounted elsewhere, or its
# clock be off.
OTHERWISE = (("yaw rate",), ("lever arms",), ("clocks",))
ALL_OTHERS = ("yaw rate", "lever arms", "clocks")


def columns(r: pd.DataFrame, names: Sequence[str]) -> Array:
    """The columns (n, k) of these names."""
    known: dict[str, Any] = {
        "outward": r["outward"],
        "omega u": r["turning"] * r["across"],
        "u^2 / r": r["across"] ** 2 / r["distance"],
        "yaw rate": r["turning"] * r["gain_w"],
        "lever arms": np.column_stack(
            [r["turning"].to_numpy()[:, None] * per_sensor(r, f"gain_{k}") for k in "xy"]
        ),
        "clocks": per_sensor(r, "change"),
        "outward by radar": per_sensor(r, "outward"),
    }
    return np.column_stack([np.empty((len(r), 0)), *(known[name] for name in names)])


# ---- Fits


class Fit(NamedTuple):
    """Parameters (k,) with the bounds (2, k) of their intervals."""

    values: Array
    bounds: Array

    def cell(self, k: int, digits: int = 0, factor: float = MILLI) -> str:
        """A parameter, in a unit that is smaller by a factor, with its interval."""
        value, (low, high) = factor * self.values[k], factor * self.bounds[:, k]
        return f"{value:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"


def solve(design: Array, excess: Array, times: Array, count: int) -> Fit:
    """The first parameters of a trimmed fit; the intervals are of the targets that it keeps."""
    parameters, keep = trimmed_fit(design, excess)
    design, excess = design[keep], excess[keep]
    second = np.unique(np.floor(times[keep]), return_inverse=True)[1]
    parts = [second == s for s in range(second.max() + 1)]
    squares = [design[own].T @ design[own] for own in parts]
    products = [design[own].T @ excess[own] for own in parts]

    def refit(squares: Array, products: Array) -> Array:
        found = np.linalg.lstsq(squares.sum(axis=0), products.sum(axis=0), rcond=None)[0]
        return np.asarray(found[:count])

    bounds = block_bootstrap(refit, [squares, products], 1, np.random.default_rng(0))
    return Fit(parameters[:count], bounds)


def fit(tables: Sequence[pd.DataFrame], names: Sequence[str]) -> Fit:
    """The columns' factors in all scenes, while each scene has its own errors of the radars."""
    wanted = np.concatenate([columns(r, names) for r in tables])
    design = np.column_stack([wanted, scipy.linalg.block_diag(*map(mounting_errors, tables))])
    # scenes have no second in common, as some have the same times
    times = np.concatenate([r["time"] - r["time"][0] + 1e3 * i for i, r in enumerate(tables)])
    excess = np.concatenate([r["excess"] for r in tables])
    return solve(design, excess, times, wanted.shape[1])


def mean_squares(r: pd.DataFrame, wanted: Sequence[Sequence[str]]) -> list[float]:
    """The mean square that is left with each alone, of the targets that a fit of all keeps."""
    own, excess = mounting_errors(r), r["excess"].to_numpy()
    _, keep = trimmed_fit(np.column_stack([own, columns(r, OUTWARD + ALL_OTHERS)]), excess)
    found = []
    for names in wanted:
        design = np.column_stack([own, columns(r, names)])[keep]
        solution = np.linalg.lstsq(design, excess[keep], rcond=None)[0]
        found.append(float(np.mean((excess[keep] - design @ solution) ** 2)))
    return found


def explained(r: pd.DataFrame) -> list[float]:
    """By how much each of `OTHERWISE` alone makes it smaller, over what omega^2 r does."""
    without, with_it, *others = mean_squares(r, [(), OUTWARD, *OTHERWISE])
    return [(without - other) / (without - with_it) for other in others]


def powers(r: pd.DataFrame) -> Fit:
    """The p and q of an excess that is proportional to abs(omega)^p r^q.

    By Gauss and Newton's steps; the intervals are those of the last one.
    """
    turning, distance, excess, time = (
        r[name].to_numpy() for name in ("turning", "distance", "excess", "time")
    )
    rate = np.maximum(np.abs(turning) / np.abs(turning).max(), 1e-9)
    distance, mean = distance / distance.mean(), distance.mean()
    own = mounting_errors(r)
    at = np.array([fit([r], OUTWARD).values[0] * np.max(turning**2) * mean, 2.0, 1.0])
    for _ in range(ITERATIONS):
        shape = rate ** at[1] * distance ** at[2]
        slopes = at[0] * shape[:, None] * np.log(np.column_stack([rate, distance]))
        step = solve(np.column_stack([shape, slopes, own]), excess - at[0] * shape, time, 3)
        at = at + np.clip(step.values, -0.3, 0.3)
        if np.abs(step.values).max() < 1e-4:
            break
    return Fit(at[1:], at[1:] + step.bounds[:, 1:])


# ---- The effect on those who do not know it


def track_alone(raw: Drive) -> Track:
    """A track whose scans are corrected as they come, with the yaw rate that it last gave."""
    time = inspect.signature(load_nuscenes).parameters["prediction_time"].default
    mountings = {str(s): recording.mounting for s, recording in enumerate(raw.recordings)}
    tracker = Tracker(mountings, horizon=HORIZON, budget=raw.budget)
    rate = 0.0
    for sensor, scan in raw.in_time_order():
        corrected = replace(scan, doppler=scan.doppler - time * rate**2 * scan.range)
        for estimate in tracker.add(sensor, corrected):
            rate = float(estimate.theta[2])
    tracker.finish()
    return tracker.track


def effect(source: Source) -> list[dict[str, Any]]:
    """Scores of all radars' estimates without the correction, with it, and with it by themselves.

    The reader takes the yaw rate of the reference; by themselves the radars take their own.
    """
    raw, read = source.load(prediction_time=0.0), source.load()
    found = [drive.compare(horizon=HORIZON, budget=drive.budget) for drive in (raw, read)]
    found.append(compare(track_alone(raw), raw.reference))
    return [scores(each) for each in found]


# ---- Tables


def short(scene: str) -> str:
    """The number of a scene."""
    return scene.removeprefix("scene-")


def scenes_apart(scenes: Mapping[str, pd.DataFrame]) -> str:
    """The time of each scene."""
    lines = []
    for name, r in scenes.items():
        left = np.sqrt(mean_squares(r, [(), OUTWARD]))
        lowest, highest = np.rad2deg([r["turning"].min(), r["turning"].max()])
        rates = f"{round(lowest):+d} to {round(highest):+d}"
        rms = " → ".join(f"{each:.3f}" for each in left)
        time = fit([r], OUTWARD).cell(0)
        lines.append((short(name), rates, f"{r['outward'].max():.1f}", time, rms))
    head = ("scene", "ω, °/s", "ω² r up to, m/s²", "time, ms", "RMS residual, m/s")
    return markdown(head, lines)


def alternatives(scenes: Mapping[str, pd.DataFrame]) -> str:
    """Other explanations of the excess of each scene."""
    cells = []
    for r in scenes.values():
        exponents = powers(r)
        levers = np.abs(fit([r], ("lever arms",)).values).max()
        scale, arms, clocks = (f"{share:.0%}" for share in explained(r))
        beside = fit([r], OUTWARD + ALL_OTHERS).cell(0)
        both = (exponents.cell(k, 2, factor=1.0) for k in range(2))
        cells.append((*both, scale, arms, f"{levers:.1f}", clocks, beside))
    rows = (
        *("power of ω", "power of r"),
        *("a factor on the reference's ω explains", "lever arms of all radars explain"),
        *("and would be off by up to, m", "clocks of all radars explain"),
        "time with all three fitted beside it, ms",
    )
    return markdown(("", *map(short, scenes)), [*zip(rows, *cells, strict=True)])


def terms(scenes: Sequence[pd.DataFrame]) -> str:
    """The terms that explanations predict, and those of one car's scenes."""
    once, twice, none = f"{CYCLE:g}", f"{2.0 * CYCLE:g}", "0"
    stated = fit(scenes, OUTWARD + ACROSS)
    free = fit(scenes, (*OUTWARD, *ACROSS, "lever arms", "clocks"))
    levers = np.abs(free.values[3 : 3 + 2 * len(CHANNELS)]).max()
    measured = {
        "measured, all else as stated": stated,
        f"measured, with lever arms up to {levers:.1f} m off, and clocks": free,
    }
    lines = [
        ("predicted straight ahead, place and velocity", once, once, none),
        ("predicted straight ahead, velocity only", once, twice, once),
        ("azimuth older than the velocity", none, once, once),
        ("rotation compensated half a cycle off", once, none, none),
        *((name, *(found.cell(k) for k in range(3))) for name, found in measured.items()),
    ]
    return markdown(("in ms", "ω² r", "ω u", "u² / r"), lines)


def radars(scenes: Sequence[pd.DataFrame]) -> str:
    """The time of each radar."""
    alone = ("outward by radar",)
    fits = [fit(scenes, names) for names in (alone, (*alone, *ACROSS, "lever arms", "clocks"))]
    lines = [
        (channel.removeprefix("RADAR_").replace("_", " ").lower(), *(each.cell(k) for each in fits))
        for k, channel in enumerate(CHANNELS)
    ]
    return markdown(("radar", "time, ms", "all other terms fitted, too"), lines)


def effects(found: Mapping[str, list[dict[str, Any]]]) -> str:
    """Errors of the estimates without the correction, with it, and with it by themselves."""
    lines = []
    for name, ways in found.items():
        cells = [
            [f"{own['rmse'][k]:.{digits}f}" for k, digits in ((0, 3), (1, 3), (2, 2))]
            + [f"{own['anees']:.2f}", f"{own['inside']:.0%}"]
            for own in ways
        ]
        lines.append((short(name), *(" → ".join(each) for each in zip(*cells, strict=True))))
    head = ("scene", "v_x, m/s", "v_y, m/s", "ω, °/s", "ANEES", "inside 95 %")
    return markdown(head, lines)


# ---- The figure


def draw(scenes: Mapping[str, pd.DataFrame], path: Path) -> None:
    """Medians of the excess by yaw rate and by range, and what the extrapolation predicts."""
    use_style()
    figure, axes = plt.subplots(2, figsize=(5.0, 6.4))
    for (name, r), color, mark in zip(scenes.items(), OTHERS, "oDs", strict=False):
        design = np.column_stack([columns(r, OUTWARD), mounting_errors(r)])
        parameters, keep = trimmed_fit(design, r["excess"].to_numpy())
        seen = r.assign(excess=r["excess"] - design[:, 1:] @ parameters[1:])[keep]
        look: dict[str, Any] = {"color": color, "marker": mark, "ls": "", "ms": 4.5}
        per_metre = seen["excess"] / seen["distance"]
        rates, excess = medians(seen["turning"], MILLI * per_metre, RATES)
        axes[0].plot(np.rad2deg(rates), excess, label=short(name), **look)
        fast = seen[np.abs(seen["turning"]) > FAST]
        axes[1].plot(
            *medians(fast["distance"], fast["excess"] / fast["turning"] ** 2, RANGES), **look
        )
    rates, ranges = np.linspace(-0.5, 0.5), np.array([0.0, 90.0])
    label = f"ω² r times {CYCLE:g} ms"
    axes[0].plot(np.rad2deg(rates), CYCLE * rates**2, label=label, **TRUTH)
    axes[1].plot(ranges, CYCLE / MILLI * ranges, **TRUTH)
    axes[0].set(title="excess / range (10⁻³/s)", xlabel="yaw rate (°/s)")
    axes[1].set(title="excess / ω² (m s)", xlabel="range (m)")
    letter_panels(axes)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    figure.savefig(path, dpi=110, bbox_inches="tight", metadata={"Software": None})
    plt.close(figure)


def medians(by: pd.Series, values: pd.Series, edges: Array) -> tuple[Array, Array]:
    """Medians (m,) of both in the bins that hold enough."""
    both = pd.DataFrame({"by": by, "value": values}).groupby(np.digitize(by, edges))
    found = both.median()[(both.size() >= FEW) & both.size().index.isin(range(1, len(edges)))]
    return found["by"].to_numpy(), found["value"].to_numpy()


def write(sources: Mapping[str, Sequence[Source]]) -> None:
    """Write the tables and the figure, from scenes of nuScenes that include those of one car."""
    listed = sorted(sources["nuScenes"], key=lambda source: source.name)
    scenes = {source.name: doppler_residuals(load_stated(source)) for source in listed}
    turning = {name: r for name, r in scenes.items() if r["turning"].abs().max() > TURNS}
    one_car = [turning[name] for name in SCENES]
    parts = {
        "apart": scenes_apart(scenes),
        "alternatives": alternatives(turning),
        "terms": terms(one_car),
        "radars": radars(one_car),
        "effects": effects({source.name: effect(source) for source in listed}),
    }
    for name, text in parts.items():
        write_page(f"extrapolation_{name}.md", "d2d.study.road extrapolation", [text])
    draw(turning, results_path("extrapolation.png"))
