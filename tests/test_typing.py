"""A user's script with types: mypy accepts it, knows what comes back, and it runs."""

import runpy
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).with_name("typed_script.py")
WRONG = """
from d2d import PointSet, RegistrationCost
from d2d.radar import RadarScan, track

def use(scan: RadarScan, points: PointSet) -> None:
    scan[0]
    scan["range"]
    points[points.means]
    RegistrationCost(metric="icp")
    track([scan, scan])
"""


def mypy(*arguments: str) -> subprocess.CompletedProcess[str]:
    pytest.importorskip("mypy")
    return subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", *arguments],
        cwd=SCRIPT.parents[1],
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_script_runs() -> None:
    """Breaks if a type is promised that the code refuses, or the other way round."""
    runpy.run_path(str(SCRIPT))


def test_mypy_accepts_what_the_docstrings_allow() -> None:
    """Breaks if a mask, a list or a number is refused where an array would do."""
    checked = mypy(str(SCRIPT))
    assert checked.returncode == 0, checked.stdout


def test_mypy_refuses_what_the_code_refuses(tmp_path: Path) -> None:
    """Breaks if the types are so wide that they say nothing."""
    (tmp_path / "wrong.py").write_text(WRONG, encoding="utf-8")
    checked = mypy(str(tmp_path / "wrong.py"))
    wrong = {line.split(":")[1] for line in checked.stdout.splitlines() if ": error:" in line}
    lines = WRONG.splitlines()
    first = lines.index("    scan[0]") + 1
    assert wrong == {str(number) for number in range(first, len(lines) + 1)}, checked.stdout
