"""CPU time of a round in a `Tracker`, and its memory over an hour: python -m benchmarks.live"""

import argparse
import resource
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from d2d import rigid
from d2d.radar import ErrorBudget, Mounting, RadarScan, Tracker, doppler_velocity, simulate_drive

CORNERS = [Mounting(x, y, yaw) for x, y, yaw in (
    (3.7, 0.8, 0.7), (3.7, -0.8, -0.7), (-0.8, 0.8, 2.4), (-0.8, -0.8, -2.4)
)]  # fmt: skip
BUDGET = ErrorBudget(azimuth=0.002, doppler=0.04, lag=0.01, neighbours=1.0)
THETA = np.array([12.0, 0.0, 0.05])
SIGMAS = (0.1, 0.005, 0.06)  # m, rad, m/s
NEAR, FAR, ASIDE = 8.0, 70.0, 0.9  # m, m, rad: where a radar sees
MISSED = 0.1  # share of the targets
DURATION = 10.0  # s, of the drive whose rounds are timed


def scan_of(
    points: np.ndarray, when: float, at: Mounting, targets: int, rng: np.random.Generator
) -> RadarScan:
    """What a radar sees of points (n, 2) in the world."""
    pose = rigid.compose(rigid.exponential(when * THETA), [at.x, at.y, at.yaw])
    x, y = rigid.transform_means(rigid.inverse(pose), points).T
    distance, azimuth = np.hypot(x, y), np.arctan2(y, x)
    seen = (distance > NEAR) & (distance < FAR) & (np.abs(azimuth) < ASIDE)
    seen = np.flatnonzero(seen & (rng.random(len(points)) > MISSED))[:targets]
    true = distance[seen], azimuth[seen], doppler_velocity(THETA, azimuth[seen], at)
    measured = [
        value + sigma * rng.standard_normal(len(seen))
        for value, sigma in zip(true, SIGMAS, strict=True)
    ]
    return RadarScan(when, *measured, *SIGMAS)


def bend(sensors: int, rate: float, targets: int) -> Iterator[tuple[str, RadarScan]]:
    """The scans of a car's radars in time order."""
    rng = np.random.default_rng(1)
    low, high = np.array([-FAR, -FAR]), np.array([12.0 * DURATION + FAR, 30.0 + FAR])
    each = 0.6 * ASIDE * (FAR**2 - NEAR**2)  # m^2 that hold the targets of a scan, and some more
    points = rng.uniform(low, high, (int(targets * np.prod(high - low) / each), 2))
    for k in range(round(DURATION * rate)):
        for s, at in enumerate(CORNERS[:sensors]):
            yield str(s), scan_of(points, k / rate + 0.013 * s, at, targets, rng)


def latency(sensors: int, rate: float, targets: int) -> str:
    """CPU time from the last scan of a round to its estimate."""
    own = Tracker({str(s): at for s, at in enumerate(CORNERS[:sensors])}, budget=BUDGET)
    spent, sizes = [], []
    for name, scan in bend(sensors, rate, targets):
        start = time.process_time()
        estimates = own.add(name, scan)
        passed = time.process_time() - start
        sizes.append(scan.size)
        spent += [1e3 * passed] * len(estimates)
    return (
        f"{sensors} x {np.mean(sizes):.0f} targets, a round each {1e3 / rate:.0f} ms: "
        f"{np.median(spent):.1f} ms, 99 %: {np.quantile(spent, 0.99):.1f} ms; {own.track}"
    )


def growth(minutes: int) -> str:
    """How much memory a tracker takes while the same minute comes again and again."""
    minute = simulate_drive(np.random.default_rng(0), duration=59.9)
    own, used = Tracker({"front": minute.mounting}, budget=BUDGET, keep=100), []
    for k in range(minutes):
        for scan in minute.scans:
            own.add("front", replace(scan, time=scan.time + 60.0 * k))
        used.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)
    return f"{minutes} minutes: {used[0]:.0f} MB after the first, {used[-1]:.0f} MB after the last"


def main() -> None:
    """Print both."""
    parser = argparse.ArgumentParser("benchmarks.live", description=__doc__)
    parser.add_argument("--minutes", type=int, default=60, help="of the drive (default: 60)")
    minutes = parser.parse_args().minutes
    print(latency(4, 1.0 / 0.075, 200))
    print(latency(1, 20.0, 1000))
    print(growth(minutes))


if __name__ == "__main__":
    main()
