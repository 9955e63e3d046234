"""What chapter 9 compares: each comparison against the plain call that it stands for."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d import credibility, propagate_covariance, register
from d2d.radar import estimate_ego_motion, propagate_ego_motion, simulate_drive, track
from d2d.study import scenarios
from d2d.study.beyond import exhaustive, figures
from d2d.study.beyond.both_covariances import ALL_COSTS, both_covariances, drive_covariances, judged
from d2d.study.beyond.exhaustive import Trial
from d2d.study.beyond.solvers import SOLVERS, annealed_share, solved
from d2d.study.plane.evaluation import LIKELIHOOD, ROBUST, at_truth, evaluated, same_draws


def test_both_covariances_are_those_of_the_same_errors() -> None:
    """Breaks if the two are computed from different draws, or change places."""
    found = both_covariances(scenarios.OVERLAPPED, "robust", 200)
    fixed, moving = same_draws(scenarios.OVERLAPPED, 200)
    estimate = register(fixed, moving, ROBUST, scenarios.OVERLAPPED.theta)
    errors = estimate.theta - scenarios.OVERLAPPED.theta
    propagated = propagate_covariance(estimate, fixed, moving, ROBUST)
    assert_allclose(found.fisher.nees, credibility(errors, estimate.covariance).nees)
    assert_allclose(found.propagated.nees, credibility(errors, propagated).nees)


def test_runs_without_a_covariance_are_left_out_of_both() -> None:
    """Breaks if one kind is judged on more runs than the other."""
    rng = np.random.default_rng(0)
    errors = rng.standard_normal((50, 3))
    one, two = np.array([np.eye(3)] * 50), np.array([2.0 * np.eye(3)] * 50)
    one[3], two[7] = np.nan, np.nan
    found = judged(errors, one, two, 1.0)
    assert len(found.fisher.nees) == len(found.propagated.nees) == 48
    assert_allclose(found.fisher.nees, 2.0 * found.propagated.nees)


@pytest.mark.parametrize("name", ALL_COSTS)
def test_propagation_repairs_p2d_and_only_that(name: str) -> None:
    """Chapter 9's first finding, on the thesis's overlapped scene."""
    found = both_covariances(scenarios.OVERLAPPED, name)
    if name == "P2D":
        assert found.fisher.inclination > 2.0 > abs(found.propagated.inclination)
    elif name == "summing":
        assert found.fisher.inclination < found.propagated.inclination < -0.5
    else:
        assert abs(found.fisher.inclination - found.propagated.inclination) < 0.2


def test_drive_covariances_are_those_of_each_pair() -> None:
    """Breaks if a covariance is lost on the way, or belongs to another pair or another kind."""
    drive = simulate_drive(np.random.default_rng(2), 2.0)
    found = drive_covariances(drive, doppler=True, step=2)
    followed = track(drive.scans, drive.mounting)
    for number, i in enumerate(range(0, len(drive.scans) - 1, 2)):
        pair = drive.scans[i], drive.scans[i + 1], drive.mounting
        estimate = estimate_ego_motion(*pair, initial=followed.theta[i])
        error = estimate.theta - drive.truth.theta[i + 1]
        covariances = {
            "fisher": estimate.covariance,
            "independent": propagate_ego_motion(estimate, *pair, shared_azimuth=False),
            "shared": propagate_ego_motion(estimate, *pair),
        }
        for name, covariance in covariances.items():
            nees = error @ np.linalg.solve(covariance, error)
            assert_allclose(getattr(found, name).nees[number], nees, err_msg=name)
    assert not np.allclose(found.shared.nees, found.independent.nees, rtol=1e-3)


def test_without_doppler_there_is_no_azimuth_to_share() -> None:
    """Breaks if Doppler velocities are used unasked."""
    drive = simulate_drive(np.random.default_rng(2), 2.0)
    without = drive_covariances(drive, doppler=False, step=2)
    assert_allclose(without.shared.nees, without.independent.nees)


def test_solvers_start_where_they_are_told() -> None:
    """Breaks if ``off`` is measured from zero, or the batch differs from the loop."""
    expected = evaluated(scenarios.OVERLAPPED, ROBUST, "zero").errors[:20]
    assert_allclose(solved(scenarios.OVERLAPPED, "likelihood", 1.0, 20).result.errors, expected)
    for name in SOLVERS:
        found = solved(scenarios.OVERLAPPED, name, 0.0, 20).result
        assert np.hypot(*found.errors[:, :2].T).max() < 1.0, name


def test_likelihoods_agree_where_they_are_the_same_cost() -> None:
    """Breaks if a solver of the likelihood ends elsewhere from the same start."""
    one, two = (
        solved(scenarios.OVERLAPPED, name, 0.0, 20).result.errors
        for name in ("likelihood", "max-sum-mixture")
    )
    assert_allclose(one, two, atol=1e-3)
    assert evaluated(scenarios.OVERLAPPED, LIKELIHOOD).converged.all()


def test_annealed_share_is_what_register_does() -> None:
    """Breaks if a scale is skipped, or the outlier component is widened unasked."""
    fixed, moving = same_draws(scenarios.CLUSTERS, 100)
    for scales in ((4.0, 2.0, 1.0), (8.0, 4.0, 2.0, 1.0)):
        found = register(fixed, moving, ROBUST, scales=scales)
        expected = at_truth(found.theta - scenarios.CLUSTERS.theta).mean()
        assert annealed_share(scenarios.CLUSTERS, scales, runs=100) == expected
    # the outlier component matters at all
    scales = (4.0, 2.0, 1.0)
    plain = annealed_share(scenarios.OVERLAPPED, scales, robust=False, runs=100)
    assert plain > 0.5 > annealed_share(scenarios.OVERLAPPED, scales, runs=100)


def test_cross_range_sigma_is_that_of_a_target_at_mean_range() -> None:
    assert_allclose(figures.cross_range_sigma(Trial("f", "robust", noise=2.0)), 1.41)


def test_start_map_averages_the_directions() -> None:
    """Breaks if rows and columns are exchanged, or a direction is lost."""
    rows = exhaustive.read_table()
    _, ax = plt.subplots()
    figures.start_map(ax, rows, "robust", "1", "robust")
    image = ax.images[0].get_array()
    distance, turn = exhaustive.DISTANCES[2], exhaustive.TURNS[1]
    wanted = {"cost": "robust", "scales": "1", "distance_m": distance, "turn_deg": turn}
    chosen = exhaustive.select(rows, "start", **wanted)
    assert len(chosen) == 4
    assert_allclose(image[1, 2], np.mean([o.at_truth / o.runs for _, o in chosen]))
    plt.close()
