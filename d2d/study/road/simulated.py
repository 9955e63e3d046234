"""The covariance of a track on simulated vehicles, which move evenly, as on a road, or harder."""

from functools import partial
from itertools import product

import joblib
import numpy as np

from d2d._types import Array
from d2d.radar import ErrorBudget, Mounting, Sensor, SensorErrors, track
from d2d.radar.simulation.drive import CAR_SPEED, ROAD_SPEED, ROBOT_SPEED, drive_along
from d2d.radar.simulation.world import LAP, lap_motion, open_field
from d2d.scores import normalised_squares
from d2d.study.road.markdown import markdown, write_page

SPEEDS = {"car on a road": ROAD_SPEED, "car, hard": CAR_SPEED, "robot": ROBOT_SPEED, "train": 35.0}
RUNS, SECONDS, RATES, RADARS = 40, 2.0, (4.0, 10.0, 25.0), (1, 4, 5)
PLACES = [(3.7, 0.0, 0.0), (3.6, 0.9, 1.2), (3.6, -0.9, -1.2), (-0.9, 0.8, 2.5), (-0.9, -0.8, -2.5)]
SEEN = Sensor(1.0, 60, 1.0, 3.0, 50.0, 1e3, 0.15, float(np.deg2rad(0.5)), 0.06, 0.0, False)
BUDGET = ErrorBudget(azimuth=float(np.deg2rad(0.1)), doppler=0.04, scale=0.0013, lag=0.015)
HEAD = ("vehicle", "Hz", "radars", "causal", "smooth", "causal, budget", "smooth, budget")


def squares(vehicle: str, rate: float, radars: int, budget: ErrorBudget, seed: int) -> Array:
    """NEES / 3 (2, 3) of the first estimate, the middle third and the last, causal and smooth."""
    rng = np.random.default_rng([seed, radars, int(rate)])
    size = 100.0 if vehicle == "train" else 1.0
    start = rng.uniform(0.0, LAP * size / SPEEDS[vehicle])
    motion = partial(lap_motion, start=start, speed=SPEEDS[vehicle], size=size)
    path = motion(np.linspace(-0.5, SECONDS + 0.5)).poses[:, :2]
    world = open_field(rng.choice(path, 400) + rng.uniform(-45.0, 45.0, (400, 2)), 1.0)
    shared, sensors = [budget.scale, budget.lag] * rng.standard_normal(2), {}
    for s, place in enumerate(PLACES[:radars]):
        own = [budget.azimuth, budget.doppler] * rng.standard_normal(2)
        times, errors = np.arange(s / radars, SECONDS * rate) / rate, SensorErrors(*own, *shared)
        sensors[str(s)] = drive_along(rng, motion, times, Mounting(*place), SEEN, world, errors)
    found = []
    for smooth in (False, True):
        driven = track(sensors, budget=budget, smooth=smooth)
        good = driven.converged
        wrong = (driven.theta - motion(driven.times).theta)[good]
        nees = normalised_squares(wrong, driven.covariance[good]) / 3.0
        found.append([part.mean() for part in (nees[:1], np.array_split(nees, 3)[1], nees[-1:])])
    return np.array(found)


def write(_: object) -> None:
    """Simulate all vehicles, with and without errors in common, and write the table."""
    lines = []
    for vehicle, rate, radars in product(SPEEDS, RATES, RADARS):
        drives = product((ErrorBudget(), BUDGET), range(RUNS))
        calls = (joblib.delayed(squares)(vehicle, rate, radars, *each) for each in drives)
        means = np.nanmean(np.reshape(joblib.Parallel()(calls), (2, RUNS, 6)), axis=1)
        cells = [" / ".join(f"{anees:.2f}" for anees in row) for row in means.reshape(4, 3)]
        lines.append((vehicle, f"{rate:g}", str(radars), *cells))
    write_page("road_simulated.md", "d2d.study.road simulated", [markdown(HEAD, lines)])
