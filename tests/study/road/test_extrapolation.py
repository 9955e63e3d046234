"""The fits of what radars add in turns find what was put in, and tell it from other errors."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

from d2d.radar import ErrorBudget, Recording, Reference, load_nuscenes, simulate_drive, track
from d2d.radar.readers.nuscenes import MOUNTING_ERRORS
from d2d.radar.scans.scan import Mounting, RadarScan, doppler_velocity
from d2d.study.road.drive import CHANNELS, HORIZON, Drive, Source
from d2d.study.road.extrapolation import (
    ACROSS,
    OUTWARD,
    columns,
    explained,
    fit,
    mean_squares,
    medians,
    powers,
    track_alone,
)
from d2d.study.road.turning import doppler_residuals, fit_turning, load_stated

NOISE = 0.1  # m/s


def residuals(seed: int) -> pd.DataFrame:
    """Targets of five radars on a drive with bends to both sides at changing speed, no errors."""
    rng = np.random.default_rng(seed)
    count = 20_000
    time = np.sort(rng.uniform(0.0, 20.0, count))
    sensor = rng.integers(len(CHANNELS), size=count)
    direction = 1.2 * sensor + rng.uniform(-0.8, 0.8, count)
    cosine, sine = np.cos(direction), np.sin(direction)
    turning = 0.5 * np.sin(0.7 * time)
    speed = 8.0 + 4.0 * np.sin(1.9 * time)
    distance = rng.uniform(3.0, 80.0, count)
    return pd.DataFrame(
        {
            "excess": NOISE * rng.standard_normal(count),
            "outward": turning**2 * distance,
            "ahead": cosine,
            "sideways": speed * sine,
            "sensor": sensor,
            "time": time,
            "turning": turning,
            "distance": distance,
            "across": -speed * sine + 2.0 * turning * cosine,
            "gain_x": -cosine,
            "gain_y": -sine,
            "gain_w": 0.5 * cosine - 2.0 * sine,
            "change": -7.6 * np.cos(1.9 * time) * cosine,
        }
    )


def disturbed(r: pd.DataFrame, added) -> pd.DataFrame:
    """The targets with something in the Doppler velocities, and a mounting that is off."""
    mounting = 0.02 * r["sideways"] * (r["sensor"] == 1)
    return r.assign(excess=r["excess"] + added + mounting)


def test_tells_terms_from_lever_arms_in_all_scenes_together():
    """Breaks if a term has another sign or unit, or takes what belongs to a lever arm."""
    scenes, true = [], np.array([0.04, 0.03, 0.01])
    for seed in (0, 1):
        r = residuals(seed)
        terms = columns(r, OUTWARD + ACROSS) @ true
        scenes.append(disturbed(r, terms + 0.3 * r["turning"] * r["gain_y"]))
    found = fit(scenes, (*OUTWARD, *ACROSS, "lever arms"))
    assert_allclose(found.values[:3], true, atol=2e-3)
    assert (found.bounds[0, :3] < true).all()
    assert (found.bounds[1, :3] > true).all()
    assert (np.diff(found.bounds[:, :3], axis=0) < 5e-3).all()
    assert_allclose(found.values[8:13], 0.3, atol=0.03)
    one = fit(scenes[:1], ("outward by radar", *ACROSS, "lever arms"))
    assert_allclose(one.values[:5], 0.04, atol=3e-3)


@pytest.mark.parametrize("true", [(2.0, 1.0), (1.5, 0.5)])
def test_finds_powers(true):
    """Breaks if a bend to the other side counts as negative, or the two are mixed up."""
    r = residuals(2)
    shape = np.abs(r["turning"]) ** true[0] * r["distance"] ** true[1]
    found = powers(disturbed(r, 0.8 * shape / shape.max()))
    assert_allclose(found.values, true, atol=0.06)
    assert (np.abs(found.bounds - true) < 0.3).all()


def test_tells_a_wrong_yaw_rate_from_an_extrapolation():
    r = residuals(3)
    extrapolated = disturbed(r, 0.04 * r["outward"])
    assert max(explained(extrapolated)) < 0.2
    left = mean_squares(extrapolated, [(), OUTWARD])
    assert left[0] > 1.5 * left[1]
    assert left[1] == pytest.approx(NOISE**2, rel=0.03)
    assert explained(disturbed(r, 0.2 * columns(r, ("yaw rate",))[:, 0]))[0] > 5.0


def test_a_point_of_the_figure_stands_for_many_targets():
    """Breaks if an edge is lost or a bin of few targets is drawn."""
    by = pd.Series(np.repeat([0.5, 1.5, 2.5], [100, 99, 100]))
    assert_allclose(medians(by, 2.0 * by, np.arange(4.0)), ([0.5, 2.5], [1.0, 5.0]))


def test_radars_correct_themselves():
    """Breaks if the correction has another sign or size, or its yaw rate is not the radars' own."""
    drive = simulate_drive(np.random.default_rng(0), 20.0)
    own = Recording(drive.scans, drive.mounting, drive.truth, ErrorBudget())
    rates = drive.truth.theta[:, 2]
    wrong = [
        replace(scan, doppler=scan.doppler + 0.037 * rate**2 * scan.range)
        for scan, rate in zip(drive.scans, rates, strict=True)
    ]
    unknown = replace(own.reference, theta=np.full_like(own.reference.theta, np.nan))
    raw = replace(own, scans=wrong, reference=unknown)
    right, off = (track(each, horizon=HORIZON, budget=ErrorBudget()) for each in (own, raw))
    left, before = (
        np.sqrt(np.mean((driven.theta - right.theta)[:, :2] ** 2, axis=0))
        for driven in (track_alone(Drive("", [raw])), off)
    )
    assert (left < 0.3 * before).all()


# ---- Prediction time and mounting angles

TRUE = np.deg2rad([1.0, -0.5])  # errors of the stated mountings
TIME = 0.04


def recording(rng: np.random.Generator, stated: Mounting, error: float) -> Recording:
    """A sensor that is mounted otherwise than stated and looks ahead in turns."""
    mounting = Mounting(stated.x, stated.y, stated.yaw + error)
    times = 0.1 * np.arange(40)
    theta = np.column_stack([np.full(40, 6.0), np.zeros(40), np.linspace(-0.5, 0.5, 40)])
    scans = []
    for time, velocity in zip(times, theta, strict=True):
        azimuth, distance = rng.uniform(-0.8, 0.8, 30), rng.uniform(5.0, 60.0, 30)
        doppler = doppler_velocity(velocity, azimuth, mounting) + 0.05 * rng.standard_normal(30)
        doppler += TIME * velocity[2] ** 2 * distance
        doppler[:5] += rng.uniform(-8.0, 8.0, 5)  # these move
        scans.append(RadarScan(time, distance, azimuth, doppler, 0.2, 0.01, 0.1))
    return Recording(scans, stated, Reference(times, theta, np.zeros((40, 3))))


def test_finds_prediction_time_and_mounting_errors():
    """Breaks if a sign is wrong, movers pull, or one effect is taken for the other."""
    rng = np.random.default_rng(0)
    stated = (Mounting(3.4, 0.0, 0.0), Mounting(-0.6, 0.6, 2.9))
    drive = Drive("", [recording(rng, *each) for each in zip(stated, TRUE, strict=True)])
    time, errors = fit_turning(doppler_residuals(drive))
    assert time == pytest.approx(TIME, rel=0.03)
    assert_allclose(errors, TRUE, atol=np.deg2rad(0.1))


@pytest.mark.nuscenes
@pytest.mark.parametrize("scene", ["scene-0061", "scene-0103", "scene-0916", "scene-1077"])
def test_the_reader_has_the_numbers_of_the_training_scenes(nuscenes, scene):
    """Breaks if the frozen constants are no longer those of the fit, or of one scene alone."""
    drive = load_stated(Source("nuScenes", nuscenes, scene))
    time, errors = fit_turning(doppler_residuals(drive))
    if scene != "scene-0103":  # hardly a turn
        assert time == pytest.approx(0.037, abs=5e-4 if scene == "scene-0061" else 0.005)
    if scene in ("scene-0061", "scene-0103"):
        for channel, error in zip(CHANNELS, errors, strict=True):
            stated = load_nuscenes(nuscenes, scene, channel, stated_mounting=True).mounting.yaw
            known = MOUNTING_ERRORS[channel][round(float(np.rad2deg(stated)), 2)]
            assert known == pytest.approx(float(np.rad2deg(error)), abs=0.01)
