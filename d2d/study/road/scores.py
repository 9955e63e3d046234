"""Whether covariances are true on the road: the scores in ``chapters/results/road.json``.

They are errors and scores of our estimates and hold no measurements.  Simpler models are judged
beside these by `d2d.study.road.protocol`.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from d2d.radar import Comparison, ErrorBudget, compare_halves, compare_tracks, track
from d2d.study.results import read_json, results_path, write_json
from d2d.study.road.drive import Drive, Source, pick
from d2d.study.road.extrapolation import fit_scenes

# The budgets were fitted to the first ones, with those "seen" in view.
FITTED_SEQUENCE, HELD_OUT_SEQUENCE = "105", "108"
FITTED_SCENES, SEEN_SCENES = ("scene-0061", "scene-0103"), ("scene-0916", "scene-1077")
HELD_OUT_SCENE = "scene-0655"
BASELINE = 4  # about 0.3 s
LONGER = (1, 2, 3, 4, 6, 8)
TURNS = (1, 4)  # about 0.075 and 0.3 s
EXTENTS = (0.0, 0.1, 0.2, 0.3, 0.5)  # m
RESULTS = results_path("road.json")


def models(drive: Drive, baseline: int) -> dict[str, Comparison]:
    """A drive with each covariance that needs nothing fitted here."""
    budgets = {
        "inverse Hessian": None,
        "propagated noise": ErrorBudget(),
        "noise and budget": drive.budget,
    }
    return {
        name: drive.compare(baseline=baseline, budget=budget) for name, budget in budgets.items()
    }


def scores(found: Comparison) -> dict[str, Any]:
    """The measures of a comparison, as plain numbers."""
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


def by_baseline(drives: Mapping[str, Drive]) -> dict[str, Any]:
    """The scores of every covariance on each drive, under the name of the baseline."""
    found = {
        name: {model: scores(own) for model, own in models(drive, BASELINE).items()}
        for name, drive in drives.items()
    }
    return {f"baseline {BASELINE}": found}


def by_extent(drive: Drive) -> list[dict[str, Any]]:
    """Scores of the inverse Hessian and of the propagated noise against the targets' extent."""
    budgets, rows = {"inverse Hessian": None, "propagated": ErrorBudget()}, []
    for extent in EXTENTS:
        own = drive.extended(extent)
        found = {name: scores(own.compare(baseline=2, budget=b)) for name, b in budgets.items()}
        rows.append({"extent": extent, **found})
    return rows


def by_horizon(drive: Drive) -> list[dict[str, Any]]:
    """Scores with the budget, and the mean time between the scans of a pair, by baseline."""
    found = {each: drive.compare(baseline=each, budget=drive.budget) for each in LONGER}
    return [{"horizon": n * drive.cycle, **scores(own)} for n, own in found.items()]


def turns(drive: Drive) -> dict[str, list[float]]:
    """Mean errors (deg) of the turn of a bare pair by `TURNS`, with Doppler velocities and without.

    A turn is the yaw rate times the time between the scans.
    """
    found: dict[str, list[float]] = {}
    for name, doppler in (("with Doppler", True), ("without Doppler", False)):
        judged = [drive.compare(baseline=baseline, doppler=doppler) for baseline in TURNS]
        rates = [float(each.measures.mean_error[2]) for each in judged]
        found[name] = [n * drive.cycle * rate for n, rate in zip(TURNS, rates, strict=True)]
    return found


def without_reference(drive: Drive) -> dict[str, Any]:
    """Covariances judged by halves of scans and by pairs of sensors, with and without a budget."""
    rng = np.random.default_rng(0)
    second, third = drive.recordings[1:3]
    view = [(third.scans, third.mounting)]
    found: dict[str, Comparison] = {
        f"halves by {by}, inverse Hessian": compare_halves(view, rng, by=by, baseline=2)
        for by in ("target", "object")
    }
    for name, budget in (("inverse Hessian", None), ("noise and budget", third.budget)):
        carry = budget is not None
        pair = [track(r, baseline=2, carry=carry, budget=budget) for r in (third, second)]
        found[f"sensor 3 against sensor 2, {name}"] = compare_tracks(*pair)
    return {name: scores(each) for name, each in found.items()}


def of_radarscenes(sources: Sequence[Source]) -> dict[str, Any]:
    """The scores of RadarScenes."""
    found = pick(sources, (FITTED_SEQUENCE, HELD_OUT_SEQUENCE))
    drives = {name: source.load() for name, source in found.items()}
    fitted = drives[FITTED_SEQUENCE]
    return {
        "radarscenes": by_baseline(drives),
        "extents": by_extent(fitted),
        "horizons of RadarScenes": {fitted.title: by_horizon(fitted)},
        "turns of RadarScenes": {drive.title: turns(drive) for drive in drives.values()},
        "without_reference": without_reference(fitted),
    }


def of_nuscenes(sources: Sequence[Source]) -> dict[str, Any]:
    """The scores of nuScenes."""
    known = FITTED_SCENES + SEEN_SCENES
    found = pick(sources, (*known, HELD_OUT_SCENE))
    drives = {name: source.load() for name, source in found.items()}
    return {
        "nuscenes": by_baseline(drives),
        "horizons of nuScenes": {name: by_horizon(drives[name]) for name in known},
        "turns of nuScenes": {name: turns(drive) for name, drive in drives.items()},
        "turning": fit_scenes(found),
    }


def read_scores() -> dict[str, Any]:
    """Read the stored scores."""
    return read_json(RESULTS)


def write(sources: Mapping[str, Sequence[Source]]) -> None:
    """Renew the scores of the data sets at hand."""
    found = read_scores()
    for data_set, judge in (("RadarScenes", of_radarscenes), ("nuScenes", of_nuscenes)):
        if data_set in sources:
            found |= judge(sources[data_set])
    write_json(RESULTS, found, digits=5)
