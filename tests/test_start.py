"""The first import: what is compiled is kept on disk, or not, and the package works either way."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "d2d"
MAKE_A_SET = """
points = d2d.PointSet([[8.0, 1.0]], [[[0.1, 0.0], [0.0, 0.1]]])
print(d2d.__file__, points.size)
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a copy of the package, in which nothing compiled can be kept.

    A file stands where Numba would make its folder, because an administrator may write anywhere.
    """
    shutil.copytree(PACKAGE, tmp_path / "d2d", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "d2d" / "_kernel" / "__pycache__").touch()
    return tmp_path


def run(program: str, folder: Path, **environment: str) -> tuple[str, list[str]]:
    """What a program prints that imports the copy of the package, and its lines of errors."""
    nowhere = str(folder / "d2d" / "py.typed" / "cache")  # beneath a file
    inherited = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=folder,
        env={
            **inherited,
            "PYTHONPATH": str(folder),
            "PYTHONDONTWRITEBYTECODE": "1",
            "HOME": nowhere,
            "XDG_CACHE_HOME": nowhere,
            **environment,
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip(), done.stderr.splitlines()


@pytest.mark.skipif(sys.platform != "linux", reason="the user's cache folder is elsewhere")
def test_without_a_writable_folder_it_starts_and_says_so_in_one_line(folder: Path) -> None:
    """Breaks if the import dies in a container, or every compiled function complains."""
    printed, errors = run("import d2d" + MAKE_A_SET, folder)
    assert printed == f"{folder}/d2d/__init__.py 1"
    assert len(errors) == 1, errors
    assert "NUMBA_CACHE_DIR" in errors[0]


@pytest.mark.skipif(sys.platform != "linux", reason="the user's cache folder is elsewhere")
def test_with_the_folder_that_the_line_names_it_starts_without_a_word(folder: Path) -> None:
    """Breaks if the advice does not help."""
    kept = folder / "kept"
    _, errors = run("import d2d" + MAKE_A_SET, folder, NUMBA_CACHE_DIR=str(kept))
    assert errors == []
    assert list(kept.rglob("*.nbc"))


def test_a_folder_that_is_lost_after_the_import_costs_no_result(folder: Path) -> None:
    """Breaks if a full disk, or a folder that was removed, ends a registration."""
    kept = folder / "kept"
    lose = f"""
import shutil, d2d
shutil.rmtree({str(kept)!r})
open({str(kept)!r}, "w").close()
"""
    printed, errors = run(lose + MAKE_A_SET, folder, NUMBA_CACHE_DIR=str(kept))
    assert printed.endswith(" 1")
    assert len(errors) == 1, errors
    assert "NUMBA_CACHE_DIR" in errors[0]
