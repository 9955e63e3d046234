"""The stored outputs of the book's notebooks are complete and clean.

`pytest --nbval` compares stored outputs with fresh ones, but a cell without outputs has nothing
to compare and so passes. Here each notebook must have been executed in order, to its end and
without a complaint. Each check returns what it found.
"""

import re
from base64 import b64decode
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from io import BytesIO
from pathlib import Path

import nbformat
import numpy as np
import pytest
from nbformat import NotebookNode
from PIL import Image

CHAPTERS = Path(__file__).resolve().parents[2] / "chapters"
NOTEBOOKS = sorted(CHAPTERS.glob("*.ipynb"))

MAX_LINES = 30
WARNING = re.compile(r"\b[A-Z]\w*Warning\b")
MACHINE_PATH = re.compile(r"(?<![\w.:/])(/(home|root|Users|work|tmp|var|mnt)/|[A-Z]:\\Users\\)")
ANSI = re.compile(r"\x1b\[[0-9;]*m")

Check = Callable[[NotebookNode], list[str]]


def code_cells(notebook: NotebookNode) -> Iterator[tuple[str, NotebookNode]]:
    """Yield (a name to report, the cell) of every code cell that is not empty."""
    for position, cell in enumerate(notebook.cells, start=1):
        if cell.cell_type == "code" and cell.source.strip():
            yield f"cell {position}", cell


def output_texts(cell: NotebookNode) -> Iterator[str]:
    """Yield everything readable that a cell put out."""
    for output in cell.outputs:
        yield output.get("text", "")
        yield from output.get("traceback", ())
        for mime, data in output.get("data", {}).items():
            if mime.startswith("text/"):
                yield data


def unexecuted(notebook: NotebookNode) -> list[str]:
    """Find cells that were not executed, or not from top to bottom in one go."""
    return [
        f"{name}: execution count {cell.execution_count}, expected {expected}"
        for expected, (name, cell) in enumerate(code_cells(notebook), start=1)
        if cell.execution_count != expected
    ]


def complaints(notebook: NotebookNode) -> list[str]:
    """Find cells that raised, or wrote to stderr."""
    return [
        f"{name}: {output.get('ename') or output.text[:200]}"
        for name, cell in code_cells(notebook)
        for output in cell.outputs
        if output.output_type == "error" or output.get("name") == "stderr"
    ]


def unwanted(notebook: NotebookNode) -> list[str]:
    """Find outputs with a Python warning, or a folder of the machine they were made on."""
    return [
        f"{name}: {text[match.start() : match.start() + 80]!r}"
        for name, cell in code_cells(notebook)
        for text in (ANSI.sub("", text) for text in output_texts(cell))
        for pattern in (WARNING, MACHINE_PATH)
        if (match := pattern.search(text))
    ]


def long_cells(notebook: NotebookNode) -> list[str]:
    """Find code cells that should be functions in d2d."""
    return [
        f"{name}: {lines} lines, at most {MAX_LINES}"
        for name, cell in code_cells(notebook)
        if (lines := len(cell.source.splitlines())) > MAX_LINES
    ]


def figures(notebook: NotebookNode) -> Iterator[tuple[str, NotebookNode, NotebookNode]]:
    """Yield (a name to report, the cell, its mystnb metadata) of every figure cell."""
    for name, cell in code_cells(notebook):
        options = cell.metadata.get("mystnb", {})
        if "figure" in options:
            yield name, cell, options


def faulty_figures(notebook: NotebookNode) -> list[str]:
    """Find figure cells without a proper name, caption, alternative text or picture."""
    found = []
    for name, cell, options in figures(notebook):
        data = [output.get("data", {}) for output in cell.outputs]
        moving = sum("data-controls" in each.get("text/html", "") for each in data)
        pictures = moving + sum("image/png" in each for each in data)
        figure, image = options.figure, options.get("image", {})
        forms = 2 if "page" in image.get("classes", "").split() else 1
        named = re.fullmatch(r"fig-[a-z0-9-]+", figure.get("name", ""))
        good = {
            f"mystnb.figure.name must be fig-<id>, got {figure.get('name')!r}": named,
            "no mystnb.figure.caption": figure.get("caption", "").strip(),
            "no mystnb.image.alt, for who cannot see the picture": image.get("alt", "").strip(),
            f"{pictures} pictures, expected {forms}": pictures == forms,
        }
        problems = [problem for problem in good if not good[problem]]
        problems += [each for output in cell.outputs for each in badly_drawn(output)]
        found += [f"{name}: {problem}" for problem in problems]
    return found


def badly_drawn(output: NotebookNode) -> Iterator[str]:
    """What is wrong with the pixels of a picture that a cell put out, if it is one."""
    data = output.get("data", {}).get("image/png")
    if data is None:
        return
    image = Image.open(BytesIO(b64decode(data)))
    if image.width < 2 * output.metadata.get("image/png", {}).get("width", image.width):
        yield "fewer than two pixels for each of the page"
    pixels = np.asarray(image.convert("L"))
    if (pixels[[0, -1]] < 250).any() or (pixels[:, [0, -1]] < 250).any():
        yield "something touches the edge of the picture, and may be cut off"


CHECKS: tuple[Check, ...] = (unexecuted, complaints, unwanted, long_cells, faulty_figures)


@cache
def load(path: Path) -> NotebookNode:
    """Read a notebook and check it against the format, by which each cell has an id of its own."""
    notebook = nbformat.read(path, as_version=nbformat.NO_CONVERT)
    nbformat.validate(notebook)
    return notebook


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook(path: Path):
    """Breaks if a check finds something, or a chapter is not called by the number of its file.

    Pages whose file has no number stand between the chapters and have a title only.
    """
    notebook = load(path)
    for check in CHECKS:
        assert check(notebook) == [], check.__name__
    if path.stem[0].isdigit():
        number = path.stem.split("_")[0].lstrip("0")
        assert notebook.cells[0].source.startswith(f"# {number}\u00a0·\u00a0")


def test_figure_names_are_unique_across_the_book():
    named = (options.figure["name"] for path in NOTEBOOKS for *_, options in figures(load(path)))
    assert [name for name, count in Counter(named).items() if count > 1] == []
