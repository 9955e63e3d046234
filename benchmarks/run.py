"""Measure speed and accuracy in one run, print the tables, write them into the book.

python -m benchmarks.run [--quick]

With D2D_RADARSCENES set to the folder of the data set, throughput on it is measured as well.
"""

import argparse
import os
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator

import numpy as np

from benchmarks import drive, peers, processes, report
from benchmarks.methods import Effort, all_methods
from benchmarks.scenes import accuracy, draw, known_correspondences, scene
from benchmarks.timing import exp_nanoseconds, exponent, interleaved
from d2d import RegistrationCost, register
from d2d.study.recordings.estimates import data_root

ONE_THREAD = {
    name: "1"
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "TBB_NUM_THREADS")
}
EFFORT = {
    8: Effort(1000, 1000, 100, 10, 100),
    48: Effort(1000, 200, 60, 5, 100),
    200: Effort(60, 20, 10, 2, 20),
}
QUICK = {8: Effort(50, 50, 5, 2, 10), 48: Effort(20, 20, 3, 2, 10), 200: Effort(4, 4, 2, 1, 5)}
SIZES = [8, 16, 32, 64, 125, 250, 500, 1000, 2000]
ROUNDS = 7
PACKAGES = (
    *("numpy", "scipy", "numba"),
    *("open3d", "small-gicp", "kiss-icp", "probreg", "pycpd"),
)


def in_one_thread() -> None:
    """Restart with one thread for every library: they read the setting when they are loaded."""
    if any(os.environ.get(name) != value for name, value in ONE_THREAD.items()):
        command = [sys.executable, "-m", "benchmarks.run", *sys.argv[1:]]
        sys.exit(subprocess.call(command, env=os.environ | ONE_THREAD))


def without_chatter() -> None:
    """Discard stderr: some libraries write warnings there on every call, bypassing Python."""
    sys.stdout.flush()
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    os.close(nowhere)


def rows_of(size: int, start: str, effort: Effort, exp: float) -> Iterator[report.Row]:
    """All rows of one size and start, the floors last."""
    draws = draw(scene(size), effort.runs, seed=1)
    floor = known_correspondences(draws)
    zero = start == "zero"
    methods = list(all_methods(draws, draw(scene(size), effort.pilot, seed=2), start, effort))
    judged = []
    for method in methods:  # also compiles and warms up
        estimates = method.motions(method.solve(method.runs))
        judged.append(accuracy(estimates, floor, draws.theta, only_at_truth=zero))
        method.solve(method.timed)
    seconds = interleaved(methods, ROUNDS)
    for method, (times, busy), result in zip(
        methods, np.moveaxis(seconds, -1, 1), judged, strict=True
    ):
        yield report.Row(
            size,
            start,
            method.cost,
            method.name,
            times.min(),
            np.median(times),
            method.runs,
            result,
            busy.sum() / times.sum(),
        )
    if not zero:
        known = accuracy(floor, floor, draws.theta, only_at_truth=False)
        name = "floor: least squares, pairs known"
        nan = float("nan")
        yield report.Row(size, start, "pairs known", name, nan, nan, len(draws), known)
    estimate = register(draws.fixed, draws.moving, None, np.zeros(3) if zero else draws.theta)
    bare = (1.0 + estimate.iterations.mean()) * size**2 * exp
    name = "floor: bare exp of all pairs"
    yield report.Row(size, start, "likelihood", name, bare, bare, 0, None)


def against_size(quick: bool) -> list[float]:
    """Seconds per registration from the truth, in a batch, at every size."""
    best = []
    for size in SIZES[:4] if quick else SIZES:
        draws = draw(scene(size), max(2, 4000 // size), seed=3)

        def solve(draws=draws):
            return register(draws.fixed, draws.moving, RegistrationCost(), draws.theta)

        solve()
        times = []
        for _ in range(3):
            begin = time.perf_counter()
            solve()
            times.append((time.perf_counter() - begin) / len(draws))
        best.append(min(times))
    return best


def measure(quick: bool) -> report.Measured:
    """Measure everything, printing a line of progress for each part."""

    def say(what: str) -> None:
        print(f"{time.perf_counter() - began:6.1f} s  {what}", flush=True)

    began = time.perf_counter()
    missing = {}
    for peer in peers.PEERS:
        library, why = peers.load(peer.module)
        if library is None:
            missing[peer.module] = why
    say("start-up, compilation and memory")
    imported, first_call = processes.import_seconds(), processes.first_call_seconds()
    peaks = {runs: processes.peak_megabytes(runs) for runs in (1000, 1000 if quick else 100_000)}
    exp = exp_nanoseconds()
    rows = []
    for size, effort in (QUICK if quick else EFFORT).items():
        for start in ("truth", "zero"):
            say(f"{size} × {size} targets from {start}")
            rows += rows_of(size, start, effort, exp["NumPy array"] * 1e-9)
    say("time against size")
    seconds = against_size(quick)
    sizes = SIZES[: len(seconds)]
    root = data_root()
    say("RadarScenes" if root else "RadarScenes: D2D_RADARSCENES is not set")
    throughput = drive.measure(root) if root else None
    say("done")
    return report.Measured(
        processes.machine(),
        processes.versions(PACKAGES),
        missing,
        exp,
        rows,
        sizes,
        seconds,
        exponent(sizes, seconds),
        imported,
        first_call,
        peaks,
        throughput,
    )


def main() -> None:
    """Measure, print the tables and write them into the book."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--quick", action="store_true", help="a few runs as a trial; writes nothing"
    )
    arguments = parser.parse_args()
    in_one_thread()
    warnings.simplefilter("ignore")
    without_chatter()
    measured = measure(arguments.quick)
    print(report.page(measured))
    if not arguments.quick:
        report.write(measured)


if __name__ == "__main__":
    main()
