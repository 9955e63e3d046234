"""The exhaustive evaluation: more than a million registrations, one table.

``chapters/results/exhaustive.csv`` has one row for each condition; ``python -m d2d.study.beyond``
computes it, and `recompute` any single condition.
"""

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray

from d2d._types import Array
from d2d.cost import CorruptedGaussian, RegistrationCost
from d2d.credibility import credibility
from d2d.registration import ANNEALED, start_grid
from d2d.study.beyond.random_scenes import RandomScenes
from d2d.study.plane.evaluation import at_truth, distance_and_rotation, rms
from d2d.study.plane.scenarios import OVERLAPPED
from d2d.study.results import results_path
from d2d.study.runs import MonteCarlo, monte_carlo, scheduled

TABLE = results_path("exhaustive.csv")  # of the book
_TURNS = np.deg2rad([-20.0, 0.0, 20.0])
# Offsets of the starts from the given one, on a grid 3 m apart, by the number of starts.
GRIDS: dict[int, Array] = {
    1: np.zeros((1, 3)),
    9: start_grid(3.0, 3.0, [0.0]),
    27: start_grid(3.0, 3.0, _TURNS),
    75: start_grid(6.0, 3.0, _TURNS),
    405: start_grid(12.0, 3.0, np.deg2rad([-60.0, -30.0, 0.0, 30.0, 60.0])),
}
# Runs by the number of starts: with 1000 runs the standard error of a share is no more than 1.6
# percentage points, and no condition takes more than a few seconds.
RUNS = {1: 1000, 9: 1000, 27: 200, 75: 200, 405: 100}


@dataclass(frozen=True)
class Trial:
    """One condition of the evaluation; the defaults are common to all factors."""

    factor: str  # whose evaluation it belongs to
    cost: str  # "sum", "likelihood" or "robust"
    # parameters of `RandomScenes`
    size: int = 20
    outlier_share: float = 0.2
    overlap: float = 1.0
    spacing_m: float = 2.0
    field_deg: float = 40.0
    noise: float = 1.0  # standard deviations over the thesis's, 0.2 m and 0.03 rad
    reported: float = 1.0
    # share and standard deviation of the outliers that the robust cost assumes
    alpha: float = 0.2
    sigma_outlier_m: float = 10.0
    # offset of the start from the truth
    distance_m: float = 0.0
    direction_deg: float = 0.0
    turn_deg: float = 0.0
    scales: str = "1"  # inflation schedule, joined by spaces
    starts: int = 1  # a key of `GRIDS`

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments of `monte_carlo`, with the same draws for all trials of the same scenes."""
        scene = RandomScenes(
            sigma_range=self.noise * OVERLAPPED.sigma_range,
            sigma_azimuth=self.noise * OVERLAPPED.sigma_azimuth,
            size=self.size,
            outlier_share=self.outlier_share,
            overlap=self.overlap,
            spacing=self.spacing_m,
            view=float(np.deg2rad(self.field_deg)),
            reported=self.reported,
        )
        layout = (self.size, self.outlier_share, self.overlap, self.spacing_m, self.field_deg)
        seed = zlib.crc32(repr((*layout, self.noise, self.reported)).encode())
        bearing = np.deg2rad(self.direction_deg)
        offset = [
            self.distance_m * np.cos(bearing),
            self.distance_m * np.sin(bearing),
            np.deg2rad(self.turn_deg),
        ]
        starts = scene.theta + offset + GRIDS[self.starts]
        cost = RegistrationCost(fusion="summing" if self.cost == "sum" else "likelihood")
        if self.cost == "robust":
            spread = self.sigma_outlier_m**2 * np.eye(2)
            cost = RegistrationCost(outlier=CorruptedGaussian(self.alpha, spread))
        return {
            "scenario": scene,
            "cost": cost,
            "runs": RUNS[self.starts],
            "seed": seed,
            "initial": starts[0] if self.starts == 1 else starts,
            "scales": tuple(map(float, self.scales.split())),
        }


def outcome(result: MonteCarlo) -> dict[str, float]:
    """Summarise the runs of one trial; a row of the table is a trial and its outcome.

    ``covered`` are the converged runs whose 95 % region contains the truth.  The root mean square
    errors are those of the runs at the truth (nan if there are none), the indices those of the
    converged ones; the iterations are the mean of a run over all its scales and starts.
    """
    converged = result.converged
    right = converged & at_truth(result.errors)
    distance, turn = distance_and_rotation(result.errors[right])
    errors = result.errors[converged].copy()
    errors[:, 2] = np.angle(np.exp(1j * errors[:, 2]))
    indices = credibility(errors, result.covariances[converged])
    return {
        "runs": len(converged),
        "converged": int(converged.sum()),
        "at_truth": int(right.sum()),
        "covered": int((indices.nees < scipy.special.chdtri(3, 0.05)).sum()),
        "rmse_m": rms(distance),
        "rmse_deg": float(np.rad2deg(rms(turn))),
        "anees": indices.anees,
        "nci_db": indices.nci,
        "inclination_db": indices.inclination,
        "iterations": float(result.iterations.mean()),
    }


ANNEALING = " ".join(f"{scale:g}" for scale in ANNEALED)
SCHEDULES = ("1", "2 1", "4 2 1", "8 4 2 1", "10 1", ANNEALING, "20 10 5.5 3.2 1.7 1")
FIRST_SCALES = (1.0, 3.2, 10.0, 32.0, 100.0, 316.0)


def _off(distance: float, turn: float, direction: float = 180.0) -> dict[str, Any]:  # m, deg
    return {"distance_m": distance, "direction_deg": direction, "turn_deg": turn}


FROM_ZERO = _off(5.0, -15.0)  # minus the true motion, so that the start is zero
ALPHAS = (0.01, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9)
OUTLIER_SIGMAS = (1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 100.0)  # m
DISTANCES = (0.0, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0)  # m
TURNS = (0.0, 10.0, 20.0, 30.0, 45.0, 60.0, 90.0)  # deg
DIRECTIONS = (0.0, 90.0, 180.0, 270.0)  # deg

# One factor varies at a time, everything else is as in `Trial`.
SINGLE_FACTORS: dict[str, list[dict[str, Any]]] = {
    "noise": [{"noise": x} for x in (0.1, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0)],
    "size": [{"size": x} for x in (5, 10, 15, 20, 30, 40, 50)],
    "outliers": [{"outlier_share": x / 10} for x in range(10)],
    "overlap": [{"overlap": x / 10, "outlier_share": 0.0} for x in range(2, 11)],
    "spacing": [{"spacing_m": x} for x in (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0)],
    "field": [
        {"field_deg": x, "spacing_m": 0.5} for x in (5.0, 10.0, 15.0, 20.0, 30.0, 40.0, 60.0, 90.0)
    ],
    "reported": [{"reported": x} for x in (0.25, 0.5, 0.7, 1.0, 1.4, 2.0, 4.0)],
}


def trials() -> list[Trial]:
    """All conditions of the evaluation."""
    return [*_single_factors(), *_starts(), *_outlier_models(), *_schedules(), *_first_scales()]


def _single_factors() -> Iterator[Trial]:
    plain = [("sum", "1"), ("likelihood", "1"), ("robust", "1")]
    for factor, values in SINGLE_FACTORS.items():
        for value, (cost, scales) in product(values, plain):
            yield Trial(factor, cost, scales=scales, **value)
        for value, (cost, scales) in product(values, [*plain[1:], ("robust", ANNEALING)]):
            yield Trial(factor, cost, scales=scales, **value, **FROM_ZERO)


def _starts() -> Iterator[Trial]:
    methods = [("likelihood", "1"), ("robust", "1"), ("robust", ANNEALING)]
    for (cost, scales), distance, turn in product(methods, DISTANCES, TURNS):
        for direction in DIRECTIONS if distance else DIRECTIONS[:1]:
            yield Trial("start", cost, scales=scales, **_off(distance, turn, direction))


def _outlier_models() -> Iterator[Trial]:
    starts: tuple[dict[str, Any], ...] = ({}, FROM_ZERO)
    for share, alpha, sigma, start in product((0.2, 0.4), ALPHAS, OUTLIER_SIGMAS, starts):
        model = {"outlier_share": share, "alpha": alpha, "sigma_outlier_m": sigma}
        yield Trial("outlier model", "robust", **model, **start)


def _schedules() -> Iterator[Trial]:
    for distance, turn in ((1.0, -3.0), (2.0, -6.0), (5.0, -15.0), (10.0, -30.0), (15.0, -60.0)):
        start = _off(distance, turn)
        for cost, scales in product(("sum", "likelihood", "robust"), SCHEDULES):
            yield Trial("schedule", cost, scales=scales, **start)
        for cost, starts in product(("likelihood", "robust"), (9, 27, 75, 405)):
            yield Trial("schedule", cost, starts=starts, **start)
        for cost in ("likelihood", "robust"):
            yield Trial("schedule", cost, scales=ANNEALING, starts=9, **start)


def _first_scales() -> Iterator[Trial]:
    noises, distances = (0.1, 0.25, 0.5, 1.0, 2.0), (2.0, 5.0, 10.0)
    for noise, first, distance in product(noises, FIRST_SCALES, distances):
        # down to 1 in equal ratios, four steps to a decade
        steps = np.geomspace(first, 1.0, round(4 * np.log10(first)) + 1)
        start, scales = _off(distance, -3.0 * distance), " ".join(f"{scale:.3g}" for scale in steps)
        yield Trial("first scale", "robust", noise=noise, scales=scales, **start)


def simulate(trial: Trial) -> MonteCarlo:
    """The runs of one trial, drawn from its seed."""
    return monte_carlo(**trial.arguments)


def recompute(trial: Trial) -> dict[str, float]:
    """Recompute the outcome of one trial from its seed."""
    return outcome(simulate(trial))


def inlier_shares(trial: Trial) -> tuple[Array, NDArray[np.bool_]]:
    """Mean inlier probability (runs,) at the optima of other draws, and whether each is right."""
    given = trial.arguments
    scene, cost, start = given["scenario"], given["cost"], np.atleast_2d(given["initial"])[0]
    fixed, moving = scene.sample(given["runs"], np.random.default_rng([given["seed"], 1]))
    theta = scheduled(fixed, moving, cost, start, given["scales"]).theta
    inliers = cost.inlier_probabilities(theta, fixed, moving)
    return inliers.mean(axis=-1), at_truth(theta - scene.theta)


def table_of(trials: Sequence[Trial], outcomes: Sequence[dict[str, float]]) -> pd.DataFrame:
    """Return a row for each trial: its parameters, with their units in the names, and outcome."""
    pairs = zip(trials, outcomes, strict=True)
    return _with_shares(pd.DataFrame([vars(trial) | result for trial, result in pairs]))


def _with_shares(rows: pd.DataFrame) -> pd.DataFrame:
    success, coverage = rows.at_truth / rows.runs, rows.covered / rows.converged
    return rows.assign(success=success, coverage=coverage)


def write_table(path: Path, rows: pd.DataFrame) -> None:
    """Write the rows as comma-separated values, floats with five significant digits."""
    stored = rows.drop(columns=["success", "coverage"])
    stored.to_csv(path, index=False, float_format="%.5g", na_rep="nan", lineterminator="\n")


def read_table(path: Path = TABLE) -> pd.DataFrame:
    """Read what `write_table` wrote; by default the book's table."""
    return _with_shares(pd.read_csv(path, dtype=get_type_hints(Trial)))


def select(rows: pd.DataFrame, factor: str, **wanted: Any) -> pd.DataFrame:
    """Return the rows of a factor whose parameters have the ``wanted`` values, in order."""
    chosen = rows.factor == factor
    for name, value in wanted.items():
        chosen &= rows[name] == value
    return rows[chosen]


def span(values: Sequence[float], holds: Sequence[bool]) -> str:
    """The longest range of neighbouring values for which a condition holds, in words."""
    ranges: list[list[float]] = [[]]
    for value, met in zip(values, holds, strict=True):
        if met:
            ranges[-1].append(value)
        elif ranges[-1]:
            ranges.append([])
    longest = max(ranges, key=len)
    if len(longest) < 2:
        return f"{longest[0]:g} only" if longest else "nowhere"
    return f"{longest[0]:g} to {longest[-1]:g}"
