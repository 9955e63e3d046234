"""Whether covariances are true on the road: every model, on every recording at hand.

    python -m d2d.study.recordings.road [--radarscenes <root>] [--nuscenes <root>]

renews ``chapters/results/road.json``, as far as the data are given: errors and scores of our
estimates, no measurements.  Fitted models are fitted on one part of the data and judged on another;
see `Part`.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
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
from d2d.scores import normalised_squares
from d2d.study.recordings.estimates import SENSORS, with_extent
from d2d.study.recordings.turning import CHANNELS, of_turning
from d2d.study.results import read_json, results_path, write_json

SEQUENCE = 105
SIDE_CHANNELS = CHANNELS[1:3]
FITTED_SCENES, OTHER_SCENES = ("scene-0061", "scene-0103"), ("scene-0916", "scene-1077")
BASELINES = (2, 4)  # about 0.15 and 0.3 s
LONGER = (1, 2, 3, 4, 6, 8)
EXTENTS = (0.0, 0.1, 0.2, 0.3, 0.5)  # m
SIDE_ERROR = np.deg2rad(15.0)  # rad/s: a yaw rate that is farther off is a gross error


Part = dict[str, Comparison]
"""A stretch of a drive, with each covariance that needs nothing fitted here."""


def load_sequence(root: str | Path) -> list[Recording]:
    """All sensors of the RadarScenes sequence."""
    return [load_radarscenes(root, SEQUENCE, sensor) for sensor in SENSORS]


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


def whole(recordings: Sequence[Recording], baseline: int) -> Part:
    """A whole drive: the inverse Hessian, the targets' propagated noise, the data set's budget."""
    budgets = {
        "inverse Hessian": None,
        "propagated noise": ErrorBudget(),
        "noise and budget": recordings[0].budget,
    }
    return {
        name: judged(recordings, baseline=baseline, budget=budget)
        for name, budget in budgets.items()
    }


def between(part: Part, first: float, last: float) -> Part:
    """The estimates from a share ``first`` to a share ``last`` of the drive."""

    def cut(found: Comparison) -> Comparison:
        begin, end = found.times[[0, -1]]
        share = (found.times - begin) / (end - begin)
        inside = (share >= first) & (share <= last)
        return replace(
            found,
            times=found.times[inside],
            errors=found.errors[inside],
            covariances=found.covariances[inside],
        )

    return {name: cut(each) for name, each in part.items()}


def models(part: Part, fitted: Sequence[Part]) -> dict[str, Comparison]:
    """Every model of the covariance on one part, the simple ones fitted on others.

    One factor makes the inverse Hessian's ANEES one, a constant matrix is the mean square of the
    errors.
    """
    plain, others = part["inverse Hessian"], [each["inverse Hessian"] for each in fitted]
    errors = np.concatenate([each.errors for each in others])
    covariances = np.concatenate([each.covariances for each in others])
    scaled = plain.covariances * normalised_squares(errors, covariances).mean() / 3.0
    constant = np.broadcast_to(errors.T @ errors / len(errors), scaled.shape)
    return {
        "inverse Hessian": plain,
        "inverse Hessian, one factor": replace(plain, covariances=scaled),
        "one constant matrix": replace(plain, covariances=constant),
        **{name: found for name, found in part.items() if found is not plain},
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


def judge_radarscenes(recordings: Sequence[Recording]) -> dict[str, Any]:
    """The whole sequence, and each half with the simple models fitted on the other."""
    found = {}
    for baseline in BASELINES:
        part = whole(recordings, baseline)
        first, second = between(part, 0.0, 0.5), between(part, 0.5, 1.0)
        rows = {
            "all": models(part, [part]),
            "first half": models(first, [second]),
            "second half": models(second, [first]),
        }
        found[f"baseline {baseline}"] = {
            where: {name: scores(each) for name, each in row.items()} for where, row in rows.items()
        }
    return found


def judge_nuscenes(scenes: dict[str, list[Recording]]) -> dict[str, Any]:
    """Every scene, with the simple models fitted on the two training scenes."""
    found = {}
    for baseline in BASELINES:
        parts = {name: whole(own, baseline) for name, own in scenes.items()}
        fitted = [parts[name] for name in FITTED_SCENES]
        found[f"baseline {baseline}"] = {
            name: {model: scores(each) for model, each in models(part, fitted).items()}
            for name, part in parts.items()
        }
    return found


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
    step = float(np.median(np.diff([scan.time for scan in recordings[0].scans])))
    budget = recordings[0].budget
    return [
        {
            "horizon": baseline * step,
            **scores(judged(recordings, baseline=baseline, budget=budget)),
        }
        for baseline in LONGER
    ]


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
        for scenes in (FITTED_SCENES, OTHER_SCENES):
            kept, errors, known = 0, [], 0
            for scene, channel in product(scenes, SIDE_CHANNELS):
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
                    "scenes": list(scenes),
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


def of_radarscenes(root: str | Path) -> dict[str, Any]:
    """What the page shows of RadarScenes."""
    recordings = load_sequence(root)
    return {
        "radarscenes": judge_radarscenes(recordings),
        "extents": extents(recordings),
        "widths": widths(recordings),
        "horizons of RadarScenes": {"sequence 105": horizons(recordings)},
        "without_reference": without_reference(recordings),
    }


def of_nuscenes(root: str | Path) -> dict[str, Any]:
    """What the page shows of nuScenes."""
    scenes = {name: load_scene(root, name) for name in FITTED_SCENES + OTHER_SCENES}
    return {
        "nuscenes": judge_nuscenes(scenes),
        "horizons of nuScenes": {name: horizons(own) for name, own in scenes.items()},
        "turning": of_turning(root),
        "side_radars": side_radars(root),
    }


def read_road() -> dict[str, Any]:
    """What `main` wrote."""
    return read_json(results_path("road.json"))


def carried_alike() -> dict[str, list[float]]:
    """The parts of the ANEES of sequence 105 by covariance, with all estimates carried alike.

    They are those of v_x, v_y and omega in the table that `benchmarks.protocol` has written.
    """
    text = results_path("road_protocol.md").read_text(encoding="utf-8")
    table = text.split("mean squares of whitened errors")[1].split("**RadarScenes")[0]
    rows = [line.strip("| ").split("|") for line in table.splitlines() if "/" in line]
    return {name.strip(): [float(part.split("/")[0]) for part in row[:3]] for name, *row in rows}


def main() -> None:
    """Judge all covariances on the recordings at hand and write the results."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--radarscenes", help="folder of the RadarScenes data set")
    parser.add_argument("--nuscenes", help="folder of the nuScenes data set")
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
