"""The fit of what radars add in turns finds what was put in."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d.radar import Recording, Reference, load_nuscenes
from d2d.radar.readers.nuscenes import MOUNTING_ERRORS
from d2d.radar.scans.scan import Mounting, RadarScan, doppler_velocity
from d2d.study.road.drive import CHANNELS, Drive, Source
from d2d.study.road.extrapolation import doppler_residuals, fit_turning, load_stated

TRUE = np.deg2rad([1.0, -0.5])  # errors of the stated mountings
TIME = 0.04  # s
NOISE = 0.05  # m/s


def recording(rng: np.random.Generator, stated: Mounting, error: float) -> Recording:
    """A sensor that is mounted otherwise than stated and looks ahead in turns."""
    mounting = Mounting(stated.x, stated.y, stated.yaw + error)
    times = 0.1 * np.arange(40)
    theta = np.column_stack([np.full(40, 6.0), np.zeros(40), np.linspace(-0.5, 0.5, 40)])
    scans = []
    for time, velocity in zip(times, theta, strict=True):
        azimuth, distance = rng.uniform(-0.8, 0.8, 30), rng.uniform(5.0, 60.0, 30)
        doppler = doppler_velocity(velocity, azimuth, mounting) + NOISE * rng.standard_normal(30)
        doppler += TIME * velocity[2] ** 2 * distance
        doppler[:5] += rng.uniform(-8.0, 8.0, 5)  # these move
        scans.append(RadarScan(time, distance, azimuth, doppler, 0.2, 0.01, 0.1))
    return Recording(scans, stated, Reference(times, theta, np.zeros((40, 3))))


def test_finds_prediction_time_and_mounting_errors():
    """Breaks if a sign is wrong, movers pull, or one effect is taken for the other."""
    rng = np.random.default_rng(0)
    stated = (Mounting(3.4, 0.0, 0.0), Mounting(-0.6, 0.6, 2.9))
    drive = Drive("", [recording(rng, *each) for each in zip(stated, TRUE, strict=True)])
    found = fit_turning(doppler_residuals(drive))
    assert found.time == pytest.approx(TIME, rel=0.03)
    assert found.bounds[0] < TIME < found.bounds[1]
    assert np.diff(found.bounds) < 0.005
    assert_allclose(found.mountings, TRUE, atol=np.deg2rad(0.1))
    assert found.rms == pytest.approx(NOISE, rel=0.2)
    assert found.rms_without > 1.5 * found.rms


@pytest.mark.nuscenes
@pytest.mark.parametrize("scene", ["scene-0061", "scene-0103", "scene-0916", "scene-1077"])
def test_the_reader_has_the_numbers_of_the_training_scenes(nuscenes, scene):
    """Breaks if the frozen constants are no longer those of the fit, or of one scene alone."""
    found = fit_turning(doppler_residuals(load_stated(Source("nuScenes", nuscenes, scene))))
    if scene != "scene-0103":  # hardly a turn
        assert found.time == pytest.approx(0.037, abs=5e-4 if scene == "scene-0061" else 0.005)
    if scene in ("scene-0061", "scene-0103"):
        for channel, error in zip(CHANNELS, found.mountings, strict=True):
            stated = load_nuscenes(nuscenes, scene, channel, stated_mounting=True).mounting.yaw
            known = MOUNTING_ERRORS[channel][round(float(np.rad2deg(stated)), 2)]
            assert known == pytest.approx(float(np.rad2deg(error)), abs=0.01)
