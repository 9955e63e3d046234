"""The covariance of a track on simulated vehicles, which move evenly, as on a road, or harder."""

from collections.abc import Mapping
from itertools import product
from typing import Any

import joblib
import numpy as np

from d2d import rigid
from d2d._types import Array
from d2d.radar import ErrorBudget, Mounting, RadarScan, doppler_velocity, track
from d2d.radar.simulation.drive import CAR_SPEED, ROAD_SPEED, ROBOT_SPEED
from d2d.radar.simulation.world import lap_motion
from d2d.radar.tracks.path import integrate
from d2d.scores import normalised_squares
from d2d.study.road.markdown import markdown, write_page

SPEEDS = {"car on a road": ROAD_SPEED, "car, hard": CAR_SPEED, "robot": ROBOT_SPEED}
RUNS, SECONDS = 40, 2.0
RATES, RADARS = (4.0, 10.0, 25.0), (1, 4, 5)
PLACES = (
    *(Mounting(3.7), Mounting(3.6, 0.9, 1.2), Mounting(3.6, -0.9, -1.2)),
    *(Mounting(-0.9, 0.8, 2.5), Mounting(-0.9, -0.8, -2.5)),
)
SIGMAS = np.array([[0.15], [np.deg2rad(0.5)], [0.06]])  # of range, azimuth and Doppler velocity
BUDGET = ErrorBudget(azimuth=float(np.deg2rad(0.1)), doppler=0.04, scale=0.0013, lag=0.015)
STEP, BEFORE = 2e-3, 0.5  # s, of the true path, and since when it is known
POINTS, REACH, TARGETS = 800, 45.0, 60  # m to either side of the path; of a scan
HEAD = ("vehicle", "Hz", "radars", "causal", "smooth", "causal, budget", "smooth, budget")


def velocities(vehicle: str, times: Array, start: float) -> Array:
    """Velocities (n, 3) of a vehicle at times (n,), which has driven for ``start`` minutes."""
    if vehicle in SPEEDS:
        return lap_motion(times, 60.0 * start, SPEEDS[vehicle]).theta
    waves = np.sin((times[:, None] + 60.0 * start) * [0.2, 0.5, 0.3])  # of a train
    return np.asarray([35.0, 0.0, 0.0] + [3.0, 0.02, 0.02] * waves)


def squares(vehicle: str, rate: float, radars: int, budget: ErrorBudget, seed: int) -> Array:
    """NEES / 3 (2, 3) of the first estimates, the middle third and the last, causal and smooth.

    Nan without any.  The radars measure in turn, and have errors as in the budget.
    """
    rng = np.random.default_rng([seed, radars, int(rate)])
    grid = np.arange(0.0, SECONDS + 2.0 * BEFORE, STEP)
    theta = velocities(vehicle, grid, rng.uniform())
    poses = integrate(0.5 * (theta[1:] + theta[:-1]), np.diff(grid))
    points = rng.choice(poses[:, :2], POINTS) + rng.uniform(-REACH, REACH, (POINTS, 2))

    def at(times: Any, columns: Array) -> Array:
        return np.stack([np.interp(times + BEFORE, grid, each) for each in columns.T], axis=-1)

    scale, late, *own = rng.standard_normal(2 + 2 * radars)
    sensors: dict[str, tuple[list[RadarScan], Mounting]] = {}
    for s, (place, turned, added) in enumerate(zip(PLACES, own[::2], own[1::2], strict=False)):
        scans = []
        for time in np.arange(s / radars, SECONDS * rate) / rate:
            seen = time - budget.lag * late
            back = rigid.inverse(rigid.compose(at(seen, poses), place.pose))
            x, y = (points @ rigid.rotation(back[2]).T + back[:2]).T
            distance, azimuth = np.hypot(x, y), np.arctan2(y, x)
            kept = np.flatnonzero((distance > 3.0) & (distance < 50.0) & (np.abs(azimuth) < 1.0))
            distance, azimuth = distance[kept[:TARGETS]], azimuth[kept[:TARGETS]]
            doppler = (1.0 + budget.scale * scale) * doppler_velocity(
                at(seen, theta), azimuth, place
            )
            measured = np.stack(
                [distance, azimuth + budget.azimuth * turned, doppler + budget.doppler * added]
            )
            measured += SIGMAS * rng.standard_normal(measured.shape)
            scans.append(RadarScan(float(time), *measured, *SIGMAS[:, 0]))
        sensors[str(s)] = scans, place
    found = np.full((2, 3), np.nan)
    for each, smooth in zip(found, (False, True), strict=True):
        driven = track(sensors, budget=budget, smooth=smooth)
        good = driven.converged
        if good.any():
            errors = driven.theta[good] - at(driven.times[good], theta)
            terms = normalised_squares(errors, driven.covariance[good]) / 3.0
            third = len(terms) // 3
            each[:] = terms[0], terms[third : len(terms) - third].mean(), terms[-1]
    return found


def write(_: Mapping[str, Any]) -> None:
    """Simulate all vehicles, with and without errors in common, and write the table."""
    run, budgets = joblib.delayed(squares), (ErrorBudget(), BUDGET)
    lines = []
    for vehicle, rate, radars in product((*SPEEDS, "train"), RATES, RADARS):
        calls = [run(vehicle, rate, radars, b, seed) for b in budgets for seed in range(RUNS)]
        found = np.reshape(joblib.Parallel()(calls), (2, RUNS, 2, 3))
        means = np.nanmean(found, axis=1).reshape(4, 3)
        cells = [" / ".join(f"{anees:.2f}" for anees in row) for row in means]
        lines.append((vehicle, f"{rate:g}", str(radars), *cells))
    write_page("road_simulated.md", "d2d.study.road simulated", [markdown(HEAD, lines)])
