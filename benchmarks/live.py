"""CPU time of a round in a `Tracker`, and its memory over an hour: python -m benchmarks.live"""

import argparse
import gc
import resource
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from d2d.radar import ErrorBudget, Mounting, RadarScan, Sensor, Tracker, simulate_drive
from d2d.radar.simulation.drive import CAR_SPEED
from d2d.radar.simulation.world import World, open_field

CORNERS = [Mounting(x, y, yaw) for x, y, yaw in (
    (3.7, 0.8, 0.7), (3.7, -0.8, -0.7), (-0.8, 0.8, 2.4), (-0.8, -0.8, -2.4)
)]  # fmt: skip
BUDGET = ErrorBudget(azimuth=0.002, doppler=0.04, lag=0.01, neighbours=1.0)
DURATION = 10.0  # s, of the drive whose rounds are timed
DENSITY = 0.7  # points per m^2: a scan never has fewer targets than it may have


def crowded_world(rng: np.random.Generator) -> World:
    """A plain full of strong points around the lap, with nothing that hides them."""
    return open_field(rng.uniform(-60.0, 160.0, (round(DENSITY * 220.0**2), 2)), 1e3)


def crowded_drive(sensors: int, rate: float, targets: int) -> Iterator[tuple[str, RadarScan]]:
    """The scans of a car's radars in time order."""
    rng, sensor = np.random.default_rng(1), Sensor(rate=rate, max_targets=targets, clutter=0.0)
    world = crowded_world(rng)
    drives = [
        simulate_drive(rng, DURATION, CAR_SPEED, mounting=at, sensor=sensor, world=world).scans
        for at in CORNERS[:sensors]
    ]
    for scans in zip(*drives, strict=True):
        yield from ((str(s), scan) for s, scan in enumerate(scans))


def latency(sensors: int, rate: float, targets: int) -> str:
    """CPU time from the last scan of a round to its estimate."""
    own = Tracker({str(s): at for s, at in enumerate(CORNERS[:sensors])}, budget=BUDGET)
    gc.freeze()
    spent, sizes = [], []
    for name, scan in crowded_drive(sensors, rate, targets):
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
    """Print all."""
    parser = argparse.ArgumentParser("benchmarks.live", description=__doc__)
    parser.add_argument("--minutes", type=int, default=60, help="of the drive (default: 60)")
    minutes = parser.parse_args().minutes
    for drive in ((1, 1.0 / 0.075, 200), (4, 1.0 / 0.075, 200), (1, 20.0, 1000)):
        print(latency(*drive))
    print(growth(minutes))


if __name__ == "__main__":
    main()
