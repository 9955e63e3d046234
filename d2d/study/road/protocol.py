"""Covariances on the road: every model fitted and judged alike, leaving one drive out.

Page G states the protocol.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import joblib
import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray

from d2d import block_bootstrap, log_score
from d2d._types import Array
from d2d.radar import Comparison, ErrorBudget, RadarScan, Tracker, fit_budget
from d2d.radar.evaluation.fit import BudgetFit
from d2d.study.road.drive import DATA_SETS, HORIZON, Drive, Source

SEED = 20
PERIOD, QUIET = 5.0, 3.0  # s: of these, the last ones are without a sensor
FEWEST = 20  # estimates of a drive in a cell, for less it is not judged there
ALL = "all"
CAUSES = "azimuth", "doppler", "scale", "lag"  # of an error budget
GROSS = np.array([1.0, 1.0, np.deg2rad(15.0)])  # m/s, m/s, rad/s: an error of traffic, not of noise
DIRECTIONS = ("v_x", "v_y", "ω")
LEVELS = ("50 %", "95 %", "99 %")
BARE, EMPTY, FITTED, STORED = "bare pairs", "empty budget", "fitted budget", "stored budget"
CONSTANT, FACTORS = "constant matrix", "3 factors"
MODELS = (BARE, EMPTY, CONSTANT, FACTORS, FITTED, STORED)
TRACKS = (BARE, EMPTY, FITTED, STORED)  # with estimates of their own


class Cell(NamedTuple):
    """The sensors and targets to estimate with, and which estimates are judged."""

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


def thinned(scans: Sequence[RadarScan], targets: int, rng: np.random.Generator) -> list[RadarScan]:
    """The scans with at most so many targets each, drawn at random."""
    return [
        scan[np.sort(rng.choice(scan.size, targets, replace=False))]
        if scan.size > targets
        else scan
        for scan in scans
    ]


def is_quiet(times: Array, start: float, sensor: int, sensors: int) -> NDArray[np.bool_]:
    """Whether a sensor is off at the times (n,): each in turn, at the end of a period."""
    periods, rest = np.divmod(times - start, PERIOD)
    return np.asarray((rest >= PERIOD - QUIET) & (periods % sensors == sensor))


def changed(drive: Drive, cell: Cell, alone: Mapping[str, int]) -> Drive:
    """The part of a drive that a cell leaves; ``alone`` has the places of single sensors."""
    own, start = drive.recordings, drive.rounds[0].time
    if cell.alone is not None:
        own = [own[alone[cell.alone]]]
    found = []
    for s, recording in enumerate(own):
        scans = list(recording.scans)
        if cell.targets is not None:
            scans = thinned(scans, cell.targets, np.random.default_rng([SEED, s]))
        if cell.silence:
            off = is_quiet(np.array([scan.time for scan in scans]), start, s, len(own))
            scans = [scan for scan, silent in zip(scans, off, strict=True) if not silent]
        found.append(replace(recording, scans=scans))
    return Drive(drive.title, found)


def compare_cell(
    drive: Drive, cell: Cell, alone: Mapping[str, int], budget: ErrorBudget | None
) -> Comparison:
    """The track of a cell beside the reference; without a budget, the bare pairs of scans."""
    left = changed(drive, cell, alone)
    driven = left.track(horizon=HORIZON, budget=budget)
    errors = driven.theta - drive.reference.at(driven.times).theta
    wanted = np.isfinite(errors).all(axis=1)
    if cell.silence:
        start, count = drive.rounds[0].time, len(left.recordings)
        quiet = [is_quiet(driven.times, start, s, count) for s in range(count)]
        wanted &= np.logical_or.reduce(quiet)
    good = wanted & driven.converged
    share = float(good.sum() / max(wanted.sum(), 1))
    return Comparison(driven.times[good], errors[good], driven.covariance[good], share, share)


# ---- Fits


class Unfiltered(NamedTuple):
    """The n estimates of a drive as input of a filter, beside the reference."""

    errors: Array  # (n, 3), at the acceleration of the reference
    white: Array  # (n, 3, 3)
    effects: Array  # (4, n, 3, 3) of a standard deviation of one of each of `CAUSES`


def unfiltered(drive: Drive) -> Unfiltered:
    """The accepted estimates of all sensors before a filter."""
    budget, sensors = drive.budget, len(drive.recordings)
    assert budget is not None
    mountings = {str(s): own.mounting for s, own in enumerate(drive.recordings)}
    tracker = Tracker(mountings, horizon=HORIZON, budget=budget)
    rows = []
    for estimate in [e for entry in drive.in_time_order() for e in tracker.add(*entry)]:
        seen = estimate.filter_input
        before, now = drive.reference.at([estimate.time - HORIZON, estimate.time]).theta
        if seen is None or not np.isfinite([before, now]).all():
            continue
        acceleration = (now - before) / HORIZON
        expected, _ = seen.expected(now, acceleration, np.zeros(seen.slow.shape[1] + 1))
        each = np.split(seen.slow, [sensors, 2 * sensors, 2 * sensors + 1], axis=1)[:3]
        numbers = budget.azimuth, budget.doppler, budget.scale
        columns = [own / number for own, number in zip(each, numbers, strict=True)]
        added = np.array([c @ c.T for c in (*columns, acceleration[:, None])])
        rows.append((seen.velocity - expected, seen.white, added))
    errors, white, effects = (np.array(column) for column in zip(*rows, strict=True))
    return Unfiltered(errors, white, effects.swapaxes(0, 1))


def fitted_budget(drives: Sequence[Unfiltered], stored: ErrorBudget) -> BudgetFit:
    """The budget that is most likely for some drives; its length is that of a stored one."""
    errors, white = (np.concatenate([getattr(d, n) for d in drives]) for n in ("errors", "white"))
    effects = np.concatenate([each.effects for each in drives], axis=1)
    found = fit_budget(errors, white, dict(zip(CAUSES, effects, strict=True)))
    return replace(found, budget=replace(found.budget, neighbours=stored.neighbours))


def constant_matrix(drives: Sequence[Comparison]) -> Array:
    """The matrix (3, 3) with the best log score for all estimates: their mean square."""
    errors = np.concatenate([own.errors for own in drives])
    return np.asarray(errors.T @ errors / len(errors))


def three_factors(drives: Sequence[Comparison]) -> Array:
    """The factors (3,) on the standard deviations that have the best log score."""
    errors, stated = (
        np.concatenate([getattr(own, name) for own in drives]) for name in ("errors", "covariances")
    )

    def score(logarithms: Array) -> float:
        factors = np.exp(logarithms)
        return float(log_score(errors / factors, stated).mean() + logarithms.sum())

    best = scipy.optimize.minimize(score, np.zeros(3), method="L-BFGS-B")
    return np.asarray(np.exp(best.x))


def others(drives: Mapping[str, Any], held_out: str) -> list[Any]:
    """All drives but one."""
    return [own for name, own in drives.items() if name != held_out]


# ---- Judgement

Tracks = Mapping[str, Comparison]  # of `STORED`, with all sensors of all `TRACKS`


def stated_by_models(own: Tracks, matrix: Array, factors: Array) -> dict[str, Comparison]:
    """Every model's covariances; ``matrix`` (3, 3) and ``factors`` (3,) are of other drives."""
    stored = own[STORED]
    wide = np.outer(factors, factors) * stored.covariances
    alike = np.broadcast_to(matrix, stored.covariances.shape)
    added = {CONSTANT: alike, FACTORS: wide}
    found = {**own, **{name: replace(stored, covariances=each) for name, each in added.items()}}
    return {name: found[name] for name in MODELS if name in found}


def mean_bounds(terms: Array, block: int) -> Array:
    """Bounds (2,) of the 95 % interval of a mean of correlated terms (n,)."""
    return block_bootstrap(np.mean, [terms], block, np.random.default_rng(0), vectorized=True)


def measure(models: Mapping[str, Comparison]) -> list[dict[str, Any]]:
    """The measures of every model on a drive."""
    stored = models[STORED]
    rows = []
    for name, seen in models.items():
        measures = seen.measures
        row = {
            "model": name,
            "log score": measures.log_score,
            "ANEES": measures.anees,
            **dict(zip(DIRECTIONS, measures.whitened_squares, strict=True)),
            **dict(zip(LEVELS, measures.coverage, strict=True)),
            **dict(zip((f"RMSE of {each}" for each in DIRECTIONS), measures.rmse, strict=True)),
            "estimates": len(seen.times),
            "independent": len(seen.times) / seen.block,
            "accepted": seen.share,
            "gross": (np.abs(seen.errors) > GROSS).any(axis=1).mean(),
            "ANEES bounds": mean_bounds((seen.whitened.values**2).mean(axis=-1), seen.block),
        }
        shared = np.isin(seen.times, stored.times), np.isin(stored.times, seen.times)
        each = [
            log_score(own.errors[both], own.covariances[both])
            for own, both in zip((seen, stored), shared, strict=True)
        ]
        difference = each[0] - each[1]
        row["difference"] = float(difference.mean())
        row["difference bounds"] = mean_bounds(difference, seen.block)
        rows.append(row)
    return rows


class ProtocolResult(NamedTuple):
    """The budget that each drive of a data set is judged with, and a row for each measure."""

    budgets: dict[str, BudgetFit]
    rows: pd.DataFrame


def load_and_compare(source: Source, cell: Cell, fitted: ErrorBudget) -> dict[str, Comparison]:
    """The tracks of a cell from files."""
    drive, alone = source.load(), DATA_SETS[source.data_set].alone
    budgets = {STORED: drive.budget}
    if cell == CELLS[ALL]:  # with fewer sensors the others say nothing new
        budgets = {BARE: None, EMPTY: ErrorBudget(), FITTED: fitted} | budgets
    return {name: compare_cell(drive, cell, alone, budget) for name, budget in budgets.items()}


def protocol(sources: Sequence[Source]) -> ProtocolResult:
    """Judge every model in every cell on each drive of a data set, fitted to the others."""
    stored = DATA_SETS[sources[0].data_set].budget
    each = joblib.Parallel()(map(joblib.delayed(lambda s: unfiltered(s.load())), sources))
    drives = dict(zip([source.name for source in sources], each, strict=True))
    budgets = {name: fitted_budget(others(drives, name), stored) for name in drives}
    run = joblib.delayed(load_and_compare)
    tracks = iter(
        joblib.Parallel()(
            run(s, cell, budgets[s.name].budget) for cell in CELLS.values() for s in sources
        )
    )
    return ProtocolResult(
        budgets, rows_of({cell: {name: next(tracks) for name in drives} for cell in CELLS})
    )


def rows_of(cells: Mapping[str, Mapping[str, Tracks]]) -> pd.DataFrame:
    """A row for each cell, drive and model; nothing is fitted in another cell than all sensors."""
    whole = {name: own[STORED] for name, own in cells[ALL].items()}
    fits = {
        name: (constant_matrix(others(whole, name)), three_factors(others(whole, name)))
        for name in whole
    }
    return pd.DataFrame(
        [
            {"cell": cell, "drive": name, **row}
            for cell, drives in cells.items()
            for name, own in drives.items()
            if min(len(each.times) for each in own.values()) >= FEWEST
            for row in measure(stated_by_models(own, *fits[name]))
        ]
    )
