"""The fits of what radars add in turns find what was put in, and tell it from other errors."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.extrapolation import (
    CHANNELS,
    HORIZON,
    across,
    by_radar,
    explained,
    fitted,
    lever_arms,
    mean_squares,
    medians,
    nothing,
    outward,
    powers,
    together,
    tracked_alone,
    yaw_rate,
)
from d2d.radar import ErrorBudget, Recording, simulate_drive, track
from d2d.study.recordings.turning import Residuals

NOISE = 0.1  # m/s


def residuals(seed: int) -> Residuals:
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
    gain = np.column_stack([-cosine, -sine, 0.5 * cosine - 2.0 * sine])
    return Residuals(
        excess=NOISE * rng.standard_normal(count),
        outward=turning**2 * distance,
        ahead=cosine,
        sideways=speed * sine,
        sensor=sensor,
        time=time,
        turning=turning,
        distance=distance,
        across=-speed * sine + 2.0 * turning * cosine,
        gain=gain,
        change=-7.6 * np.cos(1.9 * time) * cosine,
    )


def given(r: Residuals, added: np.ndarray) -> Residuals:
    """With something in the Doppler velocities, and a mounting that is off."""
    mounting = 0.02 * r.sideways * (r.sensor == 1)
    return r._replace(excess=r.excess + added + mounting)


def test_terms_are_told_from_lever_arms_in_all_scenes_together():
    """Breaks if a term has another sign or unit, or takes what belongs to a lever arm."""
    scenes, true = [], np.array([0.04, 0.03, 0.01])
    for seed in (0, 1):
        r = residuals(seed)
        terms = np.column_stack([outward(r), across(r)]) @ true
        scenes.append(given(r, terms + 0.3 * r.turning * r.gain[:, 1]))
    found = fitted(scenes, together(outward, across, lever_arms))
    assert_allclose(found.values[:3], true, atol=2e-3)
    assert (found.bounds[0, :3] < true).all()
    assert (found.bounds[1, :3] > true).all()
    assert (np.diff(found.bounds[:, :3], axis=0) < 5e-3).all()
    assert_allclose(found.values[8:13], 0.3, atol=0.03)
    one = fitted(scenes[:1], together(by_radar, across, lever_arms))
    assert_allclose(one.values[:5], 0.04, atol=3e-3)


@pytest.mark.parametrize("true", [(2.0, 1.0), (1.5, 0.5)])
def test_powers(true):
    """Breaks if a bend to the other side counts as negative, or the two are mixed up."""
    r = residuals(2)
    shape = np.abs(r.turning) ** true[0] * r.distance ** true[1]
    found = powers(given(r, 0.8 * shape / shape.max()))
    assert_allclose(found.values, true, atol=0.06)
    assert (np.abs(found.bounds - true) < 0.3).all()


def test_what_explains_the_excess():
    """Breaks if a wrong yaw rate passes for an extrapolation or the other way round, or the noise
    is not what remains."""
    r = residuals(3)
    extrapolated = given(r, 0.04 * r.outward)
    assert max(explained(extrapolated)) < 0.2
    left = mean_squares(extrapolated, [nothing, outward])
    assert left[0] > 1.5 * left[1]
    assert left[1] == pytest.approx(NOISE**2, rel=0.03)
    assert explained(given(r, 0.2 * yaw_rate(r)[:, 0]))[0] > 5.0


def test_a_point_of_the_figure_stands_for_many_targets():
    """Breaks if an edge is lost or a bin of few targets is drawn."""
    by = np.repeat([0.5, 1.5, 2.5], [100, 99, 100])
    found = medians(by, 2.0 * by, np.arange(4.0))
    assert_allclose(found, ([0.5, 2.5], [1.0, 5.0]))


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
    right, disturbed = (track(each, horizon=HORIZON, budget=ErrorBudget()) for each in (own, raw))
    left, off = (
        np.sqrt(np.mean((driven.theta - right.theta)[:, :2] ** 2, axis=0))
        for driven in (tracked_alone([raw]), disturbed)
    )
    assert (left < 0.3 * off).all()
