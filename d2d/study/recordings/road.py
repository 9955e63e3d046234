"""Whether covariances are true on the road, on every recording at hand.

    python -m d2d.study.recordings.road [--radarscenes ROOT ...] [--nuscenes ROOT ...]

renews ``chapters/results/road.json``, as far as the data are given: errors and scores of our
estimates, no measurements.  Simpler models are judged beside these by `benchmarks.protocol`, whose
tables `protocol_table` reads.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from d2d.radar import (
    Comparison,
    ErrorBudget,
    Recording,
    Reference,
    VehicleLimits,
    compare,
    compare_halves,
    compare_tracks,
    load_nuscenes,
    load_radarscenes,
    track,
)
from d2d.study.recordings.estimates import SENSORS, with_extent
from d2d.study.recordings.turning import CHANNELS, of_turning
from d2d.study.results import read_json, results_path, write_json

SIDE_CHANNELS = CHANNELS[1:3]
# The budgets were fitted to the first ones, with those "seen" in view.
FITTED_SEQUENCE, HELD_OUT_SEQUENCE = "105", "108"
FITTED_SCENES, SEEN_SCENES = ("scene-0061", "scene-0103"), ("scene-0916", "scene-1077")
HELD_OUT_SCENE = "scene-0655"
BASELINES = (2, 4)  # about 0.15 and 0.3 s
LONGER = (1, 2, 3, 4, 6, 8)
TURNS = (1, 4)  # about 0.075 and 0.3 s
EXTENTS = (0.0, 0.1, 0.2, 0.3, 0.5)  # m
SIDE_ERROR = np.deg2rad(15.0)  # rad/s: a yaw rate that is farther off is a gross error


def sequences(roots: Sequence[Path]) -> list[tuple[Path, str]]:
    """The numbers of all sequences of RadarScenes roots, each with its root."""
    return [
        (root, str(number))
        for root in roots
        for number in sorted(int(p.name.split("_")[1]) for p in (root / "data").glob("sequence_*"))
    ]


def scenes(roots: Sequence[Path]) -> list[tuple[Path, str]]:
    """The names of all scenes of nuScenes roots, each with its root."""
    return [
        (root, name)
        for root in roots
        for table in sorted(root.glob("v1.0-*/scene.json"))
        for name in sorted(each["name"] for each in json.loads(table.read_text()))
    ]


def load_sequence(root: str | Path, sequence: str = FITTED_SEQUENCE) -> list[Recording]:
    """All sensors of a RadarScenes sequence."""
    return [load_radarscenes(root, sequence, sensor) for sensor in SENSORS]


def load_scene(root: str | Path, scene: str) -> list[Recording]:
    """All radars of a nuScenes scene."""
    return [load_nuscenes(root, scene, channel) for channel in CHANNELS]


def joint_reference(recordings: Sequence[Recording]) -> Reference:
    """The reference at the times of all sensors' scans."""
    columns = np.concatenate(
        [
            np.column_stack([r.reference.times, r.reference.theta, r.reference.poses])
            for r in recordings
        ]
    )
    columns = columns[np.argsort(columns[:, 0], kind="stable")]
    return Reference(columns[:, 0], columns[:, 1:4], columns[:, 4:])


def judged(recordings: Sequence[Recording], **options: Any) -> Comparison:
    """The track of all sensors together, with these options, beside the reference."""
    return compare(track(recordings, **options), joint_reference(recordings))


def models(recordings: Sequence[Recording], baseline: int) -> dict[str, Comparison]:
    """A drive with each covariance that needs nothing fitted here."""
    budgets = {
        "inverse Hessian": None,
        "propagated noise": ErrorBudget(),
        "noise and budget": recordings[0].budget,
    }
    return {
        name: judged(recordings, baseline=baseline, budget=budget)
        for name, budget in budgets.items()
    }


def scores(found: Comparison) -> dict[str, Any]:
    """What a comparison measures, as plain numbers."""
    measures, (low, high) = found.measures, found.intervals().anees
    return {
        "rmse": found.rmse.tolist(),
        "mean": measures.mean_error.tolist(),
        "anees": float(measures.anees),
        "anees_interval": [float(low), float(high)],
        "inside": float(measures.coverage[1]),
        "whitened": measures.whitened_squares.tolist(),
        "log_score": float(measures.log_score),
        "estimates": len(found.times),
    }


def judge(drives: Mapping[str, Sequence[Recording]]) -> dict[str, Any]:
    """The scores of every covariance on each drive, by baseline."""
    return {
        f"baseline {baseline}": {
            name: {model: scores(found) for model, found in models(own, baseline).items()}
            for name, own in drives.items()
        }
        for baseline in BASELINES
    }


def extents(recordings: Sequence[Recording]) -> list[dict[str, Any]]:
    """Errors and inverse Hessian of all sensors together against the extent, baseline 2."""
    rows = []
    for extent in EXTENTS:
        own = [with_extent(recording, extent) for recording in recordings]
        plain, noise = (judged(own, baseline=2, budget=each) for each in (None, ErrorBudget()))
        rows.append(
            {"extent": extent, "inverse Hessian": scores(plain), "propagated": scores(noise)}
        )
    return rows


def widths(recordings: Sequence[Recording]) -> dict[str, Any]:
    """All sensors together with the thesis's outliers (a width of 1 m/s), ours, and wide ones."""
    return {
        f"{width:g} m/s": scores(judged(recordings, baseline=2, doppler_width=width))
        for width in (1.0, 4.0, 40.0)
    }


def horizons(recordings: Sequence[Recording]) -> list[dict[str, Any]]:
    """Scores with the budget, and the mean time between the scans of a pair, by baseline."""
    step, budget = cycle(recordings), recordings[0].budget
    return [
        {
            "horizon": baseline * step,
            **scores(judged(recordings, baseline=baseline, budget=budget)),
        }
        for baseline in LONGER
    ]


def cycle(recordings: Sequence[Recording]) -> float:
    """The time between two scans of a sensor, in s."""
    return float(np.median(np.diff([scan.time for scan in recordings[0].scans])))


def turns(recordings: Sequence[Recording]) -> dict[str, list[float]]:
    """Mean errors (deg) of the turn of a pair by `TURNS`, with the Doppler velocities and without.

    A turn is the yaw rate times the time between the scans.
    """
    found: dict[str, list[float]] = {}
    for name, doppler in (("with Doppler", True), ("without Doppler", False)):
        options = {"budget": recordings[0].budget, "doppler": doppler}
        own = [judged(recordings, baseline=baseline, **options) for baseline in TURNS]
        rates = [float(each.measures.mean_error[2]) for each in own]
        found[name] = [n * cycle(recordings) * rate for n, rate in zip(TURNS, rates, strict=True)]
    return found


def side_radars(root: str | Path) -> list[dict[str, Any]]:
    """How many estimates of single side radars are kept, and how many of these are grossly off."""
    ways: dict[str, dict[str, Any]] = {
        "thesis: width 1 m/s, no limits": {"doppler_width": 1.0, "limits": None},
        "width 4 m/s, no limits": {"limits": None},
        "width 40 m/s, no limits": {"doppler_width": 40.0, "limits": None},
        "vehicle limits": {"limits": VehicleLimits()},
        "vehicle limits, no side slip": {"side_slip": False},
    }
    rows = []
    for way, options in ways.items():
        for names in (FITTED_SCENES, SEEN_SCENES):
            kept, errors, known = 0, [], 0
            for scene, channel in product(names, SIDE_CHANNELS):
                own = load_nuscenes(root, scene, channel)
                driven = track(own, **options)
                error = driven.theta - own.reference.at(driven.times).theta
                judgeable = np.isfinite(error).all(axis=1)
                good = judgeable & driven.converged
                kept += int(good.sum())
                known += int(judgeable.sum())
                errors.append(error[good, 2])
            omega = np.concatenate(errors)
            rows.append(
                {
                    "way": way,
                    "scenes": list(names),
                    "kept": kept / known,
                    "gross": float((np.abs(omega) > SIDE_ERROR).mean()),
                    "rmse": float(np.rad2deg(np.sqrt(np.mean(omega**2)))),
                }
            )
    return rows


def without_reference(recordings: Sequence[Recording]) -> dict[str, Any]:
    """Covariances judged by halves of scans and by pairs of sensors, with and without a budget."""
    rng = np.random.default_rng(0)
    third = recordings[2]
    view = [(third.scans, third.mounting)]
    found: dict[str, Comparison] = {
        f"halves by {by}, inverse Hessian": compare_halves(view, rng, by=by, baseline=2)
        for by in ("target", "object")
    }
    for name, budget in (("inverse Hessian", None), ("noise and budget", third.budget)):
        pair = [track(r, baseline=2, budget=budget) for r in (third, recordings[1])]
        found[f"sensor 3 against sensor 2, {name}"] = compare_tracks(*pair)
    return {name: scores(each) for name, each in found.items()}


def places(listed: Sequence[tuple[Path, str]], wanted: Sequence[str]) -> dict[str, Path]:
    """The root of each drive that is wanted; raises a ``ValueError`` if one is missing."""
    roots = {name: root for root, name in listed}
    missing = [name for name in wanted if name not in roots]
    if missing:
        raise ValueError(f"the folders must hold {', '.join(missing)}, too")
    return {name: roots[name] for name in wanted}


def of_radarscenes(roots: Sequence[Path]) -> dict[str, Any]:
    """What the pages show of RadarScenes."""
    found = places(sequences(roots), (FITTED_SEQUENCE, HELD_OUT_SEQUENCE))
    drives = {name: load_sequence(root, name) for name, root in found.items()}
    recordings = drives[FITTED_SEQUENCE]
    return {
        "radarscenes": judge(drives),
        "extents": extents(recordings),
        "widths": widths(recordings),
        "horizons of RadarScenes": {f"sequence {FITTED_SEQUENCE}": horizons(recordings)},
        "turns of RadarScenes": {f"sequence {name}": turns(own) for name, own in drives.items()},
        "without_reference": without_reference(recordings),
    }


def of_nuscenes(roots: Sequence[Path]) -> dict[str, Any]:
    """What the pages show of nuScenes."""
    known = FITTED_SCENES + SEEN_SCENES
    found = places(scenes(roots), (*known, HELD_OUT_SCENE))
    drives = {name: load_scene(root, name) for name, root in found.items()}
    return {
        "nuscenes": judge(drives),
        "horizons of nuScenes": {name: horizons(drives[name]) for name in known},
        "turns of nuScenes": {name: turns(own) for name, own in drives.items()},
        "turning": of_turning(found[FITTED_SCENES[0]]),
        "side_radars": side_radars(found[FITTED_SCENES[0]]),
    }


def read_road() -> dict[str, Any]:
    """What `main` wrote."""
    return read_json(results_path("road.json"))


def protocol_table(title: str) -> dict[str, list[str]]:
    """The cells of a table of `benchmarks.protocol`, by covariance; its heading begins so."""
    text = results_path("road_protocol.md").read_text(encoding="utf-8")
    lines = text.split(f"**{title}")[1].split("\n\n")[1].splitlines()[2:]
    rows = ([cell.strip() for cell in line.strip("|").split("|")] for line in lines)
    return {name: cells for name, *cells in rows}


def main() -> None:
    """Judge all covariances on the recordings at hand and write the results."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    for data_set in ("radarscenes", "nuscenes"):
        parser.add_argument(f"--{data_set}", nargs="+", type=Path, metavar="ROOT")
    arguments = parser.parse_args()
    found = read_road()
    if arguments.radarscenes:
        found |= of_radarscenes(arguments.radarscenes)
    if arguments.nuscenes:
        found |= of_nuscenes(arguments.nuscenes)
    path = results_path("road.json")
    write_json(path, found, digits=5)
    print(f"written to {path}")


if __name__ == "__main__":
    main()
