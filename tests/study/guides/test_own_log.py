"""The log of the made-up car: what the page reads, and what it finds in it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d.radar import calibrate, compare, load_csv, track
from d2d.study.guides import own_log

DEGREE = np.deg2rad(1.0)
SIGMAS = {"sigma_range": 0.15, "sigma_azimuth": 0.7 * DEGREE, "sigma_doppler": 0.1}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The log's path, and what else is known of the drive."""
    path = tmp_path_factory.mktemp("log") / "log.csv"
    return path, own_log.write_log(path)


def test_the_log_is_read_as_it_was_made(written):
    """Breaks if angles are not in degrees, a column is exchanged, or a sensor is missing."""
    path, drive = written
    scans = load_csv(path, degrees=True, **SIGMAS)
    assert scans.keys() == own_log.TRUE.keys() == own_log.STATED.keys()
    for name, mounting in own_log.TRUE.items():
        found = compare(track((scans[name][:100], mounting)), drive.truth)
        assert found.rmse[0] < 0.1, name
        steps = scans[name][0].doppler / own_log.DOPPLER_STEP
        assert_allclose(steps, np.round(steps), atol=1e-6)


def test_the_calibration_finds_what_was_put_in(written):
    """Breaks if the page's errors are not those that it names, or not told by the drive."""
    path, drive = written
    scans = load_csv(path, degrees=True, **SIGMAS)
    names = list(own_log.TRUE)
    found = calibrate([(scans[n], own_log.STATED[n], drive.odometry) for n in names])
    assert found.lag == pytest.approx(own_log.ODOMETRY_LAG, abs=0.005)
    assert found.speed_factor == pytest.approx(own_log.ODOMETRY_FACTOR, abs=0.002)
    true = [own_log.TRUE[n].yaw - own_log.STATED[n].yaw for n in names]
    assert_allclose(found.yaw, true, atol=0.05 * DEGREE)
