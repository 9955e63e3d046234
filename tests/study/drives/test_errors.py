"""How a drive is judged: the table of errors, and the drift of the path."""

import numpy as np
import pytest

from d2d.study.drives.errors import Drift


def straight(length: float = 100.0, scale: float = 1.0, turn: float = 0.0) -> np.ndarray:
    """Poses every metre along x, the way scaled and the heading turned by so many rad/m."""
    along = np.arange(length + 1.0)
    return np.column_stack([scale * along, np.zeros_like(along), turn * along])


def test_drift_of_known_errors():
    """Breaks if a measure is not per metre, in degrees, or the root mean square."""
    longer = Drift.of(straight(scale=1.02), straight())
    # evo takes stretches of about the length
    assert longer.rpe_translation == pytest.approx(0.02, rel=0.1)
    assert longer.rpe_rotation == pytest.approx(0.0, abs=1e-6)
    assert longer.ape_translation == pytest.approx(np.sqrt(np.mean((0.02 * np.arange(101.0)) ** 2)))
    assert longer.ape_rotation == pytest.approx(0.0, abs=1e-6)
    turning = Drift.of(straight(turn=np.deg2rad(0.3)), straight())
    assert turning.rpe_rotation == pytest.approx(0.3, rel=0.1)
    assert turning.ape_rotation == pytest.approx(np.sqrt(np.mean((0.3 * np.arange(101.0)) ** 2)))
    assert turning.ape_translation == pytest.approx(0.0, abs=1e-9)


def test_drift_does_not_align_the_paths():
    """Breaks if a constant offset is taken out, and does not count it as drift per metre."""
    off = Drift.of(straight() + np.array([3.0, 4.0, 0.0]), straight())
    assert off.ape_translation == pytest.approx(5.0)
    assert off.rpe_translation == pytest.approx(0.0, abs=1e-9)
