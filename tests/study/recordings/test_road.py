"""Covariances on the road: their models, tables and drawings, and what they reach on real data."""

from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d.radar import ErrorBudget, Recording, compare, load_nuscenes, simulate_drive, track
from d2d.radar.simulation.drive import CAR_MOUNTING, CAR_SPEED
from d2d.study.book import grammar
from d2d.study.recordings import road, road_figures


@pytest.fixture(scope="module")
def recordings():
    """Two sensors that see the same street from one car, as recordings."""
    made = []
    for seed in (0, 1):
        drive = simulate_drive(np.random.default_rng(seed), 4.0, CAR_SPEED, mounting=CAR_MOUNTING)
        budget = ErrorBudget(azimuth=0.002, doppler=0.02)
        made.append(Recording(drive.scans, drive.mounting, drive.truth, budget))
    return made


@pytest.fixture(scope="module")
def judged(recordings):
    part = road.whole(recordings[:1], 2)
    return part, [road.between(part, 0.0, 0.5), road.between(part, 0.5, 1.0)]


def test_the_simple_models_are_fitted_where_they_are_said_to_be(judged):
    """Breaks if a factor or a constant matrix is fitted to what it is judged on, or to nothing."""
    part, (first, second) = judged
    own = road.models(part, [part])
    assert own["inverse Hessian, one factor"].measures.anees == pytest.approx(1.0)
    assert own["one constant matrix"].measures.anees == pytest.approx(1.0)
    errors = second["inverse Hessian"].errors
    other = road.models(first, [second])["one constant matrix"].covariances
    assert_allclose(other[0], errors.T @ errors / len(errors))
    budget = part["noise and budget"].covariances
    assert_allclose(own["noise and budget"].covariances, budget)
    added = np.linalg.eigvalsh(budget - part["propagated noise"].covariances)
    assert (added > -1e-12).all()


def test_halves_share_the_drive(judged):
    """Breaks if an estimate is in neither half, or the halves overlap by more than the middle."""
    part, halves = judged
    whole, first, second = (each["inverse Hessian"].times for each in (part, *halves))
    assert len(first) + len(second) in (len(whole), len(whole) + 1)
    assert first[-1] <= second[0]


def test_tables_and_drawings_show_what_was_judged(judged):
    """Breaks if a model is missing, or the numbers are not those of the comparison."""
    part, _ = judged
    found = {name: road.scores(each) for name, each in road.models(part, [part]).items()}
    table = str(road_figures.score_table({"drive": found}))
    assert all(name in table for name in grammar.COVARIANCES)
    assert f"{found['noise and budget']['anees']:.2f}" in table
    scores = road_figures.log_score_table({"drive": found})
    assert scores.rows[0][1] in table
    errors = str(road_figures.error_table({"drive": found}))
    assert f"{found['noise and budget']['rmse'][0]:.3f}" in errors
    assert len(road_figures.draw_scores({"drive": found}).axes) == 2


def test_the_page_has_its_results():
    stored = road.read_road()
    for baseline in road.BASELINES:
        key = f"baseline {baseline}"
        assert set(stored["radarscenes"][key]) == {"all", "first half", "second half"}
        assert set(stored["nuscenes"][key]) == {*road.FITTED_SCENES, *road.OTHER_SCENES}
    assert [row["extent"] for row in stored["extents"]] == list(road.EXTENTS)
    horizons = stored["horizons of RadarScenes"] | stored["horizons of nuScenes"]
    assert all(len(rows) == len(road.LONGER) for rows in horizons.values())
    road_figures.draw_extents(stored["extents"])
    road_figures.draw_horizons(horizons)


@pytest.mark.radarscenes
def test_four_sensors_are_credible_with_their_budget(radarscenes):
    """Breaks if the covariance on the road is no longer true, or the estimates become worse."""
    own = road.load_sequence(radarscenes)
    part = road.whole(own, 2)
    measures = part["noise and budget"].measures
    assert part["inverse Hessian"].measures.anees > 5.0
    assert 0.4 < measures.anees < 1.4
    assert measures.coverage[1] > 0.9
    assert (measures.rmse < [0.035, 0.065, 0.65]).all()
    assert measures.log_score < road.models(part, [part])["inverse Hessian, one factor"].measures[6]


@pytest.mark.nuscenes
def test_five_radars_are_credible_with_their_budget(nuscenes):
    """Breaks if the covariance on the training scenes is no longer true."""
    for scene in road.FITTED_SCENES:
        part = road.whole(road.load_scene(nuscenes, scene), 2)
        measures = part["noise and budget"].measures
        assert part["inverse Hessian"].measures.anees > 5.0
        assert 0.5 < measures.anees < 1.5
        assert measures.coverage[1] > 0.9
        assert (measures.rmse < [0.09, 0.11, 0.7]).all()


@pytest.mark.nuscenes
@pytest.mark.parametrize("scene", road.OTHER_SCENES)
def test_other_scenes_are_credible_over_a_horizon_of_a_third_of_a_second(nuscenes, scene):
    """Breaks if scenes that nothing was fitted to are no longer judged rightly."""
    own = road.load_scene(nuscenes, scene)
    driven = track(own, horizon=0.3, budget=own[0].budget)
    measures = compare(driven, road.joint_reference(own)).measures
    assert 0.5 < measures.anees < 2.0
    assert measures.coverage[1] > 0.85
    assert (measures.rmse < [0.09, 0.11, 0.7]).all()


@pytest.mark.nuscenes
@pytest.mark.parametrize("baseline", [1, 2])
def test_side_radars_rarely_end_far_off(nuscenes, baseline):
    """Breaks if an estimate of a lone side radar is grossly wrong and said to be good."""
    kept = gross = known = 0
    for scene, channel in product(road.FITTED_SCENES + road.OTHER_SCENES, road.SIDE_CHANNELS):
        own = load_nuscenes(nuscenes, scene, channel)
        driven = track(own, baseline=baseline)
        error = np.abs(driven.theta - own.reference.at(driven.times).theta)[:, 2]
        judgeable = np.isfinite(error)
        kept += (judgeable & driven.converged).sum()
        gross += (judgeable & driven.converged & (error > road.SIDE_ERROR)).sum()
        known += judgeable.sum()
    assert gross <= 0.01 * kept
    assert kept >= 0.6 * known


def test_what_is_carried_alike_is_of_sequence_105():
    """Breaks if the table of the protocol is read in another column, or of another drive."""
    alike = road.carried_alike()
    noise = road.read_road()["radarscenes"]["baseline 4"]["all"]["propagated noise"]["whitened"]
    assert_allclose(alike["propagated noise"], noise, atol=0.005)
    assert alike["inverse Hessian"][2] > alike["propagated noise"][2]
