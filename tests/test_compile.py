"""How the kernel is compiled and kept on disk, or not; the package works either way."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MAKE_A_SET = """
points = d2d.PointSet([[8.0, 1.0]], [[[0.1, 0.0], [0.0, 0.1]]])
print(d2d.__file__, points.size)
"""
WEIGH = """
import numpy as np
from d2d._kernel.errors import add_dependence
rng, total = np.random.default_rng(0), np.zeros((3, 3))
means, position = rng.uniform(0.0, 20.0, (200, 2)), rng.standard_normal((200, 3, 2))
covariances, order = np.tile(np.eye(2), (200, 1, 1)), np.argsort(means[:, 0])
ends = np.full(200, 200)
add_dependence(position, covariances, means, ends, order, 2.0, np.empty((9, 200)), total)
print(sum(add_dependence.stats.cache_hits.values()), total.tobytes().hex())
"""
ESTIMATE = """
import numpy as np
from d2d import CorruptedGaussian, PointSet, RegistrationCost, propagate_covariance, register
sets = [PointSet([[8.0, 1.0], [5.0, x]], [0.04 * np.eye(2)] * 2) for x in (-3.0, -2.9)]
cost = RegistrationCost(outlier=CorruptedGaussian(0.2, 100.0 * np.eye(2)))
estimate = register(*sets, cost)
print(estimate.theta, estimate.covariance, propagate_covariance(estimate, *sets, cost))
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a copy of the package, where nothing compiled can be kept beside it: a file
    stands where Numba would make its folder, because an administrator may write anywhere."""
    shutil.copytree(ROOT / "d2d", tmp_path / "d2d", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "d2d" / "_kernel" / "__pycache__").touch()
    return tmp_path


def run(program: str, folder: Path, **environment: str) -> tuple[list[str], list[str]]:
    """The words that a program prints which imports the copy, and its lines of errors."""
    nowhere = str(folder / "d2d" / "py.typed" / "cache")  # beneath a file
    inherited = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    own = {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    homes = {"HOME": nowhere, "XDG_CACHE_HOME": nowhere}
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=folder,
        env=inherited | own | homes | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split(), done.stderr.splitlines()


@pytest.mark.skipif(sys.platform != "linux", reason="the user's cache folder is elsewhere")
def test_without_a_writable_folder_it_starts_and_says_what_helps(folder: Path) -> None:
    """Breaks if the import dies in a container, every function complains or the advice is bad."""
    printed, errors = run("import d2d" + MAKE_A_SET, folder)
    assert printed == [f"{folder}/d2d/__init__.py", "1"]
    assert len(errors) == 1, errors
    assert "NUMBA_CACHE_DIR" in errors[0]
    kept = folder / "kept"
    _, errors = run("import d2d" + MAKE_A_SET, folder, NUMBA_CACHE_DIR=str(kept))
    assert errors == []
    assert list(kept.rglob("*.nbc"))


def test_what_is_compiled_is_kept_until_a_module_changes(folder: Path) -> None:
    """Breaks if a cached function calls a stale one, or gives other bits than one just compiled.

    Numba itself looks at one file only, and LLVM may order sums by its own choice: then workers
    differ from who compiled.  Breaks too if a half-written file makes every call fail.
    """
    kept = folder / "kept"

    def weighed() -> list[str]:
        return run(WEIGH, folder, NUMBA_CACHE_DIR=str(kept))[0]

    (hits, compiled), (hits_later, loaded) = weighed(), weighed()
    assert (hits, hits_later) == ("0", "1")
    assert compiled == loaded
    for file in kept.rglob("*add_dependence*.nbc"):
        file.write_bytes(file.read_bytes()[:-7])
    assert weighed()[0] == "0"
    assert weighed()[0] == "1"
    with (folder / "d2d" / "_kernel" / "pairs.py").open("a", encoding="utf-8") as file:
        file.write("# an edit\n")
    assert weighed()[0] == "0"


def test_the_kernel_runs_as_python() -> None:
    """Breaks if NUMBA_DISABLE_JIT=1, with which a debugger steps through it, is an error."""
    compiled, stepped = (run(ESTIMATE, ROOT, NUMBA_DISABLE_JIT=disabled) for disabled in "01")
    assert compiled[0] == stepped[0]
