"""Measurements in a fresh process: start-up, compilation, size; and the machine."""

import importlib.metadata
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import NamedTuple

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

_TARGETS = "import time; t = time.process_time(); import numpy as np; P = np.eye(9, 3); "
_FIRST = {
    "d2d": "import d2d; s = d2d.PointSet(P[:, :2], np.tile(np.eye(2), (9, 1, 1)));"
    "d2d.register(s, s)",
    "small_gicp": "import small_gicp as g; c = g.PointCloud(P);"
    "g.align(c, c, g.KdTree(c), registration_type='ICP')",
    "open3d": "import open3d as o; c = o.geometry.PointCloud(o.utility.Vector3dVector(P));"
    "o.pipelines.registration.registration_icp(c, c, 1.0)",
    "kiss-icp": "from kiss_icp.mapping import VoxelHashMap;"
    "from kiss_icp.registration import Registration;"
    "m = VoxelHashMap(1.0, 100.0, 20); m.add_points(P);"
    "Registration(50, 1e-4, 1).align_points_to_map(P, m, np.eye(4), 3.0, 1.0)",
}
"""Import of each library, and its smallest registration."""
_PRINT = "; print(time.process_time() - t)"


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


class Library(NamedTuple):
    """Version, MB of the library and of all that it needs, s to import and to a first result."""

    version: str
    sizes: dict[str, float]
    imported: float
    first: float
    compiled: float  # s to the first result on a new machine; nan without a compiler


def libraries(missing: Collection[str]) -> dict[str, Library]:
    """Size and seconds before the first result of each library but those of ``missing`` modules."""
    found = {}
    for name, code in _FIRST.items():
        if name.replace("-", "_") in missing:
            continue
        version = importlib.metadata.version(name)
        program = _TARGETS + code + _PRINT
        module = f"import time; t = time.process_time(); import {name.replace('-', '_')}" + _PRINT
        imported = min(printed(module) for _ in range(5))
        with tempfile.TemporaryDirectory() as folder:
            compiled = printed(program, NUMBA_CACHE_DIR=folder)
            first = min(printed(program, NUMBA_CACHE_DIR=folder) for _ in range(5))
        compiled = compiled if name == "d2d" else float("nan")
        found[name] = Library(version, installed(name), imported, first, compiled)
    return found


def installed(name: str) -> dict[str, float]:
    """MB of each package that installing ``name`` brings, itself included."""
    sizes: dict[str, float] = {}
    waiting = [name]
    while waiting:
        package = canonicalize_name(waiting.pop())
        if package in sizes:
            continue
        distribution = importlib.metadata.distribution(package)
        paths = [Path(str(file.locate())) for file in distribution.files or ()]
        compiled = ".pyc"  # written by Python, not by the package
        sizes[package] = 1e-6 * sum(
            path.stat().st_size for path in paths if path.is_file() and path.suffix != compiled
        )
        for text in distribution.requires or ():
            requirement = Requirement(text)
            if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
                waiting.append(requirement.name)
    return sizes


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
