"""A check of the scenes in the plane must be able to come out otherwise."""

from types import SimpleNamespace

import numpy as np
import pytest

from d2d import credibility, rigid
from d2d.study.claims import CLAIMS
from d2d.study.plane import cluster_search
from d2d.study.plane.claims import clusters, indices, overlapped
from d2d.study.plane.evaluation import evaluated
from d2d.study.plane.measures import times_off
from d2d.study.plane.optima import Minima
from d2d.study.plane.scenarios import OVERLAPPED


def test_the_cluster_claim_holds_where_the_lowest_minimum_is_elsewhere(monkeypatch):
    """Breaks if the verdict rests on descents from the truth, which cannot see another minimum."""
    elsewhere = Minima(np.array([[8.0, 0.0, 0.0], np.zeros(3)]), np.array([0.0, -1.0]))
    monkeypatch.setattr(
        clusters, "local_minima", lambda scenario, cost, draws: (elsewhere,) * draws
    )
    evidence = CLAIMS["cluster-summing-wrong"].check()
    assert evidence.parts["the global minimum is wrong"] == "holds"
    rival = "median density of the next optimum over that at the truth, this scene"
    assert evidence.numbers[rival] == pytest.approx(np.e)
    assert "elsewhere in 100% of the draws of this scene" in evidence.because


def test_a_search_outside_the_thesiss_conditions_decides_nothing(monkeypatch):
    """Breaks if a layout that nobody claimed anything of saves a claim."""
    right = Minima(np.array([np.zeros(3), [8.0, 0.0, 0.0]]), np.array([0.0, -1.0]))
    monkeypatch.setattr(clusters, "local_minima", lambda scenario, cost, draws: (right,) * draws)
    monkeypatch.setattr(clusters, "shares_wrong", lambda *given, **first: np.ones(40))
    monkeypatch.setattr(clusters, "KINDS", clusters.KINDS[-1:])
    assert CLAIMS["cluster-summing-wrong"].check().verdict == "refuted"


def test_the_search_turns_the_motion_about_the_cluster():
    """Breaks if descents start where the cluster has left its place."""
    centre = np.array([20.0, -5.0])
    motions = cluster_search.turned_about(OVERLAPPED, centre, np.array([0.0, 0.5]))
    np.testing.assert_allclose(motions[0], OVERLAPPED.theta, atol=1e-12)
    before = rigid.transform_means(rigid.inverse(OVERLAPPED.theta), centre[None])
    np.testing.assert_allclose(rigid.transform_means(motions[1], before)[0], centre)


def test_the_best_limit_of_an_index_is_found():
    """Breaks if a limit between equal values counts, or only one direction is tried."""
    dangerous = np.array([True, True, False, False])
    assert indices.recognised(np.array([5.0, 6.0, 1.0, 2.0]), dangerous) == 1.0
    assert indices.recognised(np.array([1.0, 2.0, 5.0, 6.0]), dangerous) == 1.0
    assert indices.recognised(np.ones(4), dangerous) == 0.5
    assert indices.recognised(np.array([1.0, 3.0, 2.0, 4.0]), dangerous) == 0.75


@pytest.mark.parametrize(("wider", "verdict"), [(1.3, "confirmed"), (1.05, "wrong in part")])
def test_the_outlier_component_is_judged_by_what_counts(monkeypatch, wider, verdict):
    """Breaks if a change of I2 below its margin counts (0.2 dB), or one above it (1.1 dB) not."""

    def widened(scenario, cost):
        found = evaluated(scenario, cost)
        factor = 1.0 if cost == overlapped.LIKELIHOOD else wider
        return SimpleNamespace(credibility=credibility(found.errors, factor * found.covariances))

    monkeypatch.setattr(overlapped, "evaluated", widened)
    evidence = CLAIMS["overlap-outlier-component"].check()
    assert evidence.verdict == verdict, str(evidence)


def test_a_covariance_is_said_to_be_too_large_where_i2_is_negative():
    """Breaks if pessimistic and optimistic change places in the sentences."""
    assert times_off(-10.0) == "10.0 times too large"
    assert times_off(3.0) == "2.0 times too small"
