"""The wheel and the source archive, built and installed as a user would, and what they need."""

import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

ROOT = Path(__file__).resolve().parents[1]
# Two functions are all that `python -m build --no-isolation` calls.
BUILD = "import sys, setuptools.build_meta as b; getattr(b, sys.argv[1])(sys.argv[2])"
IMPORT_ALL = """
import d2d, importlib, importlib.metadata, pkgutil
names = [each.name for each in pkgutil.walk_packages(d2d.__path__, "d2d.")]
for name in names:
    if not name.endswith("__main__"):
        importlib.import_module(name)
print(d2d.__file__, importlib.metadata.version("d2d"), len(names))
"""


def run(folder: Path, *arguments: str, **environment: str) -> str:
    command = [sys.executable, *arguments]
    found = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, env={**os.environ, **environment}
    )
    assert found.returncode == 0, found.stderr
    return found.stdout


def built(source: Path, what: str, into: Path) -> Path:
    """The archive that a folder of sources gives."""
    into.mkdir()
    run(source, "-c", BUILD, what, str(into))
    (archive,) = into.iterdir()
    return archive


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A wheel from the sources, and one from the source archive."""
    pytest.importorskip("setuptools", "77")  # `make lowest` builds nothing
    place = tmp_path_factory.mktemp("built")
    sources = place / "sources"
    sources.mkdir()
    shutil.copytree(ROOT / "d2d", sources / "d2d", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, sources)
    archive = built(sources, "build_sdist", place / "archive")
    with tarfile.open(archive) as packed:
        safe = {"filter": "data"} if hasattr(tarfile, "data_filter") else {}  # from 3.11.4 on
        packed.extractall(place / "unpacked", **safe)
    (unpacked,) = (place / "unpacked").iterdir()
    wheel = built(sources, "build_wheel", place / "wheel")
    return wheel, built(unpacked, "build_wheel", place / "again")


def test_both_hold_every_file_of_the_package(wheels: tuple[Path, Path]) -> None:
    """Breaks if a table or a type marker is left out, or the source archive lacks something."""
    held = []
    for wheel in wheels:
        with zipfile.ZipFile(wheel) as packed:
            held.append({name: packed.read(name) for name in packed.namelist()})
    assert held[0] == held[1]
    for path in (ROOT / "d2d").rglob("*"):
        if path.is_file() and "__pycache__" not in path.parts:
            assert held[0].get(path.relative_to(ROOT).as_posix()) == path.read_bytes(), path


def test_the_installed_wheel_works_without_the_repository(
    wheels: tuple[Path, Path], tmp_path: Path
) -> None:
    """Breaks if a module is missing or reads a file of the repository, or there is no command."""
    site, away = tmp_path / "site", tmp_path / "away"
    away.mkdir()
    install = ("-m", "pip", "install", "--no-deps", "--no-index", "--quiet", "--target", str(site))
    run(away, *install, str(wheels[1]))
    path, version, count = run(away, "-c", IMPORT_ALL, PYTHONPATH=str(site)).split()
    assert Path(path) == site / "d2d" / "__init__.py"
    assert wheels[1].name.startswith(f"d2d-{version}-")
    assert int(count) > 100
    said = run(away, "-m", "d2d.radar", "--help", PYTHONPATH=str(site))
    assert "log.csv" in said


PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]
NEEDED = PROJECT["dependencies"] + EXTRAS["study"] + EXTRAS["track"] + EXTRAS["radarscenes"]
PINNED = (ROOT / "requirements.txt").read_text(encoding="utf-8")
PINS = dict(re.findall(r"^([\w-]+)==([\w.]+)", PINNED, re.M))


def test_the_pins_lie_within_the_declared_bounds() -> None:
    """Breaks if the book is built with a version that pip would not install beside the package."""
    for requirement in map(Requirement, NEEDED):
        assert Version(PINS[requirement.name]) in requirement.specifier, requirement
        assert [each.operator for each in requirement.specifier] == [">="], requirement
