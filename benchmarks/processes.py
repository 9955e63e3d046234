"""Measurements in a fresh process: start-up, compilation, peak memory; and the machine."""

import importlib.metadata
import os
import platform
import resource
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

_IMPORT = "import time; t = time.perf_counter(); import d2d; print(time.perf_counter() - t)"

_FIRST_CALL = """
import time
import d2d
targets = d2d.PointSet([[0.0, 5.0], [8.0, 1.0]], [[[0.04, 0.0], [0.0, 0.04]]] * 2)
t = time.perf_counter()
d2d.register(targets, targets)
print(time.perf_counter() - t)
"""

# macOS counts in bytes, others in KiB.
_MEGABYTES = 1e-6 if sys.platform == "darwin" else 1024e-6


def used_memory(field: str) -> float:
    """Memory of this process in MB: VmHWM is the peak, VmRSS what it has now.

    On Linux a child inherits ru_maxrss from its parent, so it is read from /proc there.
    """
    status = Path("/proc/self/status")
    lines = status.read_text().splitlines() if status.exists() else []
    found = [int(line.split()[1]) for line in lines if line.startswith(field)]
    return _MEGABYTES * (found[0] if found else resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)


def monte_carlo_peak(runs: int) -> float:
    """Peak memory of this process after a Monte Carlo evaluation on the eight targets."""
    from d2d import RegistrationCost
    from d2d.study.plane.scenarios import OVERLAPPED
    from d2d.study.runs import monte_carlo

    monte_carlo(OVERLAPPED, RegistrationCost(), runs=runs)
    return used_memory("VmHWM")


def call_memory(size: int) -> float:
    """Memory that the first robust call with so many targets, covariance propagated, adds."""
    from benchmarks.methods import OUTLIER, initial_motion
    from benchmarks.scenes import draw, scene
    from d2d import RegistrationCost, propagate_covariance, register

    # a set of 64 targets compiles and loads all functions before, and needs 1 % of the memory
    for targets in (64, size):
        draws = draw(scene(targets), 1, seed=1)
        fixed, moving, cost = draws.fixed[0], draws.moving[0], RegistrationCost(outlier=OUTLIER)
        before = used_memory("VmRSS")
        estimate = register(fixed, moving, cost, initial_motion(draws.theta, "off"))
        propagate_covariance(estimate, fixed, moving, cost)
    return used_memory("VmRSS") - before


def printed(code: str, **environment: str) -> float:
    """The number that a fresh interpreter prints."""
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return float(done.stdout)


def import_seconds() -> float:
    """Time of ``import d2d`` in s, the best of five."""
    return min(printed(_IMPORT) for _ in range(5))


def first_call_seconds() -> tuple[float, float]:
    """Time in s of the first registration on a new machine, and later, with the filled cache."""
    with tempfile.TemporaryDirectory() as folder:
        compiled = printed(_FIRST_CALL, NUMBA_CACHE_DIR=folder)
        return compiled, min(printed(_FIRST_CALL, NUMBA_CACHE_DIR=folder) for _ in range(3))


def in_fresh_process(function: str, argument: int) -> float:
    """The result of a function of this module in a process of its own."""
    return printed(f"from benchmarks import processes; print(processes.{function}({argument}))")


def machine() -> str:
    """Model of the processor and number of its cores."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = [
            line.split(":", 1)[1] for line in info.read_text().splitlines() if "model name" in line
        ]
        model = names[0].strip() if names else model
    return f"{model}, {os.cpu_count()} cores"


def versions(packages: Sequence[str]) -> str:
    """Versions of Python and of those packages that are installed."""
    listed = [f"Python {platform.python_version()}"]
    for package in packages:
        try:
            listed.append(f"{package} {importlib.metadata.version(package)}")
        except importlib.metadata.PackageNotFoundError:
            continue
    return ", ".join(listed)
