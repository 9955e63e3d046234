"""The registration that a chapter writes in forty lines finds what `register` finds."""

from pathlib import Path

import nbformat
import numpy as np
import pytest

from d2d import CorruptedGaussian, RegistrationCost, register
from d2d.study.plane.scenarios import OUTLIERS

CHAPTER = Path(__file__).resolve().parents[2] / "chapters" / "06_finding_the_optimum.ipynb"
COST = RegistrationCost(outlier=CorruptedGaussian(0.2, 100.0 * np.eye(2)))


@pytest.mark.parametrize("seed", range(5))
def test_forty_lines_agree_with_register(seed):
    """Breaks if a reader who copies the page's code gets another gradient or another optimum."""
    fixed, moving = (s[0] for s in OUTLIERS.sample(1, np.random.default_rng(seed)))
    written = {"np": np, "fixed": fixed, "moving": moving}
    for cell in nbformat.read(CHAPTER, 4).cells:
        if cell.cell_type == "code" and cell.id in {f"by-hand-{n}" for n in (2, 4, 6, 8)}:
            exec(cell.source, written)
    start = OUTLIERS.theta + np.array([0.3, -0.2, 0.02])
    value, gradient, _ = COST.derivatives(start, fixed, moving)
    mine = written["cost"](start)
    assert mine[0] == pytest.approx(float(value), rel=1e-12)
    np.testing.assert_allclose(mine[1], gradient, rtol=1e-9, atol=1e-9)
    theta, least = written["descend_by_hand"](start)
    found = register(fixed, moving, COST, start)
    assert least == pytest.approx(float(found.value), rel=1e-12)
    np.testing.assert_allclose(theta, found.theta, atol=1e-5)
