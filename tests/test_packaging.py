"""What the package says it needs: bounds that were tested, and pins within them."""

import re
import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.version import Version

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
DECLARED = [
    Requirement(line)
    for line in (
        *PROJECT["dependencies"],
        *PROJECT["optional-dependencies"]["study"],
        *PROJECT["optional-dependencies"]["track"],
    )
]
PINS = dict(
    re.findall(
        r"^([\w-]+)==([\w.]+)", (ROOT / "requirements.txt").read_text(encoding="utf-8"), re.M
    )
)
# Below these, no wheel works with NumPy 2: `make lowest` fails to import the package.
BUILT_FOR_NUMPY_2 = {
    "h5py": "3.11",
    "matplotlib": "3.8.4",
    "numba": "0.60",
    "pandas": "2.2.2",
    "scipy": "1.13",
}


def test_the_pins_lie_within_the_declared_bounds() -> None:
    """Breaks if the book is built with a version that pip would not install beside the package."""
    for requirement in DECLARED:
        assert Version(PINS[requirement.name]) in requirement.specifier, requirement
        assert [each.operator for each in requirement.specifier] == [">="], requirement


def test_the_lowest_versions_work_together() -> None:
    """Breaks if a bound lets in a version that was built for NumPy 1 only."""
    bounds = {each.name: next(iter(each.specifier)).version for each in DECLARED}
    assert Version(bounds["numpy"]) >= Version("2.0")
    for name, lowest in BUILT_FOR_NUMPY_2.items():
        assert Version(bounds[name]) >= Version(lowest), name
