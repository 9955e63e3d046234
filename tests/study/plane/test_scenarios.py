"""The scenes of the evaluation: what the thesis states, and what is placed at random."""

import numpy as np

from d2d import rigid
from d2d.study import scenarios
from d2d.study.plane.evaluation import ALPHA, OUTLIER_COVARIANCE, ROBUST
from d2d.study.plane.scenarios import OVERLAPPED, Layout, random_scene, scene


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
        np.testing.assert_allclose(
            rigid.transform_means(scenario.theta, moving)[:count], fixed[:count], atol=1e-12
        )


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
