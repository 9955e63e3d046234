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


def test_the_pins_lie_within_the_declared_bounds() -> None:
    """Breaks if the book is built with a version that pip would not install beside the package."""
    for requirement in DECLARED:
        assert Version(PINS[requirement.name]) in requirement.specifier, requirement
        assert [each.operator for each in requirement.specifier] == [">="], requirement
