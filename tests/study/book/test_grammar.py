"""One look for each cost, reference and set in every figure: what a reader learns once, holds."""

import re
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

from d2d.study.book import grammar
from d2d.study.plane import figures

ROOT = Path(__file__).resolve().parents[3]


def test_low_cost_is_dark():
    """Breaks if a map is turned round: what a reader takes for a well would be a hill."""
    logs = -np.add.outer(np.linspace(-1, 1, 65) ** 2, np.linspace(-1, 1, 65) ** 2)
    mesh = figures.cost_map(plt.subplots()[1], np.linspace(-1.0, 1.0, 65), 500.0 * logs)
    values = np.asarray(mesh.get_array()).reshape(65, 65)
    at_truth, at_edge = (np.sum(mesh.to_rgba(values)[i, i, :3]) for i in (32, 0))
    assert at_truth < 0.5 * at_edge


MARKS = {"o": "circle", "^": "peak", "s": "square", "D": "diamond"}  # in the laboratories


@pytest.mark.parametrize("key", [*grammar.COSTS, *grammar.SETS])
def test_the_laboratories_have_the_colours_and_marks_of_the_figures(key):
    """Breaks if a cost or a set looks otherwise where one plays with it than in print."""
    look = (grammar.COSTS | grammar.SETS)[key]
    css, kit = ((ROOT / "_static" / "labs" / name).read_text() for name in ("labs.css", "kit.js"))
    assert f"--lab-{key}: {look.color.lower()};" in css
    assert re.search(rf'\n *{key}: {{ name: "[^"]+", mark: "{MARKS[look.marker]}"', kit)
