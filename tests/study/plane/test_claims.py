"""A check of the scenes in the plane must be able to come out otherwise."""

from __future__ import annotations

import numpy as np
import pytest

from d2d.study.claims import CLAIMS
from d2d.study.plane.claims import clusters
from d2d.study.plane.measures import times_off
from d2d.study.plane.optima import Minima


def test_the_cluster_claim_is_confirmed_where_the_lowest_minimum_is_elsewhere(monkeypatch):
    """Breaks if the verdict rests on descents from the truth, which cannot see another minimum."""
    elsewhere = Minima(np.array([[8.0, 0.0, 0.0], np.zeros(3)]), np.array([0.0, -1.0]))
    monkeypatch.setattr(clusters, "local_minima", lambda *given, draws=5: (elsewhere,) * draws)
    evidence = CLAIMS["cluster-summing-wrong"].check()
    assert evidence.verdict == "confirmed", str(evidence)
    rival = "highest density of another optimum over that at the truth, this scene"
    assert evidence.numbers[rival] == pytest.approx(np.e)
    assert "in 0% of the draws of this scene" in evidence.because


def test_a_covariance_is_said_to_be_too_large_where_i2_is_negative():
    """Breaks if pessimistic and optimistic change places in the sentences."""
    assert times_off(-10.0) == "10.0 times too large"
    assert times_off(3.0) == "2.0 times too small"
