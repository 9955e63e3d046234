"""Set the repository's address: adds launch buttons to the book and a Colab cell to each notebook.

    python tools/set_address.py https://github.com/<owner>/<name>

Run `make notebooks` afterwards, so that the new cells count as executed.  Binder only needs
requirements.txt, which it installs.  Colab opens a notebook without the repository around it; there
the cell fetches the rest, and everywhere else it does nothing.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import nbformat
from nbformat.v4 import new_code_cell

ROOT = Path(__file__).resolve().parents[1]
ADDRESS = re.compile(r"https://github\.com/[\w.-]+/[\w.-]+")
CELL_ID = "colab"
BUTTONS = (
    'notebook_interface: jupyterlab, binderhub_url: "https://mybinder.org", '
    'colab_url: "https://colab.research.google.com"'
)


def colab_cell(address: str) -> str:
    """The code of the cell: on Colab it clones the repository and installs the package."""
    return f"""import sys

if "google.colab" in sys.modules:
    !git clone --quiet --depth 1 {address} repository
    %cd repository/chapters
    %pip install --quiet --editable .. evo scikit-learn"""


def configured(text: str, address: str) -> str:
    """The book's configuration with the repository's address and launch buttons."""
    for key, value in (
        ("repository", f'url: "{address}", branch: main'),
        ("launch_buttons", BUTTONS),
    ):
        text, count = re.subn(rf"(?m)^(# )?{key}: \{{.*\}}$", f"{key}: {{{value}}}", text)
        if count != 1:
            raise ValueError(f"_config.yml must hold one line for {key}, but holds {count}")
    return text


def with_colab_cell(notebook: nbformat.NotebookNode, address: str) -> nbformat.NotebookNode:
    """The notebook with the cell after its title; a cell with an earlier address is replaced."""
    cells = [cell for cell in notebook.cells if cell.id != CELL_ID]
    cell = new_code_cell(colab_cell(address), id=CELL_ID, metadata={"tags": ["remove-cell"]})
    return nbformat.from_dict({**notebook, "cells": [*cells[:1], cell, *cells[1:]]})


def set_address(root: Path, address: str) -> None:
    """Write the address into the configuration and all notebooks below ``root``."""
    if not ADDRESS.fullmatch(address):
        raise ValueError(f"the address must be https://github.com/<owner>/<name>, but is {address}")
    config = root / "_config.yml"
    config.write_text(configured(config.read_text(encoding="utf-8"), address), encoding="utf-8")
    for path in sorted((root / "chapters").glob("*.ipynb")):
        nbformat.write(with_colab_cell(nbformat.read(path, 4), address), path)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    set_address(ROOT, sys.argv[1])
