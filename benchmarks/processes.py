"""What only a fresh process can show: start-up, compilation, peak memory; and the machine."""

import importlib.metadata
import os
import platform
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

# On Linux a child inherits ru_maxrss from its parent; there the peak is read from /proc instead.
_MONTE_CARLO = """
import pathlib
import resource
import sys
import d2d
from d2d.study.runs import monte_carlo
from d2d.study.plane.scenarios import OVERLAPPED
monte_carlo(OVERLAPPED, d2d.RegistrationCost(), runs=int(sys.argv[1]))
status = pathlib.Path("/proc/self/status")
lines = status.read_text().splitlines() if status.exists() else []
peak = [int(line.split()[1]) for line in lines if line.startswith("VmHWM")]
print(peak[0] if peak else resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""

# A set of 64 targets has compiled and loaded all functions before, and needs 1 % of the memory.
_CALL = """
import pathlib
import resource
import sys
import d2d
from benchmarks.methods import OUTLIER, initial_motion
from benchmarks.scenes import draw, scene


def resident():
    status = pathlib.Path("/proc/self/status")
    lines = status.read_text().splitlines() if status.exists() else []
    now = [int(line.split()[1]) for line in lines if line.startswith("VmRSS")]
    return now[0] if now else resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


for size in (64, int(sys.argv[1])):
    draws = draw(scene(size), 1, seed=1)
    fixed, moving, cost = draws.fixed[0], draws.moving[0], d2d.RegistrationCost(outlier=OUTLIER)
    before = resident()
    estimate = d2d.register(fixed, moving, cost, initial_motion(draws.theta, "off"))
    d2d.propagate_covariance(estimate, fixed, moving, cost)
print(resident() - before)
"""

# macOS counts in bytes, others in KiB.
_MEGABYTES = 1e-6 if sys.platform == "darwin" else 1024e-6


def printed(code: str, *arguments: str, **environment: str) -> float:
    """The number that a fresh interpreter prints."""
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments],
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


def peak_megabytes(runs: int) -> float:
    """Peak resident memory of a Monte Carlo evaluation on the eight targets."""
    return printed(_MONTE_CARLO, str(runs)) * _MEGABYTES


def call_megabytes(size: int) -> float:
    """What the first robust call with so many targets, covariance propagated, adds to memory."""
    return printed(_CALL, str(size)) * _MEGABYTES


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
