"""The README says what the record says, and what it says to do works."""

import os
import re
import shlex
from pathlib import Path

import pytest
from matplotlib import pyplot as plt

from d2d.radar.command_line import main
from d2d.study.book.card import SIGNS
from d2d.study.book.record import read_record

README = Path(__file__).resolve().parents[2] / "README.md"


def test_the_readme_counts_the_verdicts_on_record() -> None:
    """Breaks if a claim is added, dropped or judged anew and the first page stays as it was."""
    verdicts = [evidence.verdict for evidence in read_record().values()]
    counts = re.search(
        r"(\d+) claims: (\d+) hold as they stand, (\d+) under a condition, (\d+) do not",
        README.read_text(encoding="utf-8"),
    )
    assert counts is not None
    assert [*map(int, counts.groups())] == [len(verdicts), *map(verdicts.count, SIGNS)]


def test_from_a_log_file_to_a_path_as_the_readme_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Breaks if somebody who copies the commands and the program gets an error."""
    text = README.read_text(encoding="utf-8")
    section = text.split("## From a log file to a path\n")[1].split("\n## ")[0]
    shell, program = re.findall(r"```(?:python)?\n(.*?)```", section, re.S)
    monkeypatch.chdir(tmp_path)
    commands = [shlex.split(line) for line in shell.splitlines() if line.startswith("python")]
    assert [words[:3] for words in commands] == [["python", "-m", "d2d.radar"]] * 2
    assert [main(words[3:]) for words in commands] == [0, 0]
    written = {"log.csv", "drive.tum", "drive_velocities.txt", "drive.npz", "drive.png"}
    assert set(os.listdir()) == written
    for name in written - {"log.csv"}:
        os.unlink(name)
    exec(compile(program, "README.md", "exec"), {})
    plt.close("all")
    assert set(os.listdir()) == written
