"""The README says what the record says, and what it says to do works."""

import os
import re
import shlex
from pathlib import Path

import pytest
from matplotlib import pyplot as plt

from d2d.radar.cli import main
from d2d.study.book.ledger import SIGNS
from d2d.study.book.record import read_record
from d2d.study.road.scores import read_scores

ROOT = Path(__file__).resolve().parents[2]
README = ROOT / "README.md"


def test_the_readme_counts_the_verdicts_on_record() -> None:
    """Breaks if a claim is added, dropped or judged anew and the README stays as it was."""
    verdicts = [evidence.verdict for evidence in read_record().values()]
    confirmed, conditional, partly, refuted = map(verdicts.count, SIGNS)
    readme = (
        f"{len(verdicts)} claims: {confirmed} hold as they stand, {conditional} under a condition, "
        f"{partly} are wrong in part, {refuted} is refuted."
    )
    assert readme in README.read_text(encoding="utf-8")


@pytest.mark.parametrize("page", ["README.md", "intro.md", "chapters/results.md"])
def test_the_first_pages_state_the_road_as_chapter_15_does(page: str) -> None:
    """Breaks if the drives are judged anew and a first page keeps the old shares and ANEES."""
    text = (ROOT / page).read_text(encoding="utf-8")
    road = read_scores()  # baseline 4: 0.3 s between the scans of a pair, as in chapter 15
    drive = road["radarscenes"]["baseline 4"]["105"]
    before, after = (drive[name] for name in ("inverse Hessian", "noise and budget"))
    shares = re.search(r"(\d+)\s(?:%|percent)[^|\n]+ inverse Hessian, (?:and )?(\d+)\s", text)
    assert shares is not None
    assert [*shares.groups()] == [f"{100 * each['inside']:.0f}" for each in (before, after)]
    if page != "intro.md":
        scenes = (road["nuscenes"]["baseline 4"][name] for name in ("scene-0916", "scene-1077"))
        others = [scene["noise and budget"]["anees"] for scene in scenes]
        stated = [before["anees"], after["anees"], *others]
        order = ".{,200}".join(rf"\b{value:.1f}\b" for value in stated)
        assert re.search(order, text), order


def test_from_a_log_file_to_a_path_as_the_readme_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Breaks if somebody who copies the commands and the program gets an error."""
    text = README.read_text(encoding="utf-8")
    section = text.split("## From a log file to a path\n")[1].split("\n## ")[0]
    shell, program = re.findall(r"```(?:python)?\n(.*?)```", section, re.S)
    monkeypatch.chdir(tmp_path)
    commands = [shlex.split(line) for line in shell.splitlines() if line.startswith("d2d")]
    assert [words[0] for words in commands] == ["d2d-radar"] * 2
    assert [main(words[1:]) for words in commands] == [0, 0]
    written = {"log.csv", "drive.tum", "drive_velocities.csv", "drive.npz", "drive.png"}
    assert set(os.listdir()) == written
    for name in written - {"log.csv"}:
        os.unlink(name)
    exec(compile(program, "README.md", "exec"), {})
    plt.close("all")
    assert set(os.listdir()) == written
