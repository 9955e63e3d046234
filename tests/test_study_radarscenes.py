"""The small results file of chapter 8, and what is computed into it."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d.radar import Recording, Reference, Track, simulate_drive, track
from d2d.study import radarscenes

ROOT = radarscenes.data_root()


def recording(count: int = 25) -> Recording:
    """A stand-in: the beginning of a simulated drive that does not begin at time 0."""
    drive = simulate_drive(np.random.default_rng(1), 60.0)
    truth = drive.truth
    rows = slice(50, 50 + count)
    reference = Reference(truth.times[rows], truth.theta[rows].copy(), truth.poses[rows])
    scans = drive.scans[rows]
    scans[7] = scans[7][:0]
    reference.theta[-2:] = np.nan
    return Recording(scans, drive.mounting, reference)


@pytest.fixture(scope="module")
def estimated() -> dict[str, radarscenes.Result]:
    """Both variants on the stand-in."""
    return radarscenes.estimate(recording())


def test_estimates_are_those_of_track_with_and_without_doppler(estimated):
    """Breaks if the variants change places, or times are not counted from the first scan."""
    source = recording()
    assert set(estimated) == {"with Doppler", "without Doppler"}
    for name, doppler in (("with Doppler", True), ("without Doppler", False)):
        direct = track(source.scans, source.mounting, doppler=doppler)
        assert_array_equal(estimated[name].track.theta, direct.theta)
        assert_array_equal(estimated[name].track.covariance, direct.covariance)
        assert_array_equal(estimated[name].track.intervals, direct.intervals)
        assert_allclose(estimated[name].track.times, direct.times - 5.0, atol=1e-12)
        assert_array_equal(estimated[name].errors, direct.theta - source.reference.theta[1:])


def test_what_was_written_is_read(estimated, tmp_path):
    """Breaks if columns change places, a covariance loses its symmetry, or nan its place."""
    path = tmp_path / "new" / "results.csv"
    radarscenes.write(path, estimated)
    again = radarscenes.read(path)
    assert list(again) == list(estimated)
    for name, (driven, errors) in estimated.items():
        other = again[name].track
        for field in ("times", "intervals", "theta", "covariance"):
            assert_allclose(getattr(other, field), getattr(driven, field), rtol=1e-7, atol=1e-12)
        assert_array_equal(other.converged, driven.converged)
        assert other.converged.dtype == bool
        assert_allclose(again[name].errors, errors, rtol=1e-7)
        assert (~driven.converged).sum() == 2
        assert np.isnan(errors[-2:]).all()


def test_reading_and_writing_again_gives_the_same_bytes(estimated, tmp_path):
    """Breaks if the file would change each time it is touched."""
    first, second = tmp_path / "first.csv", tmp_path / "second.csv"
    radarscenes.write(first, estimated)
    radarscenes.write(second, radarscenes.read(first))
    assert first.read_bytes() == second.read_bytes()


def test_columns_are_what_the_header_says(tmp_path):
    """Breaks if the header and the order of the columns drift apart."""
    n = 2
    covariance = np.array([[11.0, 12.0, 13.0], [12.0, 22.0, 23.0], [13.0, 23.0, 33.0]])
    driven = Track(
        np.array([0.1, 0.3]),
        np.array([0.1, 0.2]),
        np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]),
        np.broadcast_to(covariance, (n, 3, 3)),
        np.array([True, False]),
    )
    result = radarscenes.Result(driven, np.array([[0.7, 0.8, 0.9], [np.nan] * 3]))
    path = tmp_path / "results.csv"
    radarscenes.write(path, {"without Doppler": result})
    table = np.genfromtxt(path, delimiter=",", names=True)
    expected = {
        "doppler": [0, 0],
        "time_s": [0.1, 0.3],
        "interval_s": [0.1, 0.2],
        "converged": [1, 0],
        "vx": [1, 4],
        "vy": [2, 5],
        "omega": [3, 6],
        "cov_xx": [11, 11],
        "cov_xy": [12, 12],
        "cov_xw": [13, 13],
        "cov_yy": [22, 22],
        "cov_yw": [23, 23],
        "cov_ww": [33, 33],
        "error_vx": [0.7, np.nan],
        "error_vy": [0.8, np.nan],
        "error_omega": [0.9, np.nan],
    }
    assert list(table.dtype.names) == list(expected)
    for name, values in expected.items():
        assert_allclose(table[name], values, err_msg=name)


def test_judged_leaves_out_what_is_not_known(estimated):
    """Breaks if a pair without an estimate or without a reference is judged."""
    judged = estimated["with Doppler"].judged
    assert len(judged.errors) == 24 - 2 - 2
    assert judged.share == pytest.approx(20 / 24)
    assert np.isfinite(judged.rmse).all()


def test_a_results_file_holds_no_measurements(estimated, tmp_path):
    """Breaks if the data set's own numbers get into what is committed: see its licence."""
    path = tmp_path / "results.csv"
    radarscenes.write(path, estimated)
    header = path.read_text().splitlines()[0].split(",")
    assert not {"range", "azimuth", "vr", "rcs", "x_seq", "y_seq", "yaw_seq"} & set(header)
    assert len(path.read_text().splitlines()) == 1 + 2 * 24


@pytest.mark.parametrize(("value", "expected"), [(None, None), ("", None), ("/x/y", Path("/x/y"))])
def test_the_data_s_place_comes_from_the_environment(monkeypatch, value, expected):
    """Breaks if an unset or empty variable means the working directory."""
    if value is None:
        monkeypatch.delenv("D2D_RADARSCENES", raising=False)
    else:
        monkeypatch.setenv("D2D_RADARSCENES", value)
    assert radarscenes.data_root() == expected


def test_default_path_is_beside_the_chapters():
    """Breaks if the module moves and the path does not."""
    path = radarscenes.default_path(105, 3)
    assert path.name == "radarscenes_105_3.csv"
    assert path.parent == Path(__file__).resolve().parents[1] / "chapters" / "results"


def test_the_command_writes_the_results_of_what_it_is_asked_for(monkeypatch, tmp_path, capsys):
    """Breaks if an option is not handed on, or the file goes elsewhere."""
    asked = []

    def load(*arguments):
        asked.append(arguments)
        return recording()

    monkeypatch.setattr(radarscenes, "load_radarscenes", load)
    monkeypatch.setattr(
        radarscenes, "default_path", lambda sequence, sensor: tmp_path / f"{sequence}-{sensor}.csv"
    )
    monkeypatch.setattr(sys, "argv", ["x", "/data", "--sequence", "9", "--sensor", "2"])
    radarscenes.main()
    assert asked == [("/data", 9, 2)]
    assert len(radarscenes.read(tmp_path / "9-2.csv")) == 2
    printed = capsys.readouterr().out
    assert "with Doppler: RMSE v_x" in printed
    assert str(tmp_path / "9-2.csv") in printed


def test_the_committed_results_can_be_read():
    """Breaks if the file in the repository is not the one that the code writes."""
    results = radarscenes.read(radarscenes.default_path(105, 3))
    sharp, plain = (results[name].judged for name in ("with Doppler", "without Doppler"))
    assert len(results["with Doppler"].track.times) == 397
    assert sharp.share > 0.99
    assert sharp.rmse[0] <= 0.06
    assert sharp.rmse[1] <= 0.15
    assert sharp.rmse[2] <= 1.8
    assert plain.rmse[0] >= 10.0 * sharp.rmse[0]


@pytest.mark.radarscenes
@pytest.mark.skipif(
    ROOT is None, reason="set D2D_RADARSCENES to the folder of the RadarScenes data set"
)
def test_the_committed_results_are_what_the_data_give(tmp_path):
    """Breaks if the code changes the estimates and the chapter still shows the old ones."""
    fresh = radarscenes.estimate(radarscenes.load_radarscenes(ROOT, 105, 3))
    radarscenes.write(tmp_path / "fresh.csv", fresh)
    fresh = radarscenes.read(tmp_path / "fresh.csv")
    committed = radarscenes.read(radarscenes.default_path(105, 3))
    assert list(fresh) == list(committed)
    for name, (driven, errors) in committed.items():
        for field in ("times", "intervals", "theta", "covariance", "converged"):
            assert_allclose(
                getattr(fresh[name].track, field),
                getattr(driven, field),
                rtol=1e-5,
                atol=1e-9,
                err_msg=f"{name}: {field}",
            )
        assert_allclose(fresh[name].errors, errors, rtol=1e-5, atol=1e-7)
