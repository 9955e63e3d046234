"""Estimates for a RadarScenes sequence, stored in small files that hold no measurements.

The book can so be built without the data set.  ``chapters/results/radarscenes_<sequence>.csv``
holds our estimates with their covariances and errors, ``radarscenes_<sequence>.json`` the lag, the
slip, the mountings and the noise that were found, and the computing times.
"""

import os
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from d2d import rigid
from d2d._types import Array
from d2d.radar import (
    Comparison,
    Recording,
    Reference,
    Track,
    doppler_ego_motion,
    load_radarscenes,
    track,
)
from d2d.radar.evaluation.calibration_model import scan_velocities
from d2d.radar.tracks.rounds import rounds_of
from d2d.study.results import read_json, results_path, write_json
from d2d.study.road.displacements import by_its_velocities
from d2d.study.road.drive import SENSORS, Source, with_extent
from d2d.study.road.residuals import (
    Correction,
    fit_correction,
    residual_rms,
    residual_sigmas,
    some_of,
)
from d2d.study.road.suspects import judge_halves

FORWARD = 3  # the sensor that is shown alone
SECTORS = (0, 15, 30, 45, 60)  # deg, edges of |azimuth|
STATED = (0.11, -0.05)  # s, time offset and side slip of most sequences, as chapter 14 states them
OFFSETS = np.arange(0.0, 0.2501, 0.01)  # s
COLUMNS = (
    *("time_s", "interval_s", "converged", "vx", "vy", "omega"),
    *("cov_xx", "cov_xy", "cov_xw", "cov_yy", "cov_yw", "cov_ww"),
    *("error_vx", "error_vy", "error_omega"),
)
_UPPER = np.triu_indices(3)


class Run(NamedTuple):
    """One way to estimate a drive.

    ``baseline`` and ``doppler`` are options of `track`, ``strongest`` of `load_radarscenes`;
    ``extent`` (m) replaces its position scatter.
    """

    sensors: tuple[int, ...]
    method: str = "registration"  # or "Doppler only", or "Doppler only, equal weights"
    baseline: int = 1
    doppler: bool = True
    strongest: int | None = None
    extent: float | None = None


RUNS = {
    **{f"sensor {s}": Run((s,)) for s in SENSORS},
    "sensor 2, baseline 2": Run((2,), baseline=2),
    "sensor 3, baseline 2": Run((3,), baseline=2),
    "sensor 3, baseline 3": Run((3,), baseline=3),
    "sensor 3, without Doppler": Run((3,), doppler=False),
    "four sensors": Run(SENSORS),
    "four sensors, baseline 2": Run(SENSORS, baseline=2),
    "four sensors, strongest 48, baseline 2": Run(SENSORS, baseline=2, strongest=48),
    **{
        f"four sensors, extent {extent:g} m, baseline 2": Run(SENSORS, baseline=2, extent=extent)
        for extent in (0.0, 0.3)
    },
    "four sensors, Doppler only": Run(SENSORS, "Doppler only"),
    "four sensors, Doppler only, equal weights": Run(SENSORS, "Doppler only, equal weights"),
}


class Result(NamedTuple):
    """The estimates of one run and their errors (n, 3), nan where there is no reference."""

    track: Track
    errors: Array

    @property
    def judged(self) -> Comparison:
        """The errors of the converged pairs that have a reference, with their covariances."""
        return Comparison.from_errors(self.track, self.errors)

    @property
    def reference(self) -> Array:
        """The reference velocities (n, 3) that the errors are relative to."""
        return np.asarray(self.track.theta - self.errors)

    def paths(self) -> tuple[Array, Array]:
        """Paths of the estimates and of the finely integrated reference: poses (m, 3)."""
        first, *_, last = np.flatnonzero(np.isfinite(self.errors).all(axis=1))
        driven, reference = self.track[first : last + 1], self.reference[first : last + 1]
        path = driven.poses()[1:]
        truth = by_its_velocities(Reference(driven.times, reference, np.zeros_like(reference)))
        return rigid.compose(rigid.inverse(path[0]), path), truth.at(driven.times).poses


def compute(
    root: str | os.PathLike[str], sequence: int | str, runs: dict[str, Run] = RUNS
) -> tuple[dict[str, Result], dict[str, Any]]:
    """Compute all runs on one sequence, and the facts about the recording.

    Errors are relative to the odometry, corrected as the first half of the recording suggests; the
    facts have the RMSE with the stated correction, too.  Times count from the first scan.
    """

    @cache
    def load(sensor: int, strongest: int | None = None, **corrected: Any) -> Recording:
        return load_radarscenes(root, sequence, sensor, strongest=strongest, **corrected)

    raw = [load(s, time_offset=0.0, side_slip=0.0) for s in SENSORS]
    start, end = raw[0].scans[0].time, raw[0].scans[-1].time
    facts, correction = recording_facts(raw, end - start)
    offset, slip = correction.time_offset, correction.side_slip
    reference = load(1, time_offset=offset, side_slip=slip).reference
    stated = load(1, time_offset=STATED[0], side_slip=STATED[1]).reference
    results = {}
    for name, run in runs.items():
        recordings = [load(s, run.strongest) for s in run.sensors]
        if run.extent is not None:
            recordings = [with_extent(recording, run.extent) for recording in recordings]
        begin = time.perf_counter()
        driven = drive(run, recordings)
        facts["seconds"][name] = round(time.perf_counter() - begin, 2)
        errors = driven.theta - reference.at(driven.times).theta
        against_stated = driven.theta - stated.at(driven.times).theta
        facts["stated_rmse"][name] = Comparison.from_errors(driven, against_stated).rmse.tolist()
        results[name] = Result(replace(driven, times=driven.times - start), errors)
    for s in SENSORS:
        if f"sensor {s}" in results:
            driven = results[f"sensor {s}"].track
            facts["sigmas"][f"sensor {s}"] = residual_sigmas(load(s, None), driven, SECTORS)
    facts["halves"] = judge_halves(load(FORWARD, None))
    return results, facts


def whole_rounds(recordings: Sequence[Recording]) -> list[Recording]:
    """The recordings without the scans of a last round that lacks a sensor, as it was cut off."""
    groups = rounds_of([(r.scans, r.mounting) for r in recordings])
    while len(groups[-1].scans) < len(recordings):
        groups.pop()
    last = groups[-1].scans
    return [
        replace(r, scans=[scan for scan in r.scans if scan.time <= last[s].time])
        for s, r in enumerate(recordings)
    ]


def drive(run: Run, recordings: Sequence[Recording]) -> Track:
    """Estimate a drive from the recordings of the run's sensors, with the run's options."""
    recordings = whole_rounds(recordings)
    if run.method == "registration":
        return track(recordings, baseline=run.baseline, doppler=run.doppler, carry=False)
    if run.method == "Doppler only, equal weights":
        # azimuth errors then count neither in the weights nor in the gate
        recordings = [
            replace(r, scans=[replace(s, sigma_azimuth=np.full(s.size, 1e-9)) for s in r.scans])
            for r in recordings
        ]
    return _doppler_track(recordings)


def _doppler_track(recordings: Sequence[Recording]) -> Track:
    """Least squares on each round's Doppler velocities; with one sensor, v_y is taken as zero."""
    groups = rounds_of([(r.scans, r.mounting) for r in recordings])
    motions = [
        doppler_ego_motion(
            [(scan, recordings[s].mounting) for s, scan in each.scans.items()],
            side_slip=len(recordings) > 1,
        )
        for each in groups
    ]
    covariance = np.array([motion.covariance for motion in motions])
    return Track(
        np.array([each.time for each in groups]),
        np.array([each.interval for each in groups]),
        np.array([motion.theta for motion in motions]),
        covariance,
        np.isfinite(covariance).all(axis=(1, 2)),
    )


def recording_facts(raw: Sequence[Recording], duration: float) -> tuple[dict[str, Any], Correction]:
    """Clock, slip and mountings by the Doppler velocities, and the correction to use.

    ``raw`` are recordings read without a correction, which is fitted to their first half only.
    """
    halves = {"first half": (0.0, 0.5 * duration), "second half": (0.5 * duration, np.inf)}
    odometry = raw[0].reference
    found = scan_velocities((recording.scans, recording.mounting) for recording in raw)
    starts = np.array([recording.scans[0].time for recording in raw])
    elapsed = found.time - starts[found.sensor]
    groups = {f"sensor {s}": found.sensor == number for number, s in enumerate(SENSORS)}
    groups["four sensors"] = np.ones(len(elapsed), dtype=np.bool_)
    fits, profile = [], {"offset": OFFSETS.tolist()}
    for part, (first, last) in {"all": (0.0, np.inf), **halves}.items():
        for name, own in groups.items():
            targets = some_of(found, own & (elapsed >= first) & (elapsed < last))
            fit = fit_correction(targets, odometry)
            fits.append({"part": part, "sensors": name, **fit._asdict()})
            if part == "all":
                profile[name] = [residual_rms(targets, odometry, t) for t in OFFSETS]
            if (part, name) == ("first half", "four sensors"):
                correction = fit
    facts = {
        "seconds": {},
        "stated_rmse": {},
        "sigmas": {},
        "duration": duration,
        "targets": {
            f"sensor {s}": float(np.mean([scan.size for scan in r.scans]))
            for s, r in zip(SENSORS, raw, strict=True)
        },
        "corrections": fits,
        "profile": profile,
    }
    return facts, correction


def write_estimates(path: Path, results: dict[str, Result]) -> None:
    """Write all runs as one comma-separated table in SI units, to five significant digits."""
    tables = {}
    for name, (driven, errors) in results.items():
        covariance = driven.covariance[:, *_UPPER]
        columns = [driven.times, driven.intervals, driven.converged]
        numbers = np.column_stack([*columns, driven.theta, covariance, errors])
        tables[name] = pd.DataFrame(numbers, columns=COLUMNS)
    path.parent.mkdir(parents=True, exist_ok=True)
    table = pd.concat(tables, names=["run"]).droplevel(1)
    table.to_csv(path, float_format="%.5g", na_rep="nan", lineterminator="\n")


def read_estimates(path: Path) -> dict[str, Result]:
    """Read the runs that `write_estimates` wrote."""
    table = pd.read_csv(path, index_col="run")
    results = {}
    for name, rows in table.groupby(level="run", sort=False):
        times, intervals, converged, *numbers = rows.to_numpy(dtype=np.float64).T
        theta, upper, errors = np.split(np.transpose(numbers), [3, 9], axis=1)
        covariance = np.empty((len(rows), 3, 3))
        covariance[:, *_UPPER] = covariance[:, *_UPPER[::-1]] = upper
        results[name] = Result(Track(times, intervals, theta, covariance, converged > 0), errors)
    return results


def read_facts(path: Path) -> dict[str, Any]:
    """Read the facts about the recording that belong to the results at ``path``."""
    return read_json(path.with_suffix(".json"))


def estimates_path(sequence: int | str) -> Path:
    """Path of the book's estimates for a sequence."""
    return results_path(f"radarscenes_{sequence}.csv")


def data_root() -> Path | None:
    """Folder of the data set, from the environment variable D2D_RADARSCENES, or None."""
    root = os.environ.get("D2D_RADARSCENES")
    return Path(root) if root else None


def write(source: Source) -> None:
    """Estimate one sequence and write its results."""
    results, facts = compute(source.root, source.name)
    path = estimates_path(source.name)
    write_estimates(path, results)
    write_json(path.with_suffix(".json"), facts)
