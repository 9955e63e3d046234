"""Which covariance holds on the road: all models fitted and judged alike, leave one drive out.

python -m benchmarks.protocol [--radarscenes ROOT ...] [--nuscenes ROOT ...]
    [--folder CACHE] [--jobs N] [--seconds S]

writes the tables into the book's page.  With ``--seconds`` only the first seconds of each drive are
taken and nothing is written.

The protocol, written down before it was run:

*Estimates.*  Causal, of all sensors that a cell has, horizon 0.3 s, default options.  Each is
carried to its time by the acceleration that the estimates before it show (`track` with an empty
budget).  Every model is given the same estimates, and those that `track` does not accept are left
out for all.  The inverse Hessian is that at the same optimum.  The carry has an error of its own,
D A D' with the delay D and the covariance A of the acceleration: it is added to the inverse Hessian
and to the propagated noise alike, and no factor multiplies it.

*Fit.*  The drives of a data set have the same sensors.  For each drive of it, the models are
fitted to all other drives, all sensors, all accepted estimates, with the same weight for each: two
RadarScenes drives, each fitted on the other; five nuScenes scenes, each fitted on the other four.
The criterion is the mean log score for all models.  Nothing is fitted in another cell, and nothing
of the drive that is judged takes part.  The two models with one factor and constants, and the
budget fitted like all others, with what it loses without one of its parts, were added after the
first run had been seen.  The length of the
dependence between neighbours is that of the stored budgets, 1 m: it is stated, not fitted.

Exceptions, which cannot be mended here: the stored budgets were fitted beforehand, on RadarScenes
105 and on nuScenes 0061 and 0103, and that of nuScenes was then widened by looking at 0916 and
1077; the readers' clocks, slip laws and corrections come from the same drives.  v_y of RadarScenes
is judged by a slip law that was fitted with these radars.  The references are odometries, whose
errors count as errors of the estimates.

*Cells.*  All sensors; the front radar alone (RadarScenes 3, RADAR_FRONT); a side radar alone
(RadarScenes 1, RADAR_FRONT_LEFT); 40 and 15 targets of each scan, drawn at random; a silence: in
the last three of every five seconds one sensor is off, each in turn, and only these times are
judged.  A side radar alone beside traffic sometimes follows the traffic, as an estimate from 15
targets may.  No covariance is meant for that; judged without errors beyond 1 m/s or 15 deg/s, both
cells were the same to a tenth (that is not part of the protocol any more).  A drive with fewer than
20 estimates in a cell is left out of it.

*Measures.*  Log score (m/s, m/s, rad/s); ANEES, mean NEES / 3; mean squares of the whitened errors
of omega, v_y given omega, v_x given both; coverage of the 50, 95 and 99 % ellipsoids; the log score
less that of noise + 3 constants.  On RadarScenes both drives are given, with 95 % intervals by the
block bootstrap; two drives have no interval.  On nuScenes it is the mean of the five drives with
the 95 % interval of Student's t.
"""

import argparse
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import joblib
import matplotlib.pyplot as plt
import numpy as np
import scipy
from numpy.typing import NDArray

from benchmarks import road
from benchmarks.covariances import (
    ABLATIONS,
    BUDGET,
    CAUSES,
    CONSTANTS,
    MODELS,
    Array,
    Estimates,
    Parameters,
)
from benchmarks.report import table
from benchmarks.run import in_one_thread
from d2d import block_bootstrap, log_score
from d2d.problem import Estimate, Problem
from d2d.radar import Comparison, ErrorBudget, RadarScan, Recording, VehicleLimits
from d2d.radar.motion.covariance import apply_budget
from d2d.radar.motion.doppler import Acceleration
from d2d.radar.motion.model import split_options
from d2d.radar.readers.nuscenes import NUSCENES_BUDGET
from d2d.radar.readers.radarscenes import RADARSCENES_BUDGET
from d2d.radar.tracks.estimator import OdometryEstimator
from d2d.radar.tracks.rounds import Round, rounds_of
from d2d.study.book.grammar import BLACK, GREY, PURPLE, SKY
from d2d.study.book.style import letter_panels, use_style
from d2d.study.recordings.road import scenes, sequences
from d2d.study.results import results_path

Flags = NDArray[np.bool_]

SEED = 20
PERIOD, QUIET = 5.0, 3.0  # s: of these, the last ones are without a sensor
FEWEST = 20  # estimates of a drive in a cell, for less it is not judged there
ALL = "all"
FAIR = 0.7, 1.5  # an ANEES that is near enough to 1 for a model to count as right
LOWEST = 0.25  # ANEES, where the axis begins
LOADERS: dict[str, Callable[[Path, str], road.Drive]] = {
    "RadarScenes": road.radarscenes,
    "nuScenes": road.nuscenes,
}
ALL_MODELS = MODELS | ABLATIONS
STORED = {"RadarScenes": RADARSCENES_BUDGET, "nuScenes": NUSCENES_BUDGET}
# Places among the sensors.
ALONE = {"RadarScenes": {"front": 2, "side": 0}, "nuScenes": {"front": 0, "side": 1}}


class Cell(NamedTuple):
    """What is there to estimate with, and which estimates are judged."""

    alone: str | None = None  # the only sensor
    targets: int | None = None  # of each scan
    silence: bool = False


CELLS = {
    ALL: Cell(),
    "front": Cell(alone="front"),
    "side": Cell(alone="side"),
    "40 targets": Cell(targets=40),
    "15 targets": Cell(targets=15),
    "silence": Cell(silence=True),
}


# ---- Estimates


@dataclass
class Keeping(OdometryEstimator):
    """A follower that keeps what its last estimate came from."""

    by: Acceleration = field(init=False)
    kept: tuple[Problem, Estimate, Acceleration] = field(init=False)

    def _acceleration(self, current: Round) -> Acceleration:
        self.by = super()._acceleration(current)
        return self.by

    def _estimate(self, problem: Problem, views: Any) -> Estimate:
        found = super()._estimate(problem, views)
        self.kept = problem, found, self.by
        return found


class Found(NamedTuple):
    """The estimates of a drive that can be judged, and the share of the rounds that gave one."""

    estimates: Estimates
    share: float


def followed(rounds: Sequence[Round], budget: ErrorBudget) -> tuple[Estimates, Flags]:
    """The accepted estimates, whose errors are not known yet (nan), and which rounds they are of.

    All covariances are those at the same optimum, carried by the same acceleration.
    """
    model, scales = split_options({})
    sensors = 1 + max((each for current in rounds for each in current.sensors), default=0)
    follower = Keeping(model, scales, None, ErrorBudget(), VehicleLimits(), sensors, records=[])
    rows, accepted = [], np.zeros(len(rounds), dtype=np.bool_)
    for i, current in enumerate(rounds):
        estimate = follower.step(current)
        if not estimate.converged:
            continue
        accepted[i] = True
        assert follower.records
        raw, _ = follower.records[-1]
        problem, optimum, by = follower.kept
        near = optimum.theta  # on which neither parts nor slow errors depend
        parts = apply_budget(problem, optimum, current.pairs, budget, current.time, near).parts
        unit = replace(budget, azimuth=1.0, doppler=1.0, scale=1.0)
        slow = apply_budget(problem, optimum, current.pairs, unit, current.time, near).slow
        _, budgeted = raw._replace(parts=parts, lag=budget.lag).carried(by)
        noise = raw.parts.total
        carry = estimate.covariance - noise
        rows.append(
            (
                *(current.time, estimate.theta, np.full(3, np.nan)),
                *(optimum.covariance, noise, carry, budgeted.total, parts.dependence),
                effects_of(slow, by.value),
            )
        )
    columns = zip(*rows, strict=True) if rows else [()] * len(Estimates._fields)
    shapes = (-1,), (-1, 3), (-1, 3), *[(-1, 3, 3)] * 5, (-1, len(CAUSES), 3, 3)
    found = (np.array(c, float).reshape(shape) for c, shape in zip(columns, shapes, strict=True))
    return Estimates(*found), accepted


def effects_of(slow: Array, acceleration: Array) -> Array:
    """What a standard deviation of one of each cause adds to a covariance: (4, 3, 3)."""
    pairs = slow.shape[1] // 2 - 1  # each with an azimuth and a Doppler error; the slip is last
    each = slow[:, :pairs], slow[:, pairs : 2 * pairs], slow[:, 2 * pairs : -1]
    return np.array([columns @ columns.T for columns in (*each, acceleration[:, None])])


def thinned(scans: Sequence[RadarScan], targets: int, rng: np.random.Generator) -> list[RadarScan]:
    """The scans with at most so many targets each, drawn at random."""
    return [
        scan[np.sort(rng.choice(scan.size, targets, replace=False))]
        if scan.size > targets
        else scan
        for scan in scans
    ]


def is_quiet(times: Array, start: float, sensor: int, sensors: int) -> Flags:
    """Whether a sensor is off at the times (n,): each in turn, at the end of a period."""
    periods, rest = np.divmod(times - start, PERIOD)
    return np.asarray((rest >= PERIOD - QUIET) & (periods % sensors == sensor))


def changed(drive: road.Drive, cell: Cell, data_set: str) -> list[Recording]:
    """The recordings that a cell leaves of a drive."""
    own, start = drive.recordings, drive.rounds[0].time
    if cell.alone is not None:
        own = [own[ALONE[data_set][cell.alone]]]
    found = []
    for s, recording in enumerate(own):
        scans = list(recording.scans)
        if cell.targets is not None:
            scans = thinned(scans, cell.targets, np.random.default_rng([SEED, s]))
        if cell.silence:
            off = is_quiet(np.array([scan.time for scan in scans]), start, s, len(own))
            scans = [scan for scan, silent in zip(scans, off, strict=True) if not silent]
        found.append(replace(recording, scans=scans))
    return found


def estimated(drive: road.Drive, cell: Cell, data_set: str) -> Found:
    """The estimates of a cell."""
    recordings = changed(drive, cell, data_set)
    rounds = rounds_of([(own.scans, own.mounting) for own in recordings], 1, road.HORIZON)
    budget = recordings[0].budget
    assert budget is not None
    estimates, accepted = followed(rounds, budget)
    times = np.array([each.time for each in rounds])
    wanted: Flags = np.asarray(np.isfinite(drive.reference.at(times).theta).all(axis=1))
    if cell.silence:
        start, count = drive.rounds[0].time, len(recordings)
        wanted &= np.logical_or.reduce([is_quiet(times, start, s, count) for s in range(count)])
    errors = estimates.theta - drive.reference.at(estimates.times).theta
    judged = estimates._replace(errors=errors).where(wanted[accepted])
    return Found(judged, float(accepted[wanted].mean()))


def shortened(drive: road.Drive, seconds: float) -> road.Drive:
    """The first seconds of a drive."""
    end = drive.rounds[0].time + seconds
    own = [
        replace(each, scans=[scan for scan in each.scans if scan.time < end])
        for each in drive.recordings
    ]
    return road.Drive.of(drive.name, own)


def load_and_estimate(
    data_set: str, root: Path, name: str, cell: Cell, seconds: float | None
) -> Found:
    """The estimates of a cell from files: what a cache keeps."""
    warnings.simplefilter("ignore")
    drive = LOADERS[data_set](root, name)
    if seconds is not None:
        drive = shortened(drive, seconds)
    return estimated(drive, cell, data_set)


# ---- Fit and judgement


def fitted(drives: Mapping[str, Estimates]) -> dict[str, dict[str, Parameters]]:
    """The parameters of every model for each drive, fitted to all others."""
    found = {}
    for held_out in drives:
        others = [own for name, own in drives.items() if name != held_out]
        found[held_out] = {name: model.fit(others) for name, model in ALL_MODELS.items()}
    return found


def judged(found: Found, parameters: Mapping[str, Parameters], bounds: bool) -> dict[str, Any]:
    """The measures of every model on the estimates of a drive, with intervals if wanted."""
    own = found.estimates
    stated = {name: ALL_MODELS[name].covariances(given, own) for name, given in parameters.items()}
    peer = log_score(own.errors, stated[CONSTANTS])
    rows = {}
    for name, covariances in stated.items():
        seen = Comparison(own.times, own.errors, covariances, found.share, found.share)
        difference = log_score(own.errors, covariances) - peer
        measures = {
            "log score": seen.measures.log_score,
            "ANEES": seen.measures.anees,
            "whitened": seen.measures.whitened_squares,
            "coverage": seen.measures.coverage,
            "difference": difference.mean(),
        }
        if bounds:
            wide = seen.intervals()
            measures["intervals"] = {
                "log score": wide.log_score,
                "ANEES": wide.anees,
                "whitened": wide.whitened_squares,
                "coverage": wide.coverage,
                "difference": block_bootstrap(
                    np.mean, [difference], seen.block, np.random.default_rng(0), vectorized=True
                ),
            }
        rows[name] = measures
    counts = {"estimates": len(own.times), "independent": len(own.times) / seen.block}
    return counts | {"accepted": found.share, "models": rows}


def protocol(cells: Mapping[str, Mapping[str, Found]], bounds: bool) -> dict[str, Any]:
    """All of it for one data set, from the estimates by cell and drive."""
    parameters = fitted({name: found.estimates for name, found in cells[ALL].items()})
    results: dict[str, dict[str, Any]] = {}
    for cell, drives in cells.items():
        results[cell] = {}
        for name, found in drives.items():
            if len(found.estimates.times) >= FEWEST:
                results[cell][name] = judged(found, parameters[name], bounds)
    return {"fitted": parameters, "cells": results}


# ---- Tables


def over_drives(values: Sequence[Array]) -> tuple[Array, Array]:
    """The mean over some drives, and half the width of its 95 % interval by Student's t."""
    count = len(values)
    half = scipy.stats.t.ppf(0.975, count - 1) * np.std(values, axis=0, ddof=1) / np.sqrt(count)
    return np.mean(values, axis=0), half


def told(values: Sequence[float], digits: int) -> str:
    """Two drives one beside the other, more as their mean with its interval."""
    if len(values) < 3:
        return " / ".join(f"{np.round(value, digits) + 0.0:.{digits}f}" for value in values)
    mean, half = over_drives([np.asarray(value) for value in values])
    return f"{np.round(mean, digits) + 0.0:.{digits}f} (±{half:.{digits}f})"


def by_cell(
    results: Mapping[str, Any], models: Sequence[str], measure: str, beside: str = ""
) -> str:
    """A table of one measure: models by cells, or how much it is above that of one ``beside``."""
    cells = results["cells"]
    digits = 2 if len(results["fitted"]) == 2 or beside else 1  # beside an interval, on a phone
    lines = []
    for model in models:
        values = [
            [
                rows[model][measure] - (rows[beside][measure] if beside else 0.0)
                for rows in (each["models"] for each in drives.values())
            ]
            for drives in cells.values()
        ]
        lines.append((model, *(told(each, digits) for each in values)))
    heads = (cell.removesuffix(" targets") for cell in cells)  # narrow enough for a phone
    return table(("covariance", *heads), lines, 1)


def with_bounds(drives: Mapping[str, Any], model: str, measure: str, digits: int) -> str:
    """One measure of all sensors, with its interval on each of two drives."""
    rows = [each["models"][model] for each in drives.values()]
    if len(rows) > 2:
        return told([row[measure] for row in rows], digits)
    return " / ".join(
        f"{row[measure]:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"
        for row in rows
        for low, high in [row["intervals"][measure]]
    )


def by_direction(results: Mapping[str, Any]) -> str:
    """What all sensors show: squares by direction, and coverage in per cent."""
    drives = results["cells"][ALL]
    lines = []
    for model in MODELS:
        rows = [each["models"][model] for each in drives.values()]
        lines.append(
            (
                model,
                *(told([row["whitened"][k] for row in rows], 2) for k in range(3)),
                *(told([100.0 * row["coverage"][k] for row in rows], 0) for k in range(3)),
            )
        )
    return table(("covariance", "v_x", "v_y", "ω", "50 %", "95 %", "99 %"), lines, 1)


def intervals(results: Mapping[str, Any]) -> str:
    """What all sensors show: the ANEES, and the log score beside that of the constants."""
    drives = results["cells"][ALL]
    lines = [
        (model, *(with_bounds(drives, model, each, 2) for each in ("ANEES", "difference")))
        for model in MODELS
    ]
    return table(("covariance", "ANEES", "score less that of constants"), lines, 1)


def constants(results: Mapping[str, Any]) -> str:
    """The constants beside the noise that each drive is judged with, with standard errors."""
    unit, digits = np.array([1.0, 1.0, np.rad2deg(1.0)]), (3, 3, 2)
    lines = []
    for name, own in results["fitted"].items():
        found = own[CONSTANTS]
        columns = zip(found["constants"] * unit, found["sigmas"] * unit, digits, strict=True)
        lines.append((name, *(f"{value:.{d}f} ± {sigma:.{d}f}" for value, sigma, d in columns)))
    return table(("fitted without", "v_x, m/s", "v_y, m/s", "ω, °/s"), lines, 1)


def causes(results: Mapping[str, Any], stored: ErrorBudget) -> str:
    """The budget that each drive is judged with, with its 95 % intervals, and the stored one."""
    unit = np.array([np.rad2deg(1.0), 1.0, 100.0, 1.0])
    lines = []
    for name, own in results["fitted"].items():
        found = own[BUDGET]
        columns = zip(*(unit * each for each in (found["causes"], *found["bounds"])), strict=True)
        lines.append(
            (name, *(f"{value:.3f} [{low:.3f}, {high:.3f}]" for value, low, high in columns))
        )
    own = unit * [getattr(stored, name) for name in CAUSES]
    lines.append(("stored", *(f"{value:.3f}" for value in own)))
    return table(("fitted without", "azimuth, °", "Doppler, m/s", "scale, %", "lag, s"), lines, 1)


def counts(results: Mapping[str, Any]) -> str:
    """How many estimates were judged, how many blocks they make, and what share they are."""
    lines = [
        (
            cell,
            str(len(drives)),
            str(sum(each["estimates"] for each in drives.values())),
            f"{sum(each['independent'] for each in drives.values()):.0f}",
            f"{100.0 * np.mean([each['accepted'] for each in drives.values()]):.1f}",
        )
        for cell, drives in results["cells"].items()
    ]
    return table(("cell", "drives", "judged", "independent", "accepted, %"), lines, 1)


def section(data_set: str, results: Mapping[str, Any], stored: ErrorBudget) -> str:
    """The tables of a data set."""
    names = list(results["fitted"])
    value = " / ".join(names) if len(names) < 3 else f"mean of {', '.join(names)} and its interval"
    tables = {
        f"ANEES, mean NEES / 3 ({value}; 40, 15: targets a scan)": by_cell(
            results, [*MODELS], "ANEES"
        ),
        "mean log score, smaller is better": by_cell(results, [*MODELS], "log score"),
        "all sensors, with 95 % intervals": intervals(results),
        "all sensors: mean squares of whitened errors, and coverage in per cent": by_direction(
            results
        ),
        "constants beside the noise, ± standard error": constants(results),
        "budget beside the noise, with 95 % intervals": causes(results, stored),
        "fitted budget without one of its parts: log score less that of the whole": by_cell(
            results, [*ABLATIONS], "log score", BUDGET
        ),
        "estimates": counts(results),
    }
    folded = "\n\n".join(f"**{data_set}: {title}**\n\n{text}" for title, text in tables.items())
    return f"```{{dropdown}} All numbers of {data_set}\n{folded}\n```"


def chart(results: Mapping[str, Mapping[str, Any]], path: Path) -> None:
    """The ANEES of every model in every cell: both drives, or the mean with its interval."""
    use_style()
    figure, axes = plt.subplots(3, 2, figsize=(5.0, 7.8), sharex=True, sharey=True)
    rows = np.arange(len(MODELS))[::-1]
    for ax, cell in zip(axes.ravel(), CELLS, strict=True):
        ax.axvspan(*FAIR, color=GREY, alpha=0.2, lw=0)
        ax.axvline(1.0, color=BLACK, lw=0.8)
        looks = zip(results.items(), (PURPLE, SKY), (0.2, -0.2), strict=False)
        for (name, own), color, shift in looks:
            judged = [each["models"] for each in own["cells"][cell].values()]
            values = np.array([[each[model]["ANEES"] for model in MODELS] for each in judged])
            if len(values) > 2:
                mean, half = over_drives(values)
                low = np.maximum(mean - half, LOWEST)
                ax.hlines(rows + shift, low, mean + half, color=color, lw=1.2)
                values = mean[None]
            points = ax.plot(values.T, rows + shift, "o", color=color, ms=3.5)
            points[0].set_label(name)
        ax.set(xscale="log", xlim=(LOWEST, 70.0), title=cell)
        ax.set_xticks([0.5, 2, 10, 50], [0.5, 2, 10, 50])
        ax.set_xticks([], minor=True)
        ax.grid(axis="y", alpha=0.4)
    axes[0, 0].set_yticks(rows, MODELS)
    for ax in axes[-1]:
        ax.set_xlabel("ANEES")
    letter_panels(axes)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    figure.savefig(path, dpi=110, bbox_inches="tight", metadata={"Software": None})
    plt.close(figure)


def main() -> None:
    """Judge every model on the drives at hand and write the tables into the book."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name in ("radarscenes", "nuscenes"):
        parser.add_argument(f"--{name}", type=Path, nargs="*", default=[])
    parser.add_argument("--folder", type=Path, help="keeps the estimates, so that it can resume")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--seconds", type=float, help="of each drive; nothing is written")
    arguments = parser.parse_args()
    in_one_thread()
    kept = joblib.Memory(arguments.folder, verbose=0).cache(load_and_estimate)
    at_hand = {
        "RadarScenes": sequences(arguments.radarscenes),
        "nuScenes": scenes(arguments.nuscenes),
    }
    wanted = list(CELLS.values())
    jobs = [
        (data_set, root, name, cell)
        for data_set, drives in at_hand.items()
        for root, name in drives
        for cell in wanted
    ]
    found = {}
    parallel = joblib.Parallel(arguments.jobs, return_as="generator")
    outcomes = parallel(joblib.delayed(kept)(*job, arguments.seconds) for job in jobs)
    for (data_set, _, name, cell), outcome in zip(jobs, outcomes, strict=True):
        found[data_set, name, cell] = outcome
        print(
            data_set, name, cell, len(outcome.estimates.times), f"{outcome.share:.3f}", flush=True
        )
    parts, judgements = ["<!-- Written by `python -m benchmarks.protocol`. -->"], {}
    for data_set, drives in at_hand.items():
        if len(drives) < 2:  # nothing to leave out
            continue
        cells = {
            title: {name: found[data_set, name, cell] for _, name in drives}
            for title, cell in CELLS.items()
        }
        results = judgements[data_set] = protocol(cells, bounds=len(drives) == 2)
        parts.append(section(data_set, results, STORED[data_set]))
    text = "\n\n".join([*parts, ""])
    print(text)
    if arguments.seconds is None and len(parts) > 1:
        results_path("road_protocol.md").write_text(text, encoding="utf-8")
        chart(judgements, results_path("road_protocol.png"))


if __name__ == "__main__":
    # by its own name: worker processes and the cache cannot find the classes of `__main__`
    from benchmarks import protocol as by_name

    by_name.main()
