"""The scenes of the evaluation, the optima of its costs, its measures and tables."""

from types import SimpleNamespace

import numpy as np
import pytest

from d2d import register, rigid
from d2d.study import scenarios
from d2d.study.plane import optima
from d2d.study.plane.evaluation import (
    ALPHA,
    COSTS,
    LIKELIHOOD,
    OUTLIER_COVARIANCE,
    ROBUST,
    SUMMING,
    at_truth,
    distance_and_rotation,
    evaluated,
    over_layouts,
    same_draws,
)
from d2d.study.plane.optima import (
    DISTANCES,
    TURNS,
    Minima,
    arrival_shares,
    local_minima,
    rotation_profile,
    translation_surface,
)
from d2d.study.plane.scenarios import OVERLAPPED, Layout, random_scene, scene
from d2d.study.plane.tables import credibility_table, summary, summary_table


def test_parameters_are_those_of_the_thesis() -> None:
    """Thesis sec. 6.1, and the table of chapter 9: the one place where they are compared."""
    assert len(OVERLAPPED.targets) == 8
    for scenario in scenarios.ALL:
        np.testing.assert_allclose(scenario.theta, [5.0, 0.0, np.deg2rad(15.0)])
        assert (scenario.sigma_range, scenario.sigma_azimuth) == (0.2, 0.03)
    assert ALPHA == ROBUST.outlier.fraction == 0.2  # type: ignore[union-attr]
    np.testing.assert_array_equal(OUTLIER_COVARIANCE, [[100.0, 0.0], [0.0, 100.0]])


def test_truth_maps_moving_onto_fixed() -> None:
    for scenario in scenarios.ALL:
        fixed, moving = scenario.true_sets
        count = len(scenario.targets)
        moved = rigid.transform_means(scenario.theta, moving)
        np.testing.assert_allclose(moved[:count], fixed[:count], atol=1e-12)


def test_noise_is_polar_and_reported_as_it_is() -> None:
    fixed, _ = OVERLAPPED.sample(20_000, np.random.default_rng(0))
    truth = OVERLAPPED.targets
    distance = np.linalg.norm(fixed.means, axis=-1) - np.linalg.norm(truth, axis=-1)
    azimuth = np.arctan2(fixed.means[..., 1], fixed.means[..., 0])
    azimuth -= np.arctan2(truth[:, 1], truth[:, 0])
    np.testing.assert_allclose(distance.std(axis=0), 0.2, rtol=0.03)
    np.testing.assert_allclose(azimuth.std(axis=0), 0.03, rtol=0.03)
    first = fixed.means[0] / np.linalg.norm(fixed.means[0], axis=-1, keepdims=True)
    radial = np.einsum("ni,nij,nj->n", first, fixed.covariances[0], first)
    np.testing.assert_allclose(radial, 0.04)


def test_share_of_outliers_is_the_one_assumed() -> None:
    for scenario in scenarios.ALL:
        outliers = scenario.outliers_fixed, scenario.outliers_moving
        for lone, whole in zip(outliers, scenario.true_sets, strict=True):
            expected = ALPHA if "outliers" in scenario.name else 0.0
            assert len(lone) / len(whole) == expected, scenario.name


def test_outliers_and_companions_are_where_the_layout_says() -> None:
    layout = Layout(close=2, far=1, clusters=2, companions=3)
    for seed in range(50):
        placed = scene("any", layout, np.random.default_rng(seed))
        seeds, companions = placed.targets[:8], placed.targets[8:].reshape(2, 3, 2)
        np.testing.assert_array_equal(seeds, OVERLAPPED.targets)
        for group in companions:
            distance = np.linalg.norm(group[:, None] - seeds, axis=-1).max(axis=0)
            assert (distance <= layout.cluster_radius).sum() == 1
        both = placed.outliers_fixed, placed.outliers_moving
        for outliers, near in zip(both, OVERLAPPED.true_sets, strict=True):
            assert outliers.shape == (3, 2)
            apart = np.linalg.norm(outliers[:2, None] - near, axis=-1)
            low, high = layout.close_distance
            assert ((apart >= low) & (apart <= high)).any(axis=1).all()
            assert layout.far_distance[0] <= np.linalg.norm(outliers[2])


def test_targets_are_apart_and_in_view() -> None:
    """The random layouts may be no better distributed than the thesis's, to which they compare."""
    drawn = [random_scene("any", Layout(), np.random.default_rng(seed)) for seed in range(50)]
    for targets in (OVERLAPPED.targets, *(each.targets for each in drawn)):
        apart = np.linalg.norm(targets[:, None] - targets, axis=-1) + 1e9 * np.eye(8)
        assert apart.min() >= 6.0
        assert (np.abs(np.arctan2(targets[:, 1], targets[:, 0])) <= 0.7).all()


def test_minima_are_minima_and_the_truth_is_among_them() -> None:
    fixed, moving = scenarios.OVERLAPPED.sample(5, np.random.default_rng(5))
    found = local_minima(scenarios.OVERLAPPED, LIKELIHOOD)
    for draw, (errors, heights) in enumerate(zip(found.errors, found.log_heights, strict=True)):
        assert heights[0] == 0.0
        assert (np.diff(heights) <= 0.0).all()
        theta = errors + scenarios.OVERLAPPED.theta
        _, gradient, hessian = LIKELIHOOD.derivatives(theta, fixed[draw], moving[draw])
        np.testing.assert_allclose(gradient, 0.0, atol=1e-3)
        assert (np.linalg.eigvalsh(hessian)[:, 0] > 0.0).all()
        best = register(fixed[draw], moving[draw], LIKELIHOOD, scenarios.OVERLAPPED.theta).theta
        np.testing.assert_allclose(theta[0], best, atol=1e-6)
        apart = np.abs(theta[:, None] - theta).max(axis=-1) + np.eye(len(theta))
        assert apart.min() > 0.005


def test_optima_six_centimetres_or_0_4_degrees_apart_are_two(monkeypatch) -> None:
    """Breaks if rivals are merged, or if one optimum counts as often as it is found."""
    places = np.zeros((5, 3))
    places[1, 0], places[2, 0], places[3, 1], places[4, 2] = 0.03, 0.06, -0.06, np.deg2rad(0.4)
    ends = SimpleNamespace(
        theta=scenarios.OVERLAPPED.theta + places[:, None],
        value=np.arange(5.0)[:, None],
        converged=np.ones((5, 1), dtype=bool),
    )
    monkeypatch.setattr(optima, "register", lambda *sets, **options: ends)
    found = local_minima.__wrapped__(scenarios.OVERLAPPED, LIKELIHOOD, 1)
    np.testing.assert_allclose(found.errors[0], places[[0, 2, 3, 4]], atol=1e-12)


def test_minima_are_counted_where_they_are_and_as_high_as_they_are() -> None:
    """Breaks if a peak that nobody sees counts, or one that lies outside the search."""
    near, far, turned = (9.9, 0.0, 0.0), (0.0, 10.1, 0.0), (0.0, 0.0, np.deg2rad(46.0))
    heights = np.log([1.0, 0.0101, 0.0099])
    found = Minima((np.array([near, far, turned]),), (heights,), np.zeros(1))
    assert (found.near.tolist(), found.visible.tolist()) == ([1], [2])
    assert found.right.tolist() == [False]
    at_truth = Minima((np.array([np.zeros(3), near]),), (heights[1:],), np.zeros(1))
    np.testing.assert_allclose(at_truth.rivals, 0.0099 / 0.0101)


def test_a_start_at_the_truth_arrives_and_one_far_off_does_not() -> None:
    shares = arrival_shares(scenarios.OVERLAPPED, LIKELIHOOD)
    assert shares.shape == (len(TURNS), len(DISTANCES))
    assert shares[np.abs(TURNS).argmin(), 0] == 1.0
    assert shares[-1, -1] < 0.5


def test_surfaces_are_the_cost() -> None:
    sets = scenarios.OVERLAPPED.sample(1, np.random.default_rng(0))
    fixed, moving = (each[0] for each in sets)
    theta, offsets = scenarios.OVERLAPPED.theta, np.array([-1.0, 0.5])
    surface = translation_surface(SUMMING, fixed, moving, theta, offsets)
    assert surface[1, 0] == -SUMMING.value(theta + np.array([-1.0, 0.5, 0.0]), fixed, moving)
    profile = rotation_profile(SUMMING, fixed, moving, theta, offsets)
    assert profile[1] == -SUMMING.value(theta + np.array([0.0, 0.0, 0.5]), fixed, moving)


def test_sum_is_pessimistic_in_every_scene() -> None:
    for scenario in scenarios.ALL:
        assert evaluated(scenario, SUMMING).credibility.inclination < -3.0, scenario.name


def test_distance_and_rotation_wrap() -> None:
    distance, turn = distance_and_rotation([[3.0, -4.0, 2.0 * np.pi - 0.1]])
    np.testing.assert_allclose(distance, 5.0)
    np.testing.assert_allclose(turn, 0.1)
    errors = [[1.0, 1.0, 2.0 * np.pi + 0.1], [1.0, 1.2, 0.0], [0.0, 0.0, 0.11]]
    assert at_truth(errors).tolist() == [True, False, False]


def test_layouts_do_not_depend_on_each_other() -> None:
    few, more = (over_layouts("outliers", ROBUST, layouts=n, runs=20) for n in (3, 5))
    np.testing.assert_array_equal(few.rmse, more.rmse[:3])
    assert len(set(more.rmse)) == 5


def test_same_draws_are_those_of_the_runs() -> None:
    fixed, moving = same_draws(scenarios.OVERLAPPED, 1000)
    again = register(fixed, moving, SUMMING, scenarios.OVERLAPPED.theta)
    errors = evaluated(scenarios.OVERLAPPED, SUMMING).errors
    np.testing.assert_array_equal(again.theta - scenarios.OVERLAPPED.theta, errors)


def test_the_summary_has_a_row_for_every_scene_and_cost() -> None:
    """Breaks if a condition is left out or two columns change places."""
    rows = summary(scenarios.ALL)
    assert rows.scene[::3].tolist() == [
        "overlapped", "outliers", "clusters", "both, A", "both, B"
    ]  # fmt: skip
    assert rows.cost[:3].tolist() == ["sum", "likelihood", "robust likelihood"]
    result = evaluated(scenarios.OVERLAPPED, SUMMING)
    assert rows.from_truth[0] == at_truth(result.errors).mean()
    assert rows.inclination[0] == result.credibility.inclination
    last = summary_table(rows, "All.").rows[0][-1]
    assert last == f"{result.credibility.inclination:+.2f}"


def test_the_verdict_on_an_anees_is_that_of_its_region() -> None:
    shown = credibility_table(scenarios.OVERLAPPED)
    low, high = (float(word) for word in shown.caption.split() if word[:2] in ("0.", "1."))
    for cost, row in zip(COSTS.values(), shown.rows, strict=True):
        anees = evaluated(scenarios.OVERLAPPED, cost).credibility.anees
        assert float(row[1]) == pytest.approx(anees, abs=1e-3)
        assert row[2] == ("yes" if low < anees < high else "no")
