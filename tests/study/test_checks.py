"""A check must be able to come out otherwise, and measures what it says."""

from types import SimpleNamespace

import numpy as np
import pytest

from d2d import credibility, rigid
from d2d.study.claims import CLAIMS
from d2d.study.drives import claims as drives
from d2d.study.drives import variations
from d2d.study.drives.variations import followed
from d2d.study.estimation import claims as estimation
from d2d.study.estimation.descent import ends_of
from d2d.study.line.claims import surfaces
from d2d.study.line.scene import line_scene
from d2d.study.plane import cluster_search
from d2d.study.plane.claims import clusters, indices, overlapped
from d2d.study.plane.evaluation import evaluated, times_off
from d2d.study.plane.optima import Minima
from d2d.study.plane.scenarios import OVERLAPPED

ELSEWHERE, AT_TRUTH = [8.0, 0.0, 0.0], [0.0, 0.0, 0.0]
SURFACE_CLAIMS = [claim for claim in CLAIMS.values() if claim.section in ("4.2", "4.3")]


@pytest.fixture
def short_drives(monkeypatch):
    """Three drives of two seconds, without the memory of other checks."""
    monkeypatch.setattr(drives, "DRIVES", 3)
    monkeypatch.setattr(drives, "DURATION", 2.0)
    drives.tracked_drive.cache_clear()
    yield monkeypatch
    drives.tracked_drive.cache_clear()


def test_drive_that_meets_nobody_is_left_out(short_drives):
    """Breaks if its missing share makes the mean of all drives nan."""
    calls = []

    def weights(drive, driven, *, doppler):
        calls.append(doppler)
        nobody = len(calls) <= 2
        share = np.nan if nobody else (0.99 if doppler else 0.3) + 1e-4 * len(calls)
        kind = np.repeat(["wall" if nobody else "moving", "wall"], 400)
        return SimpleNamespace(kind=kind, rejected=lambda chosen: share)

    walkers = np.array([np.ones(20), np.arange(20) < 2]) > 0.0  # along, and across: 2 of 20
    short_drives.setattr(drives, "TargetWeights", SimpleNamespace(of=weights))
    short_drives.setattr(drives, "walkers_by_pair", lambda *_: [walkers] * 100)
    evidence = CLAIMS["doppler-rejects-moving"].check()
    assert evidence.verdict == "conditional"
    assert np.isfinite(list(evidence.numbers.values())).all()


def test_followed_pair_starts_at_the_last_velocity(short_drives):
    """Breaks if a pair starts elsewhere: then a lost one comes back."""
    drive, tracks = drives.tracked_drive(0, False)
    np.testing.assert_allclose(followed(drive, doppler=True), tracks[True].theta, atol=1e-6)
    starts = []

    def estimate(previous, current, mounting, *, initial, **options):
        starts.append(initial)
        return SimpleNamespace(theta=initial + 1.0, converged=len(starts) != 3)

    short_drives.setattr(variations, "estimate_ego_motion", estimate)
    velocities = followed(drive)
    np.testing.assert_allclose(velocities[:5, 0] - drive.truth.theta[0, 0], [1, 2, 2, 3, 4])
    np.testing.assert_allclose(starts[1:], velocities[:-1])


def test_each_optimiser_must_arrive(monkeypatch):
    """Breaks if the arrival of one method does not count."""

    def path(iterations, cost=0.0):
        return SimpleNamespace(costs=[cost], evaluations=iterations, converged=True)

    fast = {"Newton": path(6, 5.0), "Gauss-Newton": path(6), "Levenberg-Marquardt": path(6)}
    slow = ends_of([path(5000)] * estimation.STARTS)
    monkeypatch.setattr(estimation, "run_second_order", lambda problem, start: fast)
    monkeypatch.setattr(estimation, "gradient_descents", lambda problems, starts: slow)
    assert CLAIMS["second-order-faster"].check().verdict == "conditional"


def test_surfaces_of_another_scene_are_computed_anew(monkeypatch):
    """Breaks if what is computed once is kept when the scene is another."""
    monkeypatch.setattr(surfaces, "DRAWS", 50)
    evidence = [claim.check() for claim in SURFACE_CLAIMS]
    noisier = {"sigma_moving": 0.5, "sigma_fixed": 0.4}
    monkeypatch.setattr(
        surfaces, "line_scene", lambda rng, **given: line_scene(rng, **given | noisier)
    )
    for claim, before in zip(SURFACE_CLAIMS, evidence, strict=True):
        after = claim.check()
        assert after.numbers != before.numbers


@pytest.mark.parametrize(
    ("lowest", "next_lowest", "verdict"),
    [(ELSEWHERE, AT_TRUTH, "wrong in part"), (AT_TRUTH, ELSEWHERE, "refuted")],
)
def test_cluster_claim_rests_on_the_lowest_minimum(monkeypatch, lowest, next_lowest, verdict):
    """Breaks if it rests on descents from the truth, which cannot see another minimum, or if a
    layout that nobody claimed anything of saves it.
    """
    errors, heights = np.array([lowest, next_lowest]), np.array([0.0, -1.0])
    monkeypatch.setattr(
        clusters, "local_minima", lambda s, c, n: Minima((errors,) * n, (heights,) * n, [0.0])
    )
    monkeypatch.setattr(clusters, "shares_wrong", lambda *given, **first: np.ones(40))
    monkeypatch.setattr(clusters, "KINDS", clusters.KINDS[-1:])
    evidence = CLAIMS["cluster-summing-wrong"].check()
    assert evidence.verdict == verdict
    rival = "median density of the next optimum over that at the truth, this scene"
    assert evidence.numbers[rival] == pytest.approx(np.exp(1.0 if lowest == ELSEWHERE else -1.0))


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
    """Breaks if a change of I2 below its margin counts (0.2 dB), or one above it (0.6 dB) not."""

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
