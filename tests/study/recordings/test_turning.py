"""What the radars of nuScenes report in turns: the fit, and the constants that come from it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d.radar import Mounting, Recording, Reference, load_nuscenes
from d2d.radar.readers.nuscenes import MOUNTING_ERRORS
from d2d.radar.scans.scan import RadarScan, doppler_velocity
from d2d.study.recordings import turning

RNG = np.random.default_rng(0)
TRUE = np.deg2rad([1.0, -0.5])  # errors of the stated mountings
TIME = 0.04


def recording(stated: Mounting, error: float) -> Recording:
    """A sensor that is mounted otherwise than stated and looks ahead in turns."""
    mounting = Mounting(stated.x, stated.y, stated.yaw + error)
    times = 0.1 * np.arange(40)
    theta = np.column_stack([np.full(40, 6.0), np.zeros(40), np.linspace(-0.5, 0.5, 40)])
    scans = []
    for time, velocity in zip(times, theta, strict=True):
        azimuth, distance = RNG.uniform(-0.8, 0.8, 30), RNG.uniform(5.0, 60.0, 30)
        doppler = doppler_velocity(velocity, azimuth, mounting) + 0.05 * RNG.standard_normal(30)
        doppler += TIME * velocity[2] ** 2 * distance
        doppler[:5] += RNG.uniform(-8.0, 8.0, 5)  # these move
        scans.append(RadarScan(time, distance, azimuth, doppler, 0.2, 0.01, 0.1))
    return Recording(scans, stated, Reference(times, theta, np.zeros((40, 3))))


def test_the_fit_finds_both_effects():
    """Breaks if a sign is wrong, movers pull, or one effect is taken for the other."""
    drives = [
        recording(Mounting(3.4, 0.0, 0.0), TRUE[0]),
        recording(Mounting(-0.6, 0.6, 2.9), TRUE[1]),
    ]
    residuals = turning.doppler_residuals(drives)
    time, errors = turning.fit_turning(residuals)
    assert time == pytest.approx(TIME, rel=0.03)
    assert_allclose(errors, TRUE, atol=np.deg2rad(0.1))


@pytest.mark.nuscenes
def test_the_loader_has_what_the_training_scenes_give(nuscenes):
    """Breaks if the frozen constants are no longer those of the fit."""
    for scene in ("scene-0061", "scene-0103"):
        residuals = turning.doppler_residuals(turning.load_stated(nuscenes, scene))
        time, errors = turning.fit_turning(residuals)
        for channel, error in zip(turning.CHANNELS, errors, strict=True):
            stated = load_nuscenes(nuscenes, scene, channel, stated_mounting=True).mounting.yaw
            known = MOUNTING_ERRORS[channel][round(float(np.rad2deg(stated)), 2)]
            assert known == pytest.approx(float(np.rad2deg(error)), abs=0.01)
        if scene == "scene-0061":
            assert time == pytest.approx(0.037, abs=5e-4)


@pytest.mark.nuscenes
@pytest.mark.parametrize("scene", ["scene-0916", "scene-1077"])
def test_other_scenes_show_the_same(nuscenes, scene):
    """Breaks if the effect is one of the training scene alone."""
    time, _ = turning.fit_turning(turning.doppler_residuals(turning.load_stated(nuscenes, scene)))
    assert time == pytest.approx(0.037, abs=0.005)
