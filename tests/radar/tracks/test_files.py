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


def test_what_was_cut_off_or_damaged_is_refused(tmp_path):
    """Breaks if half a file loads, a flipped bit changes a velocity, or the error is zipfile's."""
    file = tmp_path / "drive.npz"
    example().save(file)
    whole = file.read_bytes()
    damaged = bytearray(whole)
    damaged[len(damaged) // 3] ^= 16
    lengths = 0, 1, 100, len(whole) // 2, len(whole) - 1
    for content in (bytes(damaged), *(whole[:length] for length in lengths)):
        file.write_bytes(content)
        with pytest.raises(ValueError, match=r"drive\.npz is not a complete file of Track\.save"):
            Track.load(file)


def test_a_field_that_is_missing_or_not_known_is_named(tmp_path):
    """Breaks if a member with a damaged name drops the reasons without a word."""
    example().save(tmp_path / "whole.npz")
    with np.load(tmp_path / "whole.npz") as whole:
        fields = {**whole}
    for gone in ("theta", "covariance"):
        np.savez(tmp_path / "less.npz", **{n: v for n, v in fields.items() if n != gone})
        with pytest.raises(ValueError, match=rf"it lacks \['{gone}'\]"):
            Track.load(tmp_path / "less.npz")
    fields["reasonr"] = fields.pop("reasons")
    np.savez(tmp_path / "other.npz", **fields)
    with pytest.raises(ValueError, match=r"it also holds \['reasonr'\]"):
        Track.load(tmp_path / "other.npz")


def test_foreign_files_are_refused(tmp_path):
    """Breaks if any arrays pass for a track, or Python objects are unpacked."""
    np.savez(tmp_path / "other.npz", times=np.arange(3.0))
    np.save(tmp_path / "array.npy", np.arange(3.0))
    np.save(tmp_path / "objects.npy", np.array([{}], dtype=object), allow_pickle=True)
    (tmp_path / "text.npz").write_text("no archive", encoding="utf-8")
    for name in ("other.npz", "array.npy", "objects.npy", "text.npz"):
        with pytest.raises(ValueError, match=rf"{name} is not a complete file of Track\.save"):
            Track.load(tmp_path / name)
    example().write_tum(tmp_path / "drive.tum")
    with pytest.raises(ValueError, match=r"drive\.tum is not a table of velocities: it lacks time"):
        Track.read_velocities(tmp_path / "drive.tum")
    np.savez(tmp_path / "later.npz", format="d2d.radar.Track 9")
    with pytest.raises(ValueError, match=r"has the format 'd2d\.radar\.Track 9', but this version"):
        Track.load(tmp_path / "later.npz")
    with pytest.raises(FileNotFoundError):
        Track.load(tmp_path / "none.npz")


# ---- nothing half written

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


# ---- tables


def test_a_table_is_read_as_it_was_written(tmp_path):
    """Breaks if a digit is lost, columns change places, or nan or a comma is not read."""

    def symmetric(matrices):
        return np.triu(matrices) + np.swapaxes(np.triu(matrices, 1), 1, 2)

    for known in (False, True):
        driven = example(errors=False, known=known)
        if known:
            reasons = np.where(driven.reasons == "", "", "a speed, or less")
            driven = replace(driven, reasons=reasons)
        driven.write_velocities(tmp_path / "drive.csv")
        expected = replace(driven, covariance=symmetric(driven.covariance))
        assert_same(Track.read_velocities(tmp_path / "drive.csv"), expected)
    driven[:0].write_velocities(tmp_path / "drive.csv")
    assert len(Track.read_velocities(tmp_path / "drive.csv")) == 0


def test_a_table_that_went_through_other_programs_is_read(tmp_path):
    """Breaks if a byte order mark, blank lines, line ends of Windows, another order of columns or
    how pandas writes nan make it another file, or a data frame holds other columns than it says."""
    pandas = pytest.importorskip("pandas")
    file = tmp_path / "drive.csv"
    example().write_velocities(file)
    expected, text = Track.read_velocities(file), file.read_text(encoding="utf-8")
    windows = text.replace("\n", "\r\n")
    frame = example().to_dataframe()
    written = frame[frame.columns[::-1]].to_csv(index=False)
    for changed in (f"\ufeff{text}", f"{text}\n\n", f"\ufeff{windows}\r\n", written):
        file.write_bytes(changed.encode())
        assert_same(Track.read_velocities(file), expected)
    exactly = {"float_precision": "round_trip"} if pandas.__version__.startswith("2.") else {}
    read = pandas.read_csv(file, **exactly)
    assert read["converged"].dtype == bool
    assert_array_equal(frame[["v_x", "v_y", "omega"]], example().theta)
    for name, row, column in (("cov_v_x_omega", 0, 2), ("var_v_y", 1, 1), ("var_omega", 2, 2)):
        assert_array_equal(read[name], example().covariance[:, row, column])
    assert "targets" not in example(known=False).to_dataframe()


def test_a_line_that_cannot_be_read_is_named(tmp_path):
    """Breaks if the user must look for it, or half a line is read."""
    file = tmp_path / "drive.csv"
    example().write_velocities(file)
    lines = file.read_text(encoding="utf-8").splitlines()
    row = lines[10]
    for changed, said in (
        (row + ",1.0", "line 11: there must be 16 values, but are 17"),
        (row[: len(row) // 2], "line 11: there must be 16 values, but are"),
        (row.replace(row.split(",")[3], "fast"), "line 11: could not .* 'fast'"),
        (row.replace(",True,", ",0.5,", 1), "line 11: converged must be True or False, but is 0.5"),
        (row.replace(row.split(",")[2], "nan"), "holds no track: theta must be finite"),
    ):
        file.write_text("\n".join([*lines[:10], changed, *lines[11:]]), encoding="utf-8")
        with pytest.raises(ValueError, match=rf"drive\.csv.* ?{said}"):
            Track.read_velocities(file)


def test_a_tum_file_is_what_evo_reads(tmp_path):
    """Breaks if columns change places, the first pose is lost, or quaternions are not of yaw."""
    file_interface = pytest.importorskip("evo.tools.file_interface")
    driven = example()
    start = (3.0, -2.0, 2.5)
    driven.write_tum(tmp_path / "path.tum", start)
    read = file_interface.read_tum_trajectory_file(tmp_path / "path.tum")
    poses = driven.poses(start)
    assert_allclose(
        read.timestamps,
        np.append(driven.times[0] - driven.intervals[0], driven.times),
        rtol=0,
        atol=1e-8,
    )
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
