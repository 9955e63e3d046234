"""Why a covariance is too small, and which tests can tell without a reference."""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from d2d import Credibility, PointSet, RegistrationCost, credibility, register, rigid
from d2d._types import Array
from d2d.problem import Estimate
from d2d.radar import (
    Drive,
    ErrorBudget,
    Mounting,
    Sensor,
    SensorErrors,
    build_world,
    compare,
    compare_halves,
    compare_tracks,
    simulate_drive,
    track,
)
from d2d.radar.simulation.drive import CAR_SPEED
from d2d.study.guides.stated_sigmas import scaled
from d2d.study.plane.evaluation import LIKELIHOOD, ROBUST, SUMMING
from d2d.study.plane.scenarios import OUTLIERS, OVERLAPPED
from d2d.study.runs import credibility_of

COUNTS = (12, 24, 48, 96)  # targets that a scan keeps
BIAS = float(np.deg2rad(1.0))  # of all azimuths of a sensor

COPIES = 5  # of each target, where targets are repeated
TURN = float(np.deg2rad(5.0))  # of a whole point set, about its sensor

_DURATION = 20.0  # s
_PLACES = (Mounting(3.7, 0.5, 0.0), Mounting(3.7, -0.5, 0.0))  # two radars that look ahead


# ---- Point sets


def residual_variance(theta: Array, fixed: PointSet, moving: PointSet) -> Array:
    """Variance (N,) in m^2, per coordinate, of paired points (N, K, 2) at the motions (N, 3)."""
    residuals = rigid.transform_means(theta, moving.means) - fixed.means
    freedom = 2 * fixed.size - 3
    return np.asarray((residuals**2).sum(axis=(1, 2)) / freedom)


def repeated(points: PointSet, times: int) -> PointSet:
    """Each target as often as ``times``, with the same error in all copies."""
    return PointSet(
        np.repeat(points.means, times, axis=-2), np.repeat(points.covariances, times, axis=-3)
    )


def halves(
    fixed: PointSet,
    moving: PointSet,
    cost: RegistrationCost,
    initial: ArrayLike,
    labels: NDArray[np.int_],
) -> Credibility:
    """Register two halves of the moving sets (N, K) with the fixed ones, and judge the difference.

    Each run draws its own halves; targets of the same label (K,) stay together.  True covariances
    of independent halves add up to that of the differences.
    """
    names, runs = np.unique(labels), len(moving.means)
    drawn = np.random.default_rng(0).permuted(np.tile(names, (runs, 1)), axis=1)
    chosen = drawn[:, : len(names) // 2]
    first = (labels[None, :, None] == chosen[:, None, :]).any(axis=-1)

    def half(mask: NDArray[np.bool_]) -> Estimate:
        means, covariances = moving.means[mask], moving.covariances[mask]
        chosen = PointSet(means.reshape(runs, -1, 2), covariances.reshape(runs, -1, 2, 2))
        return register(fixed, chosen, cost, initial)

    one, two = half(first), half(~first)
    both = one.converged & two.converged
    return credibility((one.theta - two.theta)[both], (one.covariance + two.covariance)[both])


# Fixed and moving sets, cost, start, and which of the moving targets (K,) stay together.
Case = tuple[PointSet, PointSet, RegistrationCost, ArrayLike, NDArray[np.int_]]


@cache
def halves_of_each_reason() -> list[tuple[str, float, float]]:
    """ANEES of whole sets and of halves for each reason, by target, and by copy if repeated."""
    rows = []
    for name, case in _cases().items():
        whole = credibility_of(register(*case[:4]), OVERLAPPED.theta)
        rows.append((name, float(whole.anees), float(halves(*case).anees)))
    return rows


def _cases() -> dict[str, Case]:
    theta, zero = OVERLAPPED.theta, np.zeros(3)
    whole, partly = (
        scene.sample(1000, np.random.default_rng(0)) for scene in (OVERLAPPED, OUTLIERS)
    )
    eight, ten, copies = (np.arange(count) for count in (8, 10, 8 * COPIES))
    fixed, moving = (repeated(points, COPIES) for points in whole)
    narrow_fixed, narrow_moving = (points.inflated(0.5) for points in whole)
    turned = whole[1].transformed([0.0, 0.0, TURN])
    return {
        "nothing wrong": (*whole, LIKELIHOOD, theta, eight),
        "1 sigmas half as large": (narrow_fixed, narrow_moving, LIKELIHOOD, theta, eight),
        "2 start at zero": (*partly, ROBUST, zero, ten),
        "3 repeated, by point": (fixed, moving, LIKELIHOOD, theta, copies),
        "3 repeated, by target": (fixed, moving, LIKELIHOOD, theta, np.repeat(eight, COPIES)),
        "4 turned by 5 deg": (whole[0], turned, LIKELIHOOD, theta, eight),
        "5 P2D": (*whole, RegistrationCost("p2d"), theta, eight),
        "5 sum": (*whole, SUMMING, theta, eight),
        "6 no partner": (*partly, LIKELIHOOD, theta, ten),
    }


# ---- Drives


@cache
def bias_against_targets() -> pd.DataFrame:
    """Track a front radar turned by `BIAS`, with more and more targets: its lateral velocity.

    Errors (RMSE) and stated standard deviations (m/s) over three drives: of bare pairs with the
    inverse Hessian, and with a budget.
    """
    rows = []
    for count in COUNTS:
        sensor = Sensor(max_targets=count, half_range=60.0, max_range=80.0, quantised=False)
        drives = [_drive(_PLACES[0], sensor, SensorErrors(azimuth=BIAS), 11 + n) for n in range(3)]
        rows.append([np.mean([len(scan) for drive in drives for scan in drive.scans])])
        for budget in (None, ErrorBudget(azimuth=BIAS)):
            tracks = (track(d, baseline=1, budget=budget, carry=budget is not None) for d in drives)
            found = [compare(t, d.truth) for t, d in zip(tracks, drives, strict=True)]
            squares = np.concatenate([each.errors[:, 1] ** 2 for each in found])
            variances = np.concatenate([each.covariances[:, 1, 1] for each in found])
            rows[-1] += [np.sqrt(np.mean(squares)), np.sqrt(np.mean(variances))]
    columns = ["targets", "error", "stated", "budget error", "budget stated"]
    return pd.DataFrame(rows, columns=columns)


class Reason(NamedTuple):
    """Faults of a drive: unknown errors, a factor on all sigmas, turns of both radars in `BIAS`."""

    errors: SensorErrors = SensorErrors()
    factor: float = 1.0
    turned: tuple[float, float] = (0.0, 0.0)


REASONS = {
    "nothing wrong": Reason(),
    "all sigmas half as large": Reason(factor=0.5),
    "objects with a common error": Reason(SensorErrors(extent=0.3, neighbours=2.0)),
    "each sensor turned": Reason(turned=(1.0, -1.0)),
    "both sensors turned alike": Reason(turned=(1.0, 1.0)),
    "a clock 50 ms late": Reason(SensorErrors(lag=0.05)),
}


@cache
def without_truth() -> dict[str, list[float]]:
    """ANEES of one of two front radars against the truth, by halves, and by the other radar."""
    return {name: _anees_of(reason) for name, reason in REASONS.items()}


def _anees_of(reason: Reason) -> list[float]:
    sensor = Sensor(quantised=False)
    drives = [
        _drive(mounting, sensor, replace(reason.errors, azimuth=turned * BIAS), 21 + number)
        for number, (mounting, turned) in enumerate(zip(_PLACES, reason.turned, strict=True))
    ]
    scans = [[scaled(scan, reason.factor) for scan in drive.scans] for drive in drives]
    first, second = (
        track(sensor, baseline=1, carry=False) for sensor in zip(scans, _PLACES, strict=True)
    )
    halves = [
        compare_halves([(scans[0], _PLACES[0])], np.random.default_rng(1), by=unit)
        for unit in ("target", "object")
    ]
    tests = compare(first, drives[0].truth), *halves, compare_tracks(first, second)
    return [float(test.credibility.anees) for test in tests]


def _drive(mounting: Mounting, sensor: Sensor, errors: SensorErrors, seed: int) -> Drive:
    """Simulate a drive of 20 s, always through the same world."""
    world = build_world(np.random.default_rng(5))
    rng = np.random.default_rng(seed)
    return simulate_drive(
        rng, _DURATION, CAR_SPEED, mounting=mounting, sensor=sensor, world=world, errors=errors
    )
