"""The code that a page of the course shows is complete: typed into a file, it runs."""

import os
import warnings
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import matplotlib
import nbformat
import pytest

from tests.kernels import FORKS

CHAPTERS = Path(__file__).resolve().parents[2] / "chapters"
COURSE = sorted(CHAPTERS.glob("[0-9]*.ipynb"))
FOLDED = {"hide-input", "hide-cell", "remove-input", "remove-cell"}
LEAST = 10  # lines on a page


def shown(path: Path) -> str:
    """Return the code of a page that is not folded, from the first cell to the last."""
    cells = nbformat.read(path, as_version=4).cells
    return "\n".join(
        cell.source
        for cell in cells
        if cell.cell_type == "code" and not FOLDED & set(cell.metadata.get("tags", ()))
    )


def test_the_course_has_at_most_fifteen_pages_and_the_book_twenty_five_notebooks():
    assert 10 < len(COURSE) <= 15
    assert len(list(CHAPTERS.glob("*.ipynb"))) <= 25


def run(code: str) -> None:
    """Run code as a file of its own, in which a warning is an error."""
    os.chdir(CHAPTERS)
    matplotlib.use("agg")
    warnings.simplefilter("error")
    exec(compile(code, "typed along", "exec"), {"__name__": "__main__"})


@pytest.mark.slow
@pytest.mark.parametrize("path", COURSE, ids=lambda path: path.stem)
def test_a_reader_can_type_along(path: Path):
    """Breaks if a page shows code that needs a folded cell, warns, or is a few lines only."""
    code = shown(path)
    assert sum(bool(line.strip()) for line in code.splitlines()) >= LEAST
    with ProcessPoolExecutor(1, FORKS) as fresh:
        fresh.submit(run, code).result()
