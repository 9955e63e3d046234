"""Known errors, added one at a time, and whether a budget of them restores a true covariance."""

from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import scipy

from d2d import block_bootstrap
from d2d._types import Array
from d2d.radar import (
    Drive,
    ErrorBudget,
    RadarScan,
    Sensor,
    SensorErrors,
    build_world,
    quantisation_sigma,
    simulate_drive,
    track,
)
from d2d.radar.simulation.drive import CAR_MOUNTING, CAR_SPEED, STEPS
from d2d.radar.simulation.world import LAP
from d2d.scores import normalised_squares, within

SEED = 17
DRIVES = 30
# An error is constant in a drive, so many short drives tell more than a few long ones.
DURATION = 2.0  # s
COVARIANCES = ("inverse Hessian", "propagated noise", "noise and budget")


class Ingredient(NamedTuple):
    """Errors put into a drive: shared ones with the standard deviations of a budget, and others.

    ``stated`` says whether the estimator knows the extent and the rounding.
    """

    budget: ErrorBudget = ErrorBudget()
    extent: float = 0.0  # m
    rounding: float = 0.0  # in steps of the sensor; 0 for a sensor that does not round
    stated: bool = True


_EXTENT, _ROUNDING = 0.3, 4.0
_ALL = ErrorBudget(
    azimuth=float(np.deg2rad(0.5)), doppler=0.05, scale=0.005, lag=0.05, neighbours=1.0
)
INGREDIENTS = {
    "no error": Ingredient(),
    "extent, not stated": Ingredient(extent=_EXTENT, stated=False),
    "extent": Ingredient(extent=_EXTENT),
    "extent, neighbours correlated": Ingredient(ErrorBudget(neighbours=_ALL.neighbours), _EXTENT),
    "rounding, not stated": Ingredient(rounding=_ROUNDING, stated=False),
    "rounding": Ingredient(rounding=_ROUNDING),
    "azimuth bias": Ingredient(ErrorBudget(azimuth=_ALL.azimuth)),
    "shared Doppler error": Ingredient(ErrorBudget(doppler=_ALL.doppler)),
    "scale": Ingredient(ErrorBudget(scale=_ALL.scale)),
    "lag": Ingredient(ErrorBudget(lag=_ALL.lag)),
    "all": Ingredient(_ALL, _EXTENT, _ROUNDING),
}


class TrialErrors(NamedTuple):
    """Errors of the estimates of several drives with each of `COVARIANCES`.

    The inverse Hessian is that of bare pairs, the two others are of filtered velocities.
    """

    errors: Array  # (3, n, 3) in m/s, m/s, rad/s
    covariances: Array  # (3, n, 3, 3)
    drive: Array  # (n,), the number of the drive

    @property
    def nees(self) -> Array:
        """Normalised squares (3, n) per dimension, with each covariance."""
        each = zip(self.errors, self.covariances, strict=True)
        return np.stack([normalised_squares(*pair) / 3.0 for pair in each])

    @property
    def anees(self) -> Array:
        """Average NEES (3,)."""
        return np.asarray(self.nees.mean(axis=1))

    @property
    def interval(self) -> Array:
        """95 % interval (2, 3) of the average NEES; whole drives are drawn anew."""
        drives = [self.nees[:, self.drive == k].mean(axis=1) for k in np.unique(self.drive)]
        rng = np.random.default_rng(0)
        return block_bootstrap(lambda rows: rows.mean(axis=0), [np.array(drives)], 1, rng)

    @property
    def covered(self) -> Array:
        """Share (3,) of the errors within the 95 % region."""
        each = zip(self.errors, self.covariances, strict=True)
        return np.array([within(*pair, [0.95]).mean() for pair in each])


def budget_trial(names: Iterable[str] = INGREDIENTS) -> dict[str, TrialErrors]:
    """Switch on each ingredient alone, and judge the covariances of many short drives.

    All are tried on the same drives of the car, from places all over the lap.  The last covariance
    has the budget that the errors were drawn from; its ``neighbours`` correlates all errors of the
    positions, the simulator only the extent, so that such an extent is overestimated.
    """
    return {name: trial_errors(INGREDIENTS[name]) for name in names}


def trial_errors(
    ingredient: Ingredient, drives: int = DRIVES, duration: float = DURATION
) -> TrialErrors:
    """Track drives with one ingredient from where they truly start; failures are left out."""
    errors, covariances, numbers = [], [], []
    for number, drive in enumerate(_simulated(ingredient._replace(stated=True), drives, duration)):
        truth = drive.truth.theta
        scans = [with_known_errors(scan, ingredient) for scan in drive.scans]
        options: dict[str, Any] = {"baseline": 1, "initial": truth[0], "limits": None}
        own, budget = (scans, drive.mounting), ingredient.budget
        bare, noise = (track(own, carry=carry, **options) for carry in (False, True))
        full = track(own, budget=budget, **options) if budget != ErrorBudget() else noise
        found = bare, noise, full
        good = np.logical_and.reduce([each.converged for each in found])
        errors.append(np.stack([(each.theta - truth[1:])[good] for each in found]))
        covariances.append(np.stack([each.covariance[good] for each in found]))
        numbers.append(np.full(good.sum(), number))
    wrong, stated = (np.concatenate(each, axis=1) for each in (errors, covariances))
    return TrialErrors(wrong, stated, np.concatenate(numbers))


@lru_cache(maxsize=1)  # the next ingredient may be the same, but with ``stated``
def _simulated(ingredient: Ingredient, drives: int, duration: float) -> list[Drive]:
    rng, *streams = np.random.default_rng(SEED).spawn(1 + drives)
    wrong = drawn_errors(rng, ingredient, drives)
    starts = (np.arange(drives) + rng.random(drives)) / drives * LAP / CAR_SPEED
    return [
        simulate_drive(
            stream,
            duration,
            CAR_SPEED,
            start=float(start),
            mounting=CAR_MOUNTING,
            sensor=Sensor(quantised=ingredient.rounding > 0.0),
            world=build_world(stream),
            errors=errors,
        )
        for stream, start, errors in zip(streams, starts, wrong, strict=True)
    ]


def drawn_errors(
    rng: np.random.Generator, ingredient: Ingredient, drives: int
) -> list[SensorErrors]:
    """The errors of the sensor in each drive, from the standard deviations of a budget.

    They are stratified, so that even a few drives have the intended variance.
    """
    budget, rounding = ingredient.budget, ingredient.rounding or 1.0
    sigmas = budget.azimuth, budget.doppler, budget.scale, budget.lag
    parts = [rng.permuted(np.arange(drives)) + rng.random(drives) for _ in sigmas]
    drawn = sigmas * scipy.special.ndtri(np.transpose(parts) / drives)
    shared = {"extent": ingredient.extent, "neighbours": budget.neighbours, "rounding": rounding}
    return [SensorErrors(*errors, **shared) for errors in drawn.tolist()]


def with_known_errors(scan: RadarScan, ingredient: Ingredient) -> RadarScan:
    """The scan with the known errors of its targets added to those that the sensor reports."""
    if not ingredient.stated:
        return scan
    known = scan.with_extent(ingredient.extent)
    if not ingredient.rounding:
        return known
    rounded = [quantisation_sigma(ingredient.rounding * step) for step in STEPS[:, 0].tolist()]
    return replace(
        known,
        sigma_range=np.hypot(scan.sigma_range, rounded[0]),
        sigma_azimuth=np.hypot(scan.sigma_azimuth, rounded[1]),
        sigma_doppler=np.hypot(scan.sigma_doppler, rounded[2]),
    )
