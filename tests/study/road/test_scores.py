"""Covariances on the road: their models, tables and drawings, and what they reach on real data."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d import log_score
from d2d.radar import ErrorBudget, Recording, compare, simulate_drive, track
from d2d.radar.simulation.drive import CAR_MOUNTING, CAR_SPEED
from d2d.study.book import grammar
from d2d.study.road import scores, simulated
from d2d.study.road.drive import Drive, Source


@pytest.fixture(scope="module")
def drives() -> list[Drive]:
    """Two cars with one sensor each on the same street."""
    made = []
    for seed in (0, 1):
        drive = simulate_drive(np.random.default_rng(seed), 4.0, CAR_SPEED, mounting=CAR_MOUNTING)
        budget = ErrorBudget(azimuth=0.002, doppler=0.02)
        made.append(Drive("", [Recording(drive.scans, drive.mounting, drive.truth, budget)]))
    return made


def test_each_covariance_is_that_of_its_budget(drives):
    """Breaks if a covariance is judged under the name of another, or two drives are mixed up."""
    by_model = scores.models(drives[0], scores.BASELINE)
    assert list(by_model) == list(grammar.COVARIANCES)
    plain, noise, budget = (found.covariances for found in by_model.values())
    (own,) = drives[0].recordings
    assert_allclose(plain, compare(track(own, baseline=4, carry=False), own.reference).covariances)
    assert (np.diagonal((budget - noise).mean(axis=0)) > 0.0).all()
    found = scores.by_baseline(dict(zip("ab", drives, strict=True)))
    found = found[f"baseline {scores.BASELINE}"]
    assert found["a"]["propagated noise"] == scores.scores(by_model["propagated noise"])
    assert found["b"]["propagated noise"] != found["a"]["propagated noise"]


def test_a_rate_that_is_wrong_makes_a_turn_wrong_in_proportion_to_its_time(drives):
    """Breaks if a rate is taken for an angle, or the two baselines or the two ways are mixed up."""
    (own,), wrong = drives[0].recordings, np.deg2rad([0.0, 0.0, 3.0])
    shifted = replace(own.reference, theta=own.reference.theta - wrong)
    found = [
        scores.turns(Drive("", [replace(own, reference=each)])) for each in (own.reference, shifted)
    ]
    for name in ("with Doppler", "without Doppler"):
        assert_allclose(np.subtract(found[1][name], found[0][name]), [0.3, 1.2], atol=1e-9)
    assert not np.allclose(found[0]["with Doppler"], found[0]["without Doppler"])


@pytest.mark.radarscenes
def test_four_sensors_are_credible_with_their_budget(radarscenes):
    """Breaks if the covariance on the road is no longer true, or the estimates become worse."""
    found = scores.models(Source("RadarScenes", radarscenes, "105").load(), 2)
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
    """Breaks if the covariance is no longer true on the training scenes, or on two others."""
    for scene in scores.FITTED_SCENES + scores.SEEN_SCENES:
        drive = Source("nuScenes", nuscenes, scene).load()
        fitted = scene in scores.FITTED_SCENES
        measures = drive.compare(budget=drive.budget).measures
        assert 0.5 < measures.anees < (1.5 if fitted else 2.0)
        assert measures.coverage[1] > (0.9 if fitted else 0.85)
        assert (measures.rmse < ([0.05, 0.05, 0.5] if fitted else [0.09, 0.11, 0.9])).all()
        if fitted:
            assert drive.compare(baseline=2).measures.anees > 5.0


@pytest.mark.parametrize("vehicle", ["robot", "train"])
def test_simulated_vehicles_are_followed(vehicle):
    """Breaks if a vehicle's truth is not that of its scans."""
    found = simulated.squares(vehicle, 10.0, 4, simulated.BUDGET, 0)
    assert (found < 4.0).all()
    assert found[1, 2] == pytest.approx(found[0, 2], rel=0.03)  # only the jerks come after it
