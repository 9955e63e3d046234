"""Execute notebooks, so that the same code gives the same bytes.

    python tools/run_notebooks.py [--jobs 2] [--into FOLDER] [notebook ...]

By default every notebook of chapters/ is executed in place; with --into the executed notebooks are
written to that folder, and those of chapters/ stay as they are.

Each notebook runs in a fresh kernel and in its own folder. What would differ between two runs or
two machines is not stored: times, widget state, the patch version of Python. Pictures are stored
with a palette. A notebook that raises or writes to stderr (a warning, a progress bar) is reported
with its cell and left as it was. Stored outputs never hold measurements of a data set:
D2D_RADARSCENES and D2D_NUSCENES are not passed on to the kernels.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError, CellTimeoutError
from nbformat import NotebookNode
from shrink_pictures import shrink_outputs

CHAPTERS = Path(__file__).resolve().parents[1] / "chapters"
CELL_METADATA = ("mystnb", "tags")  # that the book uses; everything else comes from editors

KERNELSPEC = {"display_name": "Python 3", "language": "python", "name": "python3"}
FIGURES = [
    "--InlineBackend.figure_formats={'retina'}",
    "--InlineBackend.print_figure_kwargs={'bbox_inches': None}",
]
"""Two pixels for each of the page, and no second drawing to find out what could be cut off."""

TIMEOUT = 300  # s for one cell


def set_stable_metadata(notebook: NotebookNode) -> None:
    """Drop what editors and kernels leave behind in the metadata."""
    notebook.metadata.kernelspec = dict(KERNELSPEC)
    notebook.metadata.language_info.pop("version", None)  # of Python
    notebook.metadata.pop("widgets", None)
    notebook.nbformat, notebook.nbformat_minor = 4, 5
    for cell in notebook.cells:
        cell.metadata = NotebookNode(
            {key: cell.metadata[key] for key in CELL_METADATA if key in cell.metadata}
        )
        if cell.cell_type == "code" and not cell.source.strip():
            cell.outputs, cell.execution_count = [], None


def execute(notebook: NotebookNode, folder: Path) -> None:
    """Execute all cells in a fresh kernel that runs in `folder`; raise if it complains."""
    client = NotebookClient(
        notebook,
        kernel_name=KERNELSPEC["name"],
        extra_arguments=FIGURES,
        timeout=TIMEOUT,
        allow_errors=False,
        record_timing=False,
        coalesce_streams=True,
        resources={"metadata": {"path": str(folder)}},
    )
    unset = ("D2D_RADARSCENES", "D2D_NUSCENES", "MPLBACKEND", "PYTHONWARNINGS")
    client.execute(env={name: v for name, v in os.environ.items() if name not in unset})
    for position, cell in enumerate(notebook.cells, start=1):
        for output in cell.get("outputs", ()):
            if output.get("name") == "stderr":
                raise RuntimeError(f"cell {position} wrote to stderr:\n{output.text}")


def run(path: Path, folder: Path | None) -> bool:
    """Execute a notebook, write it in place or to a folder, and say whether it ran cleanly."""
    start, clean = time.perf_counter(), True
    notebook = nbformat.read(path, as_version=4)
    try:
        execute(notebook, path.parent)
    except (CellExecutionError, CellTimeoutError, RuntimeError) as error:
        result, clean = f"FAILED\n{error}", False
    else:
        set_stable_metadata(notebook)
        shrink_outputs(notebook)
        nbformat.validate(notebook)
        before = path.read_bytes()
        after = nbformat.writes(notebook).rstrip("\n").encode() + b"\n"
        (folder / path.name if folder else path).write_bytes(after)
        result = "unchanged" if after == before else "changed"
    print(f"{path.name}: {result} ({time.perf_counter() - start:.1f} s)", flush=True)
    return clean


def main(arguments: list[str] | None = None) -> int:
    """Run the notebooks named on the command line; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("notebooks", nargs="*", type=Path, help="default: all of chapters/")
    parser.add_argument("--into", type=Path, help="folder for the executed notebooks")
    parser.add_argument("--jobs", type=int, default=1, help="notebooks executed at a time")
    options = parser.parse_args(arguments)
    paths = [path.resolve() for path in options.notebooks] or sorted(CHAPTERS.glob("*.ipynb"))
    if options.into:
        options.into.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(options.jobs) as pool:
        clean = list(pool.map(partial(run, folder=options.into), paths))
    return 0 if all(clean) else 1


if __name__ == "__main__":
    sys.exit(main())
