"""The registration that a chapter writes in forty lines finds what `register` finds."""

from pathlib import Path

import nbformat
import numpy as np
import pytest

from d2d import register
from d2d.study.plane.figures import one_draw
from d2d.study.plane.scenarios import OUTLIERS, OVERLAPPED
from tests.strategies import ROBUST

CHAPTER = Path(__file__).resolve().parents[2] / "chapters" / "06_finding_the_optimum.ipynb"


@pytest.fixture(scope="module")
def written():
    """What the page's code defines."""
    written = {"np": np}
    for cell in nbformat.read(CHAPTER, 4).cells:
        if cell.cell_type == "code" and cell.id in {f"by-hand-{n}" for n in ("e", 2, 4, 6, 8, 10)}:
            exec(cell.source, written)
    return written


def differences(cost, theta, sets):
    """Central differences of the cost with the step that the page names."""
    steps = 1e-6 * np.eye(3)
    return np.array([cost(theta + h, *sets)[0] - cost(theta - h, *sets)[0] for h in steps]) / 2e-6


@pytest.mark.parametrize("seed", range(5))
def test_forty_lines_agree_with_register(written, seed):
    """Breaks if a reader who copies the page's code gets another gradient or another optimum."""
    fixed, moving = (s[0] for s in OUTLIERS.sample(1, np.random.default_rng(seed)))
    start = OUTLIERS.theta + np.array([0.3, -0.2, 0.02])
    value, gradient, _ = ROBUST.derivatives(start, fixed, moving)
    mine = written["cost"](start, fixed, moving)
    assert mine[0] == pytest.approx(float(value), rel=1e-12)
    np.testing.assert_allclose(mine[1], gradient, rtol=1e-9, atol=1e-9)
    theta, least, _ = written["descend_by_hand"](start, fixed, moving)
    found = register(fixed, moving, ROBUST, start)
    assert least == pytest.approx(float(found.value), rel=1e-12)
    np.testing.assert_allclose(theta, found.theta, atol=1e-5)


def test_readers_can_check_their_gradient_as_the_page_says(written):
    """Breaks if a correct gradient fails the page's tolerances, at far poses or at the optimum."""
    sets, cost = one_draw(OVERLAPPED, 3), written["cost"]
    for theta in np.random.default_rng(0).uniform(-1, 1, (200, 3)) * (10.0, 10.0, 0.5):
        gradient = cost(theta, *sets)[1]
        error = differences(cost, theta, sets) - gradient
        assert np.abs(error).max() < 1e-7 * np.abs(gradient).max()
    theta, _, _ = written["descend_by_hand"](np.zeros(3), *sets)
    assert np.abs(differences(cost, theta, sets) - cost(theta, *sets)[1]).max() < 1e-6
