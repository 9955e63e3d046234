"""Drives are found in folders of data sets, evaluated in a row each, filtered, and followed."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from d2d import rigid
from d2d.radar import (
    ErrorBudget,
    Mounting,
    Recording,
    Sensor,
    SensorErrors,
    Track,
    load_radarscenes,
    simulate_drive,
)
from d2d.radar.tracks.path import integrate
from d2d.study.road import every_drive
from d2d.study.road.displacements import LENGTH, by_drive, drift, span_errors
from d2d.study.road.drive import DATA_SETS, Drive, find_drives, pick
from d2d.study.road.fusion import Filtered, estimates, filtered

BUDGET = ErrorBudget(azimuth=0.005, doppler=0.05)


def root(folder, *sequences: int):
    """A folder with the layout of RadarScenes, without its data."""
    for number in sequences:
        (folder / "data" / f"sequence_{number}").mkdir(parents=True)
    return folder


@pytest.fixture(scope="module")
def drive():
    """Two radars of a robot, which hardly accelerates, with slow errors of their own."""
    rng, recordings, world = np.random.default_rng(4), [], None
    for yaw, doppler in ((0.4, 0.07), (-0.4, 0.04)):
        simulated = simulate_drive(
            rng,
            12.0,
            mounting=Mounting(2.0, yaw, yaw),
            sensor=Sensor(quantised=False, clutter=0.0),
            world=world,
            errors=SensorErrors(azimuth=0.005, doppler=doppler),
        )
        world = simulated.world
        recordings.append(Recording(simulated.scans, simulated.mounting, simulated.truth, BUDGET))
    return Drive("a robot", recordings)


# ---- Where drives are


def test_finds_each_drive_once_and_in_order(tmp_path):
    """Breaks if a second folder's excerpt of the same sequence counts as another drive."""
    whole, excerpt = root(tmp_path / "a", 9, 108), root(tmp_path / "b", 9, 10)
    found = find_drives([whole, excerpt])["RadarScenes"]
    assert [(each.root, each.name) for each in found] == [
        *((whole, name) for name in ("9", "108")),
        (excerpt, "10"),
    ]
    assert pick(found, ["10", "9"]) == {"10": found[2], "9": found[0]}
    with pytest.raises(ValueError, match="109"):
        pick(found, ["9", "109"])
    with pytest.raises(ValueError, match="holds no drive"):
        find_drives([whole, tmp_path])


def test_each_drive_has_a_row_with_its_errors_or_the_reason(drive, tmp_path, monkeypatch):
    """Breaks if a drive that cannot be read ends the run or looks like a result."""

    def load(root, name, sensor):
        if name == "1":
            return load_radarscenes(root, name, sensor)
        return drive.recordings[sensor - 1]

    own = DATA_SETS["RadarScenes"]._replace(load=load, sensors=(1, 2))
    monkeypatch.setitem(DATA_SETS, "RadarScenes", own)
    table = every_drive.table_of(find_drives([root(tmp_path, 1, 2)])["RadarScenes"])
    failed, row = table.set_index("drive").loc[["1", "2"]].itertuples()
    assert "FileNotFoundError" in failed.reason
    assert np.isnan(failed.anees)
    assert (row.reason, row.radars) == ("", 2)
    judged = drive.compare(horizon=0.3, budget=BUDGET)
    assert row.anees == judged.measures.anees
    assert_allclose(
        table.loc[1, ["rmse v_x", "rmse v_y", "rmse omega"]].to_numpy(float), judged.rmse
    )


# ---- A filter fed by radars


def test_slow_errors_as_states_make_the_filter_credible(drive):
    """Breaks if estimates lose their slow errors on the way, or are given as other ones."""
    given = estimates(drive, BUDGET)
    assert len(given) == len(drive.rounds)
    squares = []
    for as_states in (False, True):
        found = filtered(drive, given, as_states)
        inverse = np.linalg.inv(found.covariances)
        squares.append(np.einsum("ni,nij,nj->n", found.errors, inverse, found.errors).mean() / 3.0)
        assert 0.3 < np.nanmean(found.nis) / 3.0 < 1.3
    assert squares[0] > 2.0 * squares[1]
    assert 0.2 < squares[1] < 2.0


def test_what_has_no_reference_is_not_judged():
    errors = np.array([[np.nan] * 3, [0.2, 0.0, 0.0], [0.0, 0.0, 0.2]])
    found = Filtered(np.array([np.nan, 3.0, 30.0]), errors, np.tile(0.04 * np.eye(3), (3, 1, 1)))
    assert found.cells() == ("5.50", "50.0%", "0.33", "100%", "0.141", "0.000", "8.103")


# ---- Displacements


@pytest.mark.parametrize("bend", [0.0, 0.05])
def test_drift_of_a_wrong_yaw_rate_and_of_a_wrong_speed(bend):
    """On a straight road a yaw rate off by w turns by w s and moves the end by w s L / 2."""
    intervals, speed = np.full(2000, 0.1), 10.0
    true = np.tile([speed, 0.0, bend], (2000, 1))
    poses = integrate(true, intervals)[1:]
    assert abs(drift(true, intervals, poses)).max() < 1e-9
    seconds = LENGTH / speed
    turned = drift(true + np.array([0.0, 0.0, 1e-4]), intervals, poses)
    assert_allclose(turned[:, 1], 1e-4 * seconds, rtol=2e-2)
    if bend == 0.0:
        assert_allclose(turned[:, 0], 1e-4 * seconds * LENGTH / 2.0, rtol=2e-2)
        slow = drift(true * [0.99, 1.0, 1.0], intervals, poses)
        assert_allclose(slow[:, 0], 0.01 * LENGTH, rtol=2e-2)


def test_displacements_are_judged_against_the_path_of_the_reference():
    """With a yaw rate off by 1e-3 rad/s, each second turns 1e-3 rad too far, and no error is lost
    where spans begin inside an interval of the track.
    """
    truth = simulate_drive(np.random.default_rng(3), duration=12.0).truth
    steps = rigid.compose(rigid.inverse(truth.poses[:-1]), truth.poses[1:])
    intervals = np.diff(truth.times)
    theta = rigid.logarithm(steps) / intervals[:, None] + np.array([0.0, 0.0, 1e-3])
    covariance, good = np.tile(1e-4 * np.eye(3), (len(theta), 1, 1)), np.ones(len(theta), bool)
    driven = Track(truth.times[1:], intervals, theta, covariance, good)
    errors, covariances = span_errors(driven, truth, 1.0)
    assert len(errors) == len(covariances) == 22
    assert_allclose(errors[:, 2], 1e-3, atol=2e-6)


def test_displacements_of_each_drive_are_judged_apart():
    """Breaks if a drive that is too sure hides one that is too unsure."""
    axes, unit = np.sqrt(3.0) * np.tile(np.eye(3), (4, 1)), np.tile(np.eye(3), (12, 1, 1))
    sure, unsure = (2.0 * axes, unit), (0.5 * axes, unit)
    assert by_drive([sure, unsure]) == "4.00 / 0.25"
    assert by_drive([sure, unsure, unsure]) == "0.25 to 4.00"
    assert by_drive([(sure[0][:2], unit[:2])]) == "–"
