"""Covariances on the road: all models fitted and judged alike, leaving one drive out.

Page G states the protocol, which was written down before it was run.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import joblib
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from d2d import block_bootstrap, log_score
from d2d._types import Array
from d2d.problem import Estimate, Problem
from d2d.radar import Comparison, ErrorBudget, RadarScan, VehicleLimits
from d2d.radar.motion.covariance import apply_budget
from d2d.radar.motion.doppler import Acceleration
from d2d.radar.motion.model import split_options
from d2d.radar.tracks.estimator import OdometryEstimator
from d2d.radar.tracks.rounds import Round
from d2d.study.road.drive import DATA_SETS, Drive, Source
from d2d.study.road.models import ABLATIONS, CAUSES, CONSTANTS, MODELS, Estimates, Parameters

Flags = NDArray[np.bool_]
Fitted = Mapping[str, Mapping[str, Parameters]]  # by drive and model

SEED = 20
PERIOD, QUIET = 5.0, 3.0  # s: of these, the last ones are without a sensor
FEWEST = 20  # estimates of a drive in a cell, for less it is not judged there
ALL = "all"
ALL_MODELS = MODELS | ABLATIONS
DIRECTIONS = ("v_x", "v_y", "ω")
LEVELS = ("50 %", "95 %", "99 %")


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


@dataclass
class Keeping(OdometryEstimator):
    """An estimator that keeps what its last estimate came from."""

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
    """The estimates of a drive to be judged, and the share of the rounds that gave one."""

    estimates: Estimates
    share: float


def followed(rounds: Sequence[Round], budget: ErrorBudget) -> tuple[Estimates, Flags]:
    """The accepted estimates, whose errors are not known yet (nan), and which rounds they are of.

    All covariances are those at the same optimum, carried by the same acceleration.
    """
    model, scales = split_options({})
    sensors = 1 + max((each for current in rounds for each in current.sensors), default=0)
    estimator = Keeping(model, scales, None, ErrorBudget(), VehicleLimits(), sensors, records=[])
    rows, accepted = [], np.zeros(len(rounds), dtype=np.bool_)
    for i, current in enumerate(rounds):
        estimate = estimator.step(current)
        if not estimate.converged:
            continue
        accepted[i] = True
        assert estimator.records
        raw, _ = estimator.records[-1]
        problem, optimum, by = estimator.kept
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
    """Covariances (4, 3, 3) that a standard deviation of one of each cause adds."""
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


def estimated(drive: Drive, cell: Cell, alone: Mapping[str, int]) -> Found:
    """The estimates of a cell."""
    left = changed(drive, cell, alone)
    assert left.budget is not None
    estimates, accepted = followed(left.rounds, left.budget)
    times = np.array([each.time for each in left.rounds])
    wanted: Flags = np.asarray(np.isfinite(drive.reference.at(times).theta).all(axis=1))
    if cell.silence:
        start, count = drive.rounds[0].time, len(left.recordings)
        wanted &= np.logical_or.reduce([is_quiet(times, start, s, count) for s in range(count)])
    errors = estimates.theta - drive.reference.at(estimates.times).theta
    judged = estimates._replace(errors=errors).where(wanted[accepted])
    return Found(judged, float(accepted[wanted].mean()))


def load_and_estimate(source: Source, cell: Cell) -> Found:
    """The estimates of a cell from files."""
    return estimated(source.load(), cell, DATA_SETS[source.data_set].alone)


def estimate_cells(sources: Sequence[Source]) -> dict[str, dict[str, Found]]:
    """The estimates of all cells and drives of a data set."""
    each = joblib.delayed(load_and_estimate)
    found = iter(joblib.Parallel()(each(s, cell) for cell in CELLS.values() for s in sources))
    return {cell: {source.name: next(found) for source in sources} for cell in CELLS}


# ---- Fit and judgement


def fit_others(drives: Mapping[str, Estimates]) -> Fitted:
    """The parameters of every model for each drive, fitted to all others."""
    found = {}
    for held_out in drives:
        others = [own for name, own in drives.items() if name != held_out]
        found[held_out] = {name: model.fit(others) for name, model in ALL_MODELS.items()}
    return found


def measure(
    found: Found, parameters: Mapping[str, Parameters], bounds: bool
) -> list[dict[str, Any]]:
    """The measures of every model on the estimates of a drive, with intervals if wanted."""
    own = found.estimates
    stated = {name: ALL_MODELS[name].covariances(given, own) for name, given in parameters.items()}
    peer = log_score(own.errors, stated[CONSTANTS])
    rows = []
    for name, covariances in stated.items():
        seen = Comparison(own.times, own.errors, covariances, found.share, found.share)
        difference = log_score(own.errors, covariances) - peer
        row = {
            "model": name,
            "log score": seen.measures.log_score,
            "ANEES": seen.measures.anees,
            **dict(zip(DIRECTIONS, seen.measures.whitened_squares, strict=True)),
            **dict(zip(LEVELS, seen.measures.coverage, strict=True)),
            "difference": difference.mean(),
            "estimates": len(own.times),
            "independent": len(own.times) / seen.block,
            "accepted": found.share,
        }
        if bounds:
            row["ANEES bounds"] = seen.intervals().anees
            row["difference bounds"] = block_bootstrap(
                np.mean, [difference], seen.block, np.random.default_rng(0), vectorized=True
            )
        rows.append(row)
    return rows


def protocol(cells: Mapping[str, Mapping[str, Found]]) -> tuple[Fitted, pd.DataFrame]:
    """The parameters for each drive of a data set, and a row for each cell, drive and model.

    Two drives get intervals of their own; of more, the tables show the mean with its interval.
    """
    fitted = fit_others({name: found.estimates for name, found in cells[ALL].items()})
    rows = [
        {"cell": cell, "drive": name, **row}
        for cell, drives in cells.items()
        for name, found in drives.items()
        if len(found.estimates.times) >= FEWEST
        for row in measure(found, fitted[name], bounds=len(fitted) == 2)
    ]
    return fitted, pd.DataFrame(rows)
