"""A check must be able to come out otherwise, and measures what it says."""

from types import SimpleNamespace

import numpy as np
import pytest

from d2d import credibility, rigid
from d2d.study.claims import CLAIMS
from d2d.study.plane import cluster_search
from d2d.study.plane.claims import indices, overlapped
from d2d.study.plane.evaluation import evaluated, times_off
from d2d.study.plane.scenarios import OVERLAPPED


def test_search_turns_the_motion_about_the_cluster():
    """Breaks if descents start where the cluster has left its place."""
    centre = np.array([20.0, -5.0])
    motions = cluster_search.turned_about(OVERLAPPED, centre, np.array([0.0, 0.5]))
    np.testing.assert_allclose(motions[0], OVERLAPPED.theta, atol=1e-12)
    before = rigid.transform_means(rigid.inverse(OVERLAPPED.theta), centre[None])
    np.testing.assert_allclose(rigid.transform_means(motions[1], before)[0], centre)


@pytest.mark.parametrize(
    ("index", "share"),
    [
        ([5.0, 6.0, 1.0, 2.0], 1.0),
        ([1.0, 2.0, 5.0, 6.0], 1.0),
        ([1.0] * 4, 0.5),
        ([1, 3, 2, 4], 0.75),
    ],
)
def test_best_limit_of_an_index_is_found(index, share):
    """Breaks if a limit between equal values counts, or only one direction is tried."""
    dangerous = np.array([True, True, False, False])
    assert indices.recognised(np.array(index), dangerous) == share


@pytest.mark.parametrize(("wider", "verdict"), [(1.15, "confirmed"), (1.05, "wrong in part")])
def test_outlier_component_is_judged_by_what_counts(monkeypatch, wider, verdict):
    """Breaks if a change of I² below its margin counts (0.2 dB), or one above it (0.6 dB) not."""

    def widened(scenario, cost):
        found = evaluated(scenario, cost)
        factor = 1.0 if cost == overlapped.LIKELIHOOD else wider
        return SimpleNamespace(credibility=credibility(found.errors, factor * found.covariances))

    monkeypatch.setattr(overlapped, "evaluated", widened)
    assert CLAIMS["overlap-outlier-component"].check().verdict == verdict


def test_covariance_is_too_large_where_i2_is_negative():
    """Breaks if pessimistic and optimistic change places in the sentences."""
    assert times_off(-10.0) == "10.0 times too large"
    assert times_off(3.0) == "2.0 times too small"
