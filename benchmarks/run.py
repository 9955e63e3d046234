"""Measure speed and accuracy in one run, print the tables, write them into the book.

python -m benchmarks.run [--quick]
"""

import argparse
import os
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator, Sequence

import numpy as np

from benchmarks import peers, processes, report
from benchmarks.methods import Effort, one_per_call, others
from benchmarks.scenes import accuracy, draw, known_correspondences, scene
from benchmarks.timing import interleaved

ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "TBB_NUM_THREADS"), "1"
)
EFFORT = {
    8: Effort(1000, 500, 100, 5, 100),
    16: Effort(1000, 300, 60, 5, 60),
    48: Effort(1000, 100, 60, 3, 60),
    100: Effort(200, 50, 20, 2, 20),
    200: Effort(100, 20, 10, 1, 20),
    500: Effort(60, 10, 5, 1, 20),
    1000: Effort(60, 5, 5, 1, 20),
    2000: Effort(40, 3, 5, 1, 20),
}
QUICK = {size: Effort(3, 3, 2, 1, 5) for size in EFFORT}
DETAILED = (8, 48, 200)  # sizes at which batches, SciPy and starts at zero are measured as well
ROUNDS = 9
PATIENCE = 0.2  # s a call
PACKAGES = ("numpy", "scipy", "numba", "open3d", "small-gicp", "kiss-icp", "probreg", "pycpd")


def in_one_thread() -> None:
    """Restart with one thread for every library: they read the setting when they are loaded."""
    if any(os.environ.get(name) != value for name, value in ONE_THREAD.items()):
        command = [sys.executable, *sys.orig_argv[1:]]
        sys.exit(subprocess.call(command, env=os.environ | ONE_THREAD))


def without_chatter() -> None:
    """Discard what libraries write to stderr on every call, bypassing Python, but no traceback."""
    sys.stdout.flush()
    sys.stderr = os.fdopen(os.dup(2), "w")
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 2)


def affordable(size: int, start: str, rows: Sequence[report.Row]) -> list[peers.Peer]:
    """The peers whose calls will take no longer than `PATIENCE`, as far as smaller sizes tell.

    The time of the slow ones grows with the pairs of targets.
    """

    def seconds(peer: peers.Peer) -> float:
        own = [row for row in rows if row.start == start and row.name.startswith(peer.name)]
        return own[-1].best * (size / own[-1].size) ** 2 if own else 0.0

    return [peer for peer in peers.PEERS if peer.fast or seconds(peer) <= PATIENCE]


def rows_of(
    where: str, size: int, start: str, effort: Effort, chosen: Sequence[peers.Peer]
) -> Iterator[report.Row]:
    """All rows of one scene, size and start, the floor last."""
    draws = draw(scene(size, where), effort.runs, seed=1)
    floor = known_correspondences(draws)
    zero = start == "zero"
    pilot = draw(scene(size, where), effort.pilot, seed=2)
    detailed = size in DETAILED and start != "off"
    methods = [
        *one_per_call(draws, pilot, start, effort, chosen),
        *(others(draws, start, effort) if detailed else ()),
    ]
    judged = []
    for method in methods:  # also compiles and warms up
        estimates = method.motions(method.solve(method.runs))
        judged.append(accuracy(estimates, floor, draws.theta, only_at_truth=zero))
        method.solve(method.timed)
    seconds = interleaved(methods, ROUNDS)
    for method, (times, busy), result in zip(
        methods, np.moveaxis(seconds, -1, 1), judged, strict=True
    ):
        used = np.minimum(times, busy)  # not what others used; a process of two threads has more
        yield report.Row(
            where,
            size,
            start,
            method.cost,
            method.name,
            used.min(),
            np.median(used),
            method.runs,
            result,
            busy.sum() / times.sum(),
        )
    if not zero:
        known = accuracy(floor, floor, draws.theta, only_at_truth=False)
        name = "floor: least squares, pairs known"
        nan = float("nan")
        yield report.Row(where, size, start, "pairs known", name, nan, nan, len(draws), known)


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
    say("start-up and compilation")
    libraries = processes.libraries(missing)
    rows: list[report.Row] = []
    for size, effort in (QUICK if quick else EFFORT).items():
        for start in ("truth", "off", "zero") if size in DETAILED else ("truth", "off"):
            say(f"{size} × {size} targets from {start}")
            chosen = affordable(size, start, rows)
            rows += rows_of("dense", size, start, effort, chosen)
    for size in (report.MANY, report.MORE):
        say(f"{size} × {size} targets in the wide scene")
        chosen = affordable(size, "off", rows)
        rows += rows_of("wide", size, "off", (QUICK if quick else EFFORT)[size], chosen)
    say("done")
    return report.Measured(
        processes.machine(), processes.versions(PACKAGES), missing, rows, libraries
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
