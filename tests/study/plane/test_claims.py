"""A check of the scenes in the plane must be able to come out otherwise."""

from types import SimpleNamespace

import numpy as np
import pytest

from d2d import credibility, rigid
from d2d.study.claims import CLAIMS
from d2d.study.plane import cluster_search
from d2d.study.plane.claims import clusters, combined, indices, outliers, overlapped
from d2d.study.plane.evaluation import ROBUST, evaluated
from d2d.study.plane.measures import times_off
from d2d.study.plane.optima import Minima
from d2d.study.plane.scenarios import OVERLAPPED


def test_the_cluster_claim_is_confirmed_where_the_lowest_minimum_is_elsewhere(monkeypatch):
    """Breaks if the verdict rests on descents from the truth, which cannot see another minimum."""
    elsewhere = Minima(np.array([[8.0, 0.0, 0.0], np.zeros(3)]), np.array([0.0, -1.0]))
    monkeypatch.setattr(clusters, "local_minima", lambda *given, draws=5: (elsewhere,) * draws)
    evidence = CLAIMS["cluster-summing-wrong"].check()
    assert evidence.verdict == "confirmed", str(evidence)
    rival = "median density of the next optimum over that at the truth, this scene"
    assert evidence.numbers[rival] == pytest.approx(np.e)
    assert "in 0% of the draws of this scene" in evidence.because


@pytest.mark.parametrize(("share", "verdict"), [(0.3, "qualified"), (0.02, "refuted")])
def test_a_search_that_finds_wrong_minima_in_some_draws_qualifies(monkeypatch, share, verdict):
    """Breaks if what the search finds does not count, or counts at any size."""
    right = Minima(np.array([np.zeros(3), [8.0, 0.0, 0.0]]), np.array([0.0, -1.0]))
    shares = np.random.default_rng(1).uniform(0.0, 2.0 * share, 40)
    monkeypatch.setattr(clusters, "local_minima", lambda *given, draws=5: (right,) * draws)
    monkeypatch.setattr(clusters, "shares_wrong", lambda *given, **first: shares)
    monkeypatch.setattr(clusters, "KINDS", clusters.KINDS[-1:])
    assert CLAIMS["cluster-summing-wrong"].check().verdict == verdict


def test_the_search_turns_the_motion_about_the_cluster():
    """Breaks if descents start where the cluster has left its place."""
    centre = np.array([20.0, -5.0])
    motions = cluster_search.turned_about(OVERLAPPED, centre, np.array([0.0, 0.5]))
    np.testing.assert_allclose(motions[0], OVERLAPPED.theta, atol=1e-12)
    before = rigid.transform_means(rigid.inverse(OVERLAPPED.theta), centre[None])
    np.testing.assert_allclose(rigid.transform_means(motions[1], before)[0], centre)


def test_two_scenes_that_are_the_same_refute_that_the_sum_differs(monkeypatch):
    """Breaks if a difference is not compared with its margin, or is taken of another cost."""
    scene = combined.BOTH["A"]
    monkeypatch.setattr(combined, "BOTH", {"A": scene, "B": scene})
    assert CLAIMS["all-summing-unstable"].check().verdict == "refuted"


def test_the_nci_is_enough_where_only_covariances_that_are_too_small_have_a_high_one(monkeypatch):
    """Breaks if the verdict rests on the definition of the index and not on what occurs."""
    rng = np.random.default_rng(3)
    found = []
    for optimistic in (True, False):
        nci = rng.uniform(6.0, 9.0, 50) if optimistic else rng.uniform(0.0, 1.0, 50)
        coverage = np.full(50, 0.4 if optimistic else 0.95)
        found.append(SimpleNamespace(nci=nci, inclination=nci, coverage=coverage))
    monkeypatch.setattr(indices, "conditions", lambda: found)
    assert CLAIMS["nci-not-enough"].check().verdict == "refuted"


def test_the_best_limit_of_an_index_is_found():
    """Breaks if a limit between equal values counts, or only one direction is tried."""
    dangerous = np.array([True, True, False, False])
    assert indices.recognised(np.array([5.0, 6.0, 1.0, 2.0]), dangerous) == 1.0
    assert indices.recognised(np.array([1.0, 2.0, 5.0, 6.0]), dangerous) == 1.0
    assert indices.recognised(np.ones(4), dangerous) == 0.5
    assert indices.recognised(np.array([1.0, 3.0, 2.0, 4.0]), dangerous) == 0.75


@pytest.mark.parametrize(("wider", "verdict"), [(1.3, "confirmed"), (1.05, "qualified")])
def test_the_outlier_component_is_judged_by_what_counts(monkeypatch, wider, verdict):
    """Breaks if a change of I2 below its margin counts (0.2 dB), or one above it (1.1 dB) not."""

    def widened(scenario, cost):
        found = evaluated(scenario, cost)
        factor = wider if cost == overlapped.ROBUST else 1.0
        return SimpleNamespace(credibility=credibility(found.errors, factor * found.covariances))

    monkeypatch.setattr(overlapped, "evaluated", widened)
    evidence = CLAIMS["overlap-outlier-component"].check()
    assert evidence.verdict == verdict, str(evidence)


def test_a_likelihood_with_an_outlier_component_does_not_vanish(monkeypatch):
    """Breaks if the verdict does not come from the values of the density."""
    monkeypatch.setattr(outliers, "LIKELIHOOD", ROBUST)
    assert CLAIMS["outlier-likelihood-vanishes"].check().verdict == "refuted"


def test_a_covariance_is_said_to_be_too_large_where_i2_is_negative():
    """Breaks if pessimistic and optimistic change places in the sentences."""
    assert times_off(-10.0) == "10.0 times too large"
    assert times_off(3.0) == "2.0 times too small"
