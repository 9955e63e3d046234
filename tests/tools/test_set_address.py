"""The repository's address reaches the configuration and every notebook, once."""

import shutil
from pathlib import Path

import nbformat
import pytest
import yaml

from tools.set_address import CELL_ID, set_address

ROOT = Path(__file__).resolve().parents[2]
ADDRESS = "https://github.com/someone/registration"


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """What the tool writes to."""
    (tmp_path / "chapters").mkdir()
    shutil.copy(ROOT / "_config.yml", tmp_path)
    for name in ("02_gaussian_background", "claims"):
        shutil.copy(ROOT / "chapters" / f"{name}.ipynb", tmp_path / "chapters")
    return tmp_path


def test_the_configuration_gets_address_and_buttons(copy: Path) -> None:
    """Breaks if the lines to fill in are renamed, or the file is no YAML afterwards."""
    set_address(copy, ADDRESS)
    config = yaml.safe_load((copy / "_config.yml").read_text(encoding="utf-8"))
    assert config["repository"] == {"url": ADDRESS, "branch": "main"}
    assert set(config["launch_buttons"]) == {"notebook_interface", "binderhub_url", "colab_url"}


def test_each_notebook_gets_one_cell_however_often_the_address_is_set(copy: Path) -> None:
    """Breaks if cells pile up, or anything else of the notebook changes."""
    paths = sorted((copy / "chapters").glob("*.ipynb"))
    before = [nbformat.read(path, 4) for path in paths]
    set_address(copy, "https://github.com/another/place")
    set_address(copy, ADDRESS)
    for path, old in zip(paths, before, strict=True):
        new = nbformat.read(path, 4)
        nbformat.validate(new)
        assert [cell.id for cell in new.cells].count(CELL_ID) == 1
        assert ADDRESS in new.cells[1].source
        assert new.cells[1].metadata.tags == ["remove-cell"]
        assert [cell for cell in new.cells if cell.id != CELL_ID] == old.cells


def test_the_cell_does_nothing_outside_of_colab(copy: Path) -> None:
    """Breaks if what only Colab needs runs elsewhere."""
    from IPython.core.inputtransformer2 import TransformerManager

    set_address(copy, ADDRESS)
    cell = nbformat.read(copy / "chapters" / "claims.ipynb", 4).cells[1]

    def refuse() -> None:
        raise AssertionError

    exec(TransformerManager().transform_cell(cell.source), {"get_ipython": refuse})


def test_what_is_no_address_is_refused(copy: Path) -> None:
    """Breaks if anything but a repository on GitHub, which Colab can open, is taken."""
    for wrong in ("github.com/a/b", "https://github.com/a", "https://a.org/b/c"):
        with pytest.raises(ValueError, match=r"^the address must be"):
            set_address(copy, wrong)
