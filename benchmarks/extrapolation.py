"""Radars that report too large Doppler velocities in turns: by how much, and what it could be.

python -m benchmarks.extrapolation ROOT ...

writes the tables and the figure of the book's page, from all scenes of nuScenes roots; those of one
car (`SCENES`) must be among them.

What the Doppler velocities of static targets exceed those that the reference predicts is fitted by
least squares, all radars together.  In every scene each radar has an error of its mounting angle
and of its speed beside what is looked for (`d2d.study.recordings.turning`).  Intervals contain 95 %
of what is found when whole seconds are drawn anew.
"""

import argparse
import inspect
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import scipy
from numpy.typing import NDArray

from benchmarks.report import table
from benchmarks.road import HORIZON
from benchmarks.run import in_one_thread
from d2d import block_bootstrap
from d2d.radar import Recording, Track, Tracker, compare, load_nuscenes
from d2d.study.book.grammar import OTHERS, TRUTH
from d2d.study.book.style import letter_panels, use_style
from d2d.study.recordings.road import joint_reference, judged, scores
from d2d.study.recordings.road import scenes as scenes_of
from d2d.study.recordings.turning import (
    CHANNELS,
    SCENES,
    Residuals,
    doppler_residuals,
    load_stated,
    own_errors,
    trimmed_fit,
)
from d2d.study.results import results_path

Array = NDArray[np.float64]
Columns = Callable[[Residuals], Array]  # (n, k): what may be in the Doppler velocities

MILLI = 1e3
TURNS = np.deg2rad(10.0)  # rad/s: a scene whose yaw rate is larger once tells something
FAST = np.deg2rad(18.0)  # rad/s, for the figure's second panel
RATES = np.deg2rad(np.arange(-30.0, 31.0, 3.0))  # rad/s, edges of the figure's bins
RANGES = np.array([0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 65.0, 80.0, 100.0])  # m
FEW = 100  # targets that a point of the figure needs
CYCLE = 37.5  # ms, half a cycle of the radars
ITERATIONS = 50


# ---- What may be in the Doppler velocities


def outward(r: Residuals) -> Array:
    """Half a cycle of the rotation, projected on a line of sight that has turned: omega^2 r."""
    return r.outward[:, None]


def nothing(r: Residuals) -> Array:
    """No column."""
    return np.empty((len(r.excess), 0))


def across(r: Residuals) -> Array:
    """The same of the sensor's own velocity u across the line of sight: omega u and u^2 / r."""
    return np.column_stack([r.turning * r.across, r.across**2 / r.distance])


def each(r: Residuals, column: Array) -> Array:
    """A column of each radar's own."""
    return np.asarray((r.sensor[:, None] == np.arange(len(CHANNELS))) * column[:, None])


def yaw_rate(r: Residuals) -> Array:
    """The reference's yaw rate is wrong by a factor."""
    return (r.turning * r.gain[:, 2])[:, None]


def lever_arms(r: Residuals) -> Array:
    """Each radar is mounted elsewhere."""
    return np.column_stack([each(r, r.turning * r.gain[:, k]) for k in (0, 1)])


def time_stamps(r: Residuals) -> Array:
    """Each radar's clock is off."""
    return each(r, r.change)


def by_radar(r: Residuals) -> Array:
    """omega^2 r of each radar."""
    return each(r, r.outward)


def together(*parts: Columns) -> Columns:
    """Several at once."""
    return lambda r: np.column_stack([part(r) for part in parts])


OTHERWISE = yaw_rate, lever_arms, time_stamps
ALL_OTHERS = together(*OTHERWISE)


# ---- Fits


class Fitted(NamedTuple):
    """Parameters (k,) with the bounds (2, k) of their intervals."""

    values: Array
    bounds: Array

    def told(self, k: int, digits: int) -> str:
        """A parameter with its interval."""
        value, (low, high) = self.values[k], self.bounds[:, k]
        return f"{value:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"

    def scaled(self, factor: float) -> "Fitted":
        """In another unit."""
        return Fitted(factor * self.values, factor * self.bounds)


def solved(design: Array, excess: Array, times: Array, count: int) -> Fitted:
    """The first parameters of a trimmed fit; the intervals are of what is not cut off."""
    parameters, keep = trimmed_fit(design, excess)
    design, excess = design[keep], excess[keep]
    second = np.unique(np.floor(times[keep]), return_inverse=True)[1]
    parts = [second == s for s in range(second.max() + 1)]
    squares = [design[own].T @ design[own] for own in parts]
    products = [design[own].T @ excess[own] for own in parts]

    def refitted(squares: Array, products: Array) -> Array:
        found = np.linalg.lstsq(squares.sum(axis=0), products.sum(axis=0), rcond=None)[0]
        return np.asarray(found[:count])

    rng = np.random.default_rng(0)
    bounds = block_bootstrap(refitted, [squares, products], 1, rng)
    return Fitted(parameters[:count], bounds)


def fitted(scenes: Sequence[Residuals], columns: Columns) -> Fitted:
    """What the columns are in all scenes, while each scene has its own errors of the radars."""
    wanted = np.concatenate([columns(r) for r in scenes])
    design = np.column_stack([wanted, scipy.linalg.block_diag(*map(own_errors, scenes))])
    # scenes have no second in common, as some have the same times
    times = np.concatenate([r.time - r.time[0] + 1e3 * i for i, r in enumerate(scenes)])
    excess = np.concatenate([r.excess for r in scenes])
    return solved(design, excess, times, wanted.shape[1])


def mean_squares(r: Residuals, wanted: Sequence[Columns]) -> list[float]:
    """What is left with each alone, of the targets that a fit of all alternatives keeps."""
    own = own_errors(r)
    _, keep = trimmed_fit(np.column_stack([own, outward(r), ALL_OTHERS(r)]), r.excess)
    found = []
    for columns in wanted:
        design = np.column_stack([own, columns(r)])[keep]
        solution = np.linalg.lstsq(design, r.excess[keep], rcond=None)[0]
        found.append(float(np.mean((r.excess[keep] - design @ solution) ** 2)))
    return found


def explained(r: Residuals) -> list[float]:
    """By how much each of `OTHERWISE` alone makes it smaller, over what omega^2 r does."""
    without, with_it, *others = mean_squares(r, [nothing, outward, *OTHERWISE])
    return [(without - other) / (without - with_it) for other in others]


def powers(r: Residuals) -> Fitted:
    """The p and q of an excess that is proportional to abs(omega)^p r^q.

    By Gauss and Newton's steps; the intervals are those of the last one.
    """
    rate = np.maximum(np.abs(r.turning) / np.abs(r.turning).max(), 1e-9)
    distance = r.distance / r.distance.mean()
    own = own_errors(r)
    largest = np.max(r.turning**2) * r.distance.mean()
    at = np.array([fitted([r], outward).values[0] * largest, 2.0, 1.0])
    for _ in range(ITERATIONS):
        shape = rate ** at[1] * distance ** at[2]
        slopes = at[0] * shape[:, None] * np.log(np.column_stack([rate, distance]))
        step = solved(np.column_stack([shape, slopes, own]), r.excess - at[0] * shape, r.time, 3)
        at = at + np.clip(step.values, -0.3, 0.3)
        if np.abs(step.values).max() < 1e-4:
            break
    return Fitted(at[1:], at[1:] + step.bounds[:, 1:])


# ---- What it does to those who do not know it


def tracked_alone(raw: Sequence[Recording]) -> Track:
    """A track whose scans are corrected as they come, with the yaw rate that it last gave."""
    time = inspect.signature(load_nuscenes).parameters["prediction_time"].default
    mountings = {str(s): recording.mounting for s, recording in enumerate(raw)}
    tracker = Tracker(mountings, horizon=HORIZON, budget=raw[0].budget)
    scans = [(str(s), scan) for s, recording in enumerate(raw) for scan in recording.scans]
    rate = 0.0
    for sensor, scan in sorted(scans, key=lambda entry: entry[1].time):
        corrected = replace(scan, doppler=scan.doppler - time * rate**2 * scan.range)
        for estimate in tracker.add(sensor, corrected):
            rate = float(estimate.theta[2])
    tracker.finish()
    return tracker.track


def effect(root: Path, scene: str) -> list[dict[str, Any]]:
    """Scores of all radars' estimates without the correction, with it, and with it by themselves.

    The reader takes the yaw rate of the reference; by themselves the radars take their own.
    """
    raw, read = (
        [load_nuscenes(root, scene, channel, **options) for channel in CHANNELS]
        for options in ({"prediction_time": 0.0}, {})
    )
    found = [judged(each, horizon=HORIZON, budget=each[0].budget) for each in (raw, read)]
    found.append(compare(tracked_alone(raw), joint_reference(raw)))
    return [scores(each) for each in found]


# ---- Tables


def short(scene: str) -> str:
    """The number of a scene."""
    return scene.removeprefix("scene-")


def turning_scenes(scenes: dict[str, Residuals]) -> dict[str, Residuals]:
    """Those in which a car turns enough."""
    return {name: r for name, r in scenes.items() if np.abs(r.turning).max() > TURNS}


def apart(scenes: dict[str, Residuals]) -> str:
    """The time of each scene."""
    lines = []
    for name, r in scenes.items():
        fit = fitted([r], outward)
        left = np.sqrt(mean_squares(r, [nothing, outward]))
        lowest, highest = np.rad2deg([r.turning.min(), r.turning.max()])
        lines.append(
            (
                *(
                    short(name),
                    f"{round(lowest):+d} to {round(highest):+d}",
                    f"{r.outward.max():.1f}",
                ),
                fit.scaled(MILLI).told(0, 0),
                " → ".join(f"{rms:.3f}" for rms in left),
            )
        )
    head = ("scene", "ω, °/s", "ω² r up to, m/s²", "time, ms", "RMS residual, m/s")
    return table(head, lines, 1)


def alternatives(scenes: dict[str, Residuals]) -> str:
    """What else could explain the excess of each scene."""
    columns = []
    for r in scenes.values():
        exponents = powers(r)
        levers = np.abs(fitted([r], lever_arms).values).max()
        scale, arms, clocks = (f"{share:.0%}" for share in explained(r))
        beside = fitted([r], together(outward, ALL_OTHERS)).scaled(MILLI)
        columns.append(
            (
                *(exponents.told(k, 2) for k in range(2)),
                *(scale, arms, f"{levers:.1f}", clocks),
                beside.told(0, 0),
            )
        )
    rows = (
        *("power of ω", "power of r"),
        *("a factor on the reference's ω explains", "lever arms of all radars explain"),
        *("and would be off by up to, m", "clocks of all radars explain"),
        "time with all three fitted beside it, ms",
    )
    lines = [(name, *cells) for name, *cells in zip(rows, *columns, strict=True)]
    return table(("", *map(short, scenes)), lines, 1)


def terms(scenes: Sequence[Residuals]) -> str:
    """The terms that explanations predict, and those of one car's scenes."""
    once, twice, none = f"{CYCLE:g}", f"{2.0 * CYCLE:g}", "0"
    lines = [
        ("predicted straight ahead, place and velocity", once, once, none),
        ("predicted straight ahead, velocity only", once, twice, once),
        ("azimuth older than the velocity", none, once, once),
        ("rotation compensated half a cycle off", once, none, none),
    ]
    stated = fitted(scenes, together(outward, across))
    free = fitted(scenes, together(outward, across, lever_arms, time_stamps))
    levers = np.abs(free.values[3 : 3 + 2 * len(CHANNELS)]).max()
    for name, fit in (
        ("measured, all else as stated", stated),
        (f"measured, with lever arms up to {levers:.1f} m off, and clocks", free),
    ):
        lines.append((name, *(fit.scaled(MILLI).told(k, 0) for k in range(3))))
    return table(("in ms", "ω² r", "ω u", "u² / r"), lines, 1)


def radars(scenes: Sequence[Residuals]) -> str:
    """The time of each radar."""
    fits = [
        fitted(scenes, columns).scaled(MILLI)
        for columns in (by_radar, together(by_radar, across, lever_arms, time_stamps))
    ]
    lines = [
        (channel.removeprefix("RADAR_").replace("_", " ").lower(), *(f.told(k, 0) for f in fits))
        for k, channel in enumerate(CHANNELS)
    ]
    return table(("radar", "time, ms", "all other terms fitted, too"), lines, 1)


def effects(found: dict[str, list[dict[str, Any]]]) -> str:
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
    return table(head, lines, 1)


# ---- The figure


def draw(scenes: dict[str, Residuals], path: Path) -> None:
    """Medians of the excess by yaw rate and by range, and what the extrapolation predicts."""
    matplotlib.use("Agg")
    use_style()
    figure, axes = plt.subplots(2, figsize=(5.0, 6.4))
    for (name, r), color, mark in zip(scenes.items(), OTHERS, "oDs", strict=False):
        design = np.column_stack([outward(r), own_errors(r)])
        parameters, keep = trimmed_fit(design, r.excess)
        excess = (r.excess - design[:, 1:] @ parameters[1:])[keep]
        rate, distance = r.turning[keep], r.distance[keep]
        fast = np.abs(rate) > FAST
        look: dict[str, Any] = {"color": color, "marker": mark, "ls": "", "ms": 4.5}
        per_metre = medians(rate, excess / distance, RATES)
        axes[0].plot(np.rad2deg(per_metre[0]), MILLI * per_metre[1], label=short(name), **look)
        if fast.any():
            per_square = medians(distance[fast], (excess / rate**2)[fast], RANGES)
            axes[1].plot(*per_square, **look)
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


def medians(by: Array, values: Array, edges: Array) -> tuple[Array, Array]:
    """Medians (m,) of both in the bins that hold enough."""
    place = np.digitize(by, edges)
    bins = [place == b for b in range(1, len(edges)) if (place == b).sum() >= FEW]
    return np.array([np.median(by[b]) for b in bins]), np.array(
        [np.median(values[b]) for b in bins]
    )


def main() -> None:
    """Write the tables and the figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("roots", type=Path, nargs="+", metavar="ROOT")
    arguments = parser.parse_args()
    in_one_thread()
    warnings.simplefilter("ignore")
    roots = {scene: root for root, scene in scenes_of(arguments.roots)}
    scenes = {each: doppler_residuals(load_stated(roots[each], each)) for each in sorted(roots)}
    turning = turning_scenes(scenes)
    one_car = [turning[name] for name in SCENES]
    parts = {
        "apart": apart(scenes),
        "alternatives": alternatives(turning),
        "terms": terms(one_car),
        "radars": radars(one_car),
        "effects": effects({name: effect(roots[name], name) for name in scenes}),
    }
    for name, text in parts.items():
        print(f"{name}\n{text}\n", flush=True)
        head = "<!-- Written by `python -m benchmarks.extrapolation`. -->"
        path = results_path(f"extrapolation_{name}.md")
        path.write_text(f"{head}\n\n{text}\n", encoding="utf-8")
    draw(turning, results_path("extrapolation.png"))


if __name__ == "__main__":
    main()
