"""What every reader of a data set returns, checked on the data set where it is present.

A data set that is added to `READERS` needs a line here: a recording that even an excerpt has, and
its sensors.  The environment variable of its name gives the folder.
"""

import numpy as np
import pytest

from d2d.radar import ErrorBudget, Mounting, Recording, sensor_velocity
from d2d.radar.readers import READERS
from tests.conftest import folder_of

TRIALS = {
    "radarscenes": ("105", (1, 2, 3, 4)),
    "nuscenes": ("scene-0061", ("RADAR_FRONT", "RADAR_FRONT_LEFT")),
}


@pytest.fixture(scope="module", params=TRIALS)
def recordings(request: pytest.FixtureRequest) -> list[Recording]:
    """One of each sensor of the trial."""
    reader, (name, sensors) = READERS[request.param], TRIALS[request.param]
    root = folder_of(reader.name)
    return [reader.load(root, name, sensor) for sensor in sensors]


def test_scans_are_in_time_order_and_not_empty(recordings: list[Recording]) -> None:
    """Breaks if files are read in another order, or all targets are left out."""
    for each in recordings:
        times = [scan.time for scan in each.scans]
        assert len(times) > 10
        assert (np.diff(times) > 0.0).all()
        assert np.median([len(scan) for scan in each.scans]) > 5


def test_each_sensor_has_its_own_place(recordings: list[Recording]) -> None:
    places = {each.mounting for each in recordings}
    assert len(places) == len(recordings)
    assert Mounting() not in places


def test_the_reference_is_at_the_times_of_the_scans(recordings: list[Recording]) -> None:
    """Breaks if rows are those of other scans, or most of the drive has no reference."""
    for each in recordings:
        assert each.reference.times.tolist() == [scan.time for scan in each.scans]
        assert np.isfinite(each.reference.theta).all(axis=1).mean() > 0.9
        assert np.isfinite(each.reference.poses).all(axis=1).mean() > 0.9


def test_doppler_velocities_are_those_of_the_reference(recordings: list[Recording]) -> None:
    """Breaks if a sign, a mounting, a clock or a unit is wrong: each costs metres per second."""
    for each in recordings:
        x, y, _ = each.mounting.pose
        errors, speeds = [], []
        for scan, theta in zip(each.scans, each.reference.theta, strict=True):
            if len(scan) >= 10 and np.isfinite(theta).all():
                expected = theta[:2] + theta[2] * np.array([-y, x])
                errors.append(sensor_velocity(scan, each.mounting) - expected)
                speeds.append(np.linalg.norm(expected))
        assert np.median(np.linalg.norm(errors, axis=1)) < 0.05 * np.median(speeds)


def test_shared_errors_are_stated_with_their_source(recordings: list[Recording]) -> None:
    """Breaks if covariances of a data set are those of independent targets only."""
    for each in recordings:
        assert isinstance(each.budget, ErrorBudget)
        assert each.budget.source
