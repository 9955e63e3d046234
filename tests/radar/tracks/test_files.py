"""The files of a track, its data frame, and that nothing is half written."""

import os
import stat
from dataclasses import fields, replace
from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d.radar import Track
from tests.radar.scenes import arc
from tests.radar.tracks.test_track import N, example


def assert_same(one: Track, other: Track) -> None:
    """Equal in all fields, types and bits, nan included."""
    for field in fields(Track):
        first, second = getattr(one, field.name), getattr(other, field.name)
        if first is None or second is None:
            assert first is second, field.name
            continue
        assert type(first) is type(second)
        assert first.dtype == second.dtype
        assert first.shape == second.shape
        assert first.tobytes() == second.tobytes(), field.name


def test_a_saved_track_loads_bit_by_bit(tmp_path):
    """Breaks if a field is lost, a type changes or None becomes an array."""
    for errors, known in product((False, True), (False, True)):
        driven = example(errors=errors, known=known)
        driven.save(tmp_path / "drive.npz")
        assert_same(Track.load(tmp_path / "drive.npz"), driven)
        assert os.listdir(tmp_path) == ["drive.npz"]


def test_a_file_gets_the_name_that_was_asked_for(tmp_path, monkeypatch):
    """Breaks if NumPy adds its suffix, or a tilde is a folder's name."""
    monkeypatch.setenv("HOME", str(tmp_path))
    example().save("~/drive.track")
    assert os.listdir(tmp_path) == ["drive.track"]
    assert_same(Track.load("~/drive.track"), example())
    example().write_tum("~/drive.tum")
    assert len(np.loadtxt(tmp_path / "drive.tum")) == N + 1


def test_what_is_no_whole_file_of_a_track_is_refused(tmp_path):
    """Breaks if half a file loads, a flipped bit changes a velocity or drops the reasons, any
    arrays pass for a track, Python objects are unpacked, or the error is zipfile's."""
    example().save(tmp_path / "whole.npz")
    whole = (tmp_path / "whole.npz").read_bytes()
    damaged = bytearray(whole)
    damaged[len(damaged) // 3] ^= 16
    lengths = 0, 1, 100, len(whole) // 2, len(whole) - 1
    contents = [b"no archive", bytes(damaged), *(whole[:length] for length in lengths)]
    for i, content in enumerate(contents):
        (tmp_path / f"damaged {i}.npz").write_bytes(content)
    with np.load(tmp_path / "whole.npz") as file:
        fields = {**file}
    renamed = {**fields, "reasonr": fields["reasons"]}
    del renamed["reasons"]
    for name, arrays in (
        ("renamed", renamed),
        *((gone, {n: v for n, v in fields.items() if n != gone}) for gone in ("theta", "times")),
        ("later", {"format": "d2d.radar.Track 9"}),
        ("other", {"times": np.arange(3.0)}),
    ):
        np.savez(tmp_path / f"{name}.npz", **arrays)
    np.save(tmp_path / "array.npz.npy", np.arange(3.0))
    np.save(tmp_path / "objects.npz.npy", np.array([{}], dtype=object), allow_pickle=True)
    said = {"renamed": r"also holds \['reasonr'\]", "later": "has the format 'd2d.radar.Track 9'"}
    said |= {gone: rf"lacks \['{gone}'\]" for gone in ("theta", "times")}
    for file in set(tmp_path.iterdir()) - {tmp_path / "whole.npz"}:
        name = file.name.split(".")[0]
        reason = said.get(name, "is not a complete file of Track.save")
        with pytest.raises(ValueError, match=rf"{name}\.npz.* {reason}"):
            Track.load(file)
    with pytest.raises(FileNotFoundError):
        Track.load(tmp_path / "none.npz")


each_writer = pytest.mark.parametrize(
    "write", [Track.save, Track.write_tum, Track.write_velocities]
)


@each_writer
def test_a_file_is_replaced_whole_or_not_at_all(tmp_path, monkeypatch, write):
    """Breaks if an interrupted writer leaves half a file, a part of its own, or nothing."""
    file = tmp_path / "drive"
    file.write_text("before", encoding="utf-8")

    def full(*_arguments):
        raise OSError("no space left")

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", full)
        with pytest.raises(OSError, match="no space left"):
            write(example(), file)
    assert os.listdir(tmp_path) == ["drive"]
    assert file.read_text(encoding="utf-8") == "before"
    write(example(), file)
    assert os.listdir(tmp_path) == ["drive"]
    assert file.stat().st_size > 1000


@each_writer
def test_a_file_has_the_usual_rights_and_a_link_stays_one(tmp_path, write):
    """Breaks if others may not read it, as of temporary files, a link is replaced, or the error
    about a folder that is not there names a temporary file that nobody has heard of."""
    (tmp_path / "plain").touch()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    write(example(), tmp_path / "link")
    assert (tmp_path / "link").is_symlink()
    rights = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("plain", "real")]
    assert rights[0] == rights[1]
    with pytest.raises(FileNotFoundError, match=r"nowhere does not exist"):
        write(example(), tmp_path / "nowhere" / "drive")


def test_a_table_holds_what_the_track_and_its_data_frame_hold(tmp_path):
    """Breaks if a digit is lost, columns change places, a comma in a reason is a column, or a data
    frame holds other columns than the table."""
    pandas = pytest.importorskip("pandas")
    exactly = {"float_precision": "round_trip"} if pandas.__version__.startswith("2.") else {}
    known = example()
    commas = replace(known, reasons=np.where(known.reasons == "", "", "a speed, or less"))
    for driven in (commas, example(known=False), known[:0]):
        driven.write_velocities(tmp_path / "drive.csv")
        read = pandas.read_csv(tmp_path / "drive.csv", **exactly)
        frame = driven.to_dataframe()
        assert list(read) == list(frame)
        assert ("targets" in read) == (driven.targets is not None)
        covariances = {"cov_v_x_v_y": (0, 1), "cov_v_x_omega": (0, 2), "var_omega": (2, 2)}
        for table in (read, frame) if len(driven) else ():
            assert table["converged"].dtype == bool
            assert_array_equal(table["time"], driven.times)
            assert_array_equal(table[["v_x", "v_y", "omega"]], driven.theta)
            assert_array_equal(table["guessed"], driven.guessed)
            for name, (row, column) in covariances.items():
                assert_array_equal(table[name], driven.covariance[:, row, column])
            if driven.reasons is not None:
                assert_array_equal(table["reasons"].fillna(""), driven.reasons)


def test_a_tum_file_is_what_evo_reads(tmp_path):
    """Breaks if columns change places, the first pose is lost, or quaternions are not of yaw."""
    file_interface = pytest.importorskip("evo.tools.file_interface")
    driven = example()
    start = (3.0, -2.0, 2.5)
    driven.write_tum(tmp_path / "path.tum", start)
    read = file_interface.read_tum_trajectory_file(tmp_path / "path.tum")
    poses = driven.poses(start)
    begin = driven.times[0] - driven.intervals[0]
    assert_allclose(read.timestamps, [begin, *driven.times], rtol=0, atol=1e-8)
    assert_allclose(read.positions_xyz, np.column_stack([poses[:, :2], np.zeros(N + 1)]), atol=1e-8)
    for matrix, yaw in zip(read.poses_se3, poses[:, 2], strict=True):
        assert_allclose(matrix[:2, :2], arc([0.0, 0.0, yaw], 1.0)[:2, :2], rtol=0, atol=1e-7)
    assert read.check()[0]


def test_no_path_is_written_of_an_empty_track_or_to_no_file(tmp_path):
    """Breaks if it is told in NumPy's words about indices or `fname`."""
    with pytest.raises(ValueError, match=r"^the track must hold at least one estimate"):
        example()[:0].write_tum(tmp_path / "empty.tum")
    with pytest.raises(ValueError, match=r"^path must be a path, but is 7"):
        example().write_tum(7)
