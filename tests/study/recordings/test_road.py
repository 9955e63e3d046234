"""Covariances on the road: their models, tables and drawings, and what they reach on real data."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d import log_score
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


def test_each_covariance_is_that_of_its_budget(recordings):
    """Breaks if a covariance is judged under the name of another, or two drives are mixed up."""
    own = recordings[:1]
    by_model = road.models(own, 2)
    assert list(by_model) == list(grammar.COVARIANCES)
    plain, noise, budget = (found.covariances for found in by_model.values())
    assert_allclose(plain, compare(track(own, baseline=2), own[0].reference).covariances)
    assert (np.linalg.eigvalsh(budget - noise) > -1e-12).all()
    found = road.judge({"a": own, "b": recordings[1:]})[f"baseline {road.BASELINES[0]}"]
    assert found["a"]["propagated noise"] == road.scores(by_model["propagated noise"])
    assert found["b"]["propagated noise"] != found["a"]["propagated noise"]


def test_tables_and_drawings_show_what_was_judged(recordings):
    """Breaks if a model is missing, or the numbers are not those of the comparison."""
    found = {n: road.scores(each) for n, each in road.models(recordings[:1], 2).items()}
    table = str(road_figures.score_table({"drive": found}))
    assert all(name in table for name in grammar.COVARIANCES)
    assert f"{found['noise and budget']['anees']:.2f}" in table
    errors = str(road_figures.error_table({"drive": found}))
    assert f"{found['noise and budget']['rmse'][0]:.3f}" in errors
    assert len(road_figures.draw_scores({"drive": found}).axes) == 2


def test_the_page_has_its_results():
    stored = road.read_road()
    for baseline in road.BASELINES:
        key = f"baseline {baseline}"
        assert set(stored["radarscenes"][key]) == {road.FITTED_SEQUENCE, road.HELD_OUT_SEQUENCE}
        scenes = {*road.FITTED_SCENES, *road.SEEN_SCENES, road.HELD_OUT_SCENE}
        assert set(stored["nuscenes"][key]) == scenes
    assert [row["extent"] for row in stored["extents"]] == list(road.EXTENTS)
    horizons = stored["horizons of RadarScenes"] | stored["horizons of nuScenes"]
    assert all(len(rows) == len(road.LONGER) for rows in horizons.values())
    road_figures.draw_extents(stored["extents"])
    road_figures.draw_horizons(horizons)


def test_a_rate_that_is_wrong_makes_a_turn_wrong_in_proportion_to_its_time(recordings):
    """Breaks if a rate is taken for an angle, or the two baselines or the two ways are mixed up."""
    own, wrong = recordings[0], np.deg2rad([0.0, 0.0, 3.0])
    shifted = replace(own.reference, theta=own.reference.theta - wrong)
    found = [road.turns([replace(own, reference=each)]) for each in (own.reference, shifted)]
    for name in ("with Doppler", "without Doppler"):
        assert_allclose(np.subtract(found[1][name], found[0][name]), [0.3, 1.2], atol=1e-9)
    assert not np.allclose(found[0]["with Doppler"], found[0]["without Doppler"])


def test_a_drive_that_no_folder_holds_is_named(tmp_path):
    """Breaks if results are written that lack a drive of the pages, or are of another root."""
    for root, number in (("a", 105), ("b", 108)):
        (tmp_path / root / "data" / f"sequence_{number}").mkdir(parents=True)
    listed = road.sequences([tmp_path / "a", tmp_path / "b"])
    assert road.places(listed, ["108", "105"]) == {"108": tmp_path / "b", "105": tmp_path / "a"}
    with pytest.raises(ValueError, match="109"):
        road.places(listed, ["105", "109"])


@pytest.mark.radarscenes
def test_four_sensors_are_credible_with_their_budget(radarscenes):
    """Breaks if the covariance on the road is no longer true, or the estimates become worse."""
    found = road.models(road.load_sequence(radarscenes), 2)
    measures = found["noise and budget"].measures
    plain = found["inverse Hessian"]
    assert plain.measures.anees > 5.0
    assert 0.4 < measures.anees < 1.4
    assert measures.coverage[1] > 0.9
    assert (measures.rmse < [0.035, 0.065, 0.65]).all()
    one_factor = plain.covariances * plain.measures.anees
    assert measures.log_score < log_score(plain.errors, one_factor).mean()


@pytest.mark.nuscenes
def test_five_radars_are_credible_with_their_budget(nuscenes):
    """Breaks if the covariance on the training scenes is no longer true."""
    for scene in road.FITTED_SCENES:
        found = road.models(road.load_scene(nuscenes, scene), 2)
        measures = found["noise and budget"].measures
        assert found["inverse Hessian"].measures.anees > 5.0
        assert 0.5 < measures.anees < 1.5
        assert measures.coverage[1] > 0.9
        assert (measures.rmse < [0.09, 0.11, 0.7]).all()


@pytest.mark.nuscenes
@pytest.mark.parametrize("scene", road.SEEN_SCENES)
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
    for scene, channel in product(road.FITTED_SCENES + road.SEEN_SCENES, road.SIDE_CHANNELS):
        own = load_nuscenes(nuscenes, scene, channel)
        driven = track(own, baseline=baseline)
        error = np.abs(driven.theta - own.reference.at(driven.times).theta)[:, 2]
        judgeable = np.isfinite(error)
        kept += (judgeable & driven.converged).sum()
        gross += (judgeable & driven.converged & (error > road.SIDE_ERROR)).sum()
        known += judgeable.sum()
    assert gross <= 0.01 * kept
    assert kept >= 0.6 * known


def test_tables_of_the_protocol_are_read_by_their_headings():
    """Breaks if a table is taken for another, or a row for that of another model or drive."""
    whitened = road.protocol_table("RadarScenes: all sensors: mean squares")
    noise = [float(cell.split(" / ")[0]) for cell in whitened["propagated noise"][:3]]
    stored = road.read_road()["radarscenes"]["baseline 4"][road.FITTED_SEQUENCE]
    assert_allclose(noise, stored["propagated noise"]["whitened"], atol=0.005)
    row = road_figures.rivals_table(["stored budget"]).rows[0]
    nuscenes = road.protocol_table("nuScenes: ANEES")["stored budget"][0]
    assert nuscenes.startswith(row[3])
    found = stored["noise and budget"]
    assert [row[1], row[4]] == [f"{found['anees']:.2f}", f"{found['log_score']:.2f}"]
