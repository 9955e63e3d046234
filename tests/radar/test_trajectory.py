"""A track at other times, in files, as a data frame, in words and as a picture."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import zipfile
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib import pyplot as plt
from numpy.testing import assert_allclose, assert_array_equal

from d2d.radar import (
    CovarianceParts,
    Mounting,
    RadarScan,
    Track,
    simulate_drive,
    track,
    track_joint,
)

N = 40


def example(*, parts: bool = True, known: bool = True) -> Track:
    """A track whose numbers have all their digits, with three failures."""
    rng = np.random.default_rng(7)
    intervals = rng.uniform(0.05, 0.15, N)
    converged = np.ones(N, dtype=bool)
    converged[[4, 20, 21]] = False
    root = rng.standard_normal((3, N, 3, 4)) * np.array([0.1, 0.2, 0.02])[:, None]
    covariances = root @ np.swapaxes(root, -1, -2)
    covariances[:, ~converged] = np.nan
    reasons = np.full(N, "", dtype="<U60")
    reasons[4] = "a scan without targets"
    reasons[[20, 21]] = ["a speed of 120.5 m/s", "a speed of 98.0 m/s"]
    track = Track(
        1.6e9 + np.cumsum(intervals),
        intervals,
        rng.uniform([-5.0, -1.0, -1.0], [20.0, 1.0, 1.0], (N, 3)),
        covariances.sum(axis=0),
        converged,
        parts=CovarianceParts(*covariances) if parts else None,
    )
    if not known:
        return track
    inliers = np.where(converged, rng.uniform(size=N), np.nan)
    return replace(track, reasons=reasons, targets=rng.integers(0, 90, N), inliers=inliers)


def all_with(covariance) -> dict[str, np.ndarray]:
    """The change of a track that states one covariance everywhere."""
    return {"covariance": np.broadcast_to(np.asarray(covariance, dtype=float), (N, 3, 3))}


def assert_same(one: Track, other: Track) -> None:
    """Equal in all fields, types and bits, nan included."""
    for field in fields(Track):
        first, second = getattr(one, field.name), getattr(other, field.name)
        if first is None or second is None:
            assert first is second, field.name
            continue
        assert type(first) is type(second)
        pairs = zip(first, second, strict=True) if field.name == "parts" else [(first, second)]
        for mine, theirs in pairs:
            assert mine.dtype == theirs.dtype
            assert mine.shape == theirs.shape
            assert mine.tobytes() == theirs.tobytes(), field.name


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"theta": np.zeros((3, 3))}, r"^theta must have the shape \(40, 3\)"),
        ({"reasons": np.array(["a"])}, r"^reasons must have the shape \(40,\)"),
        ({"parts": CovarianceParts(*np.zeros((3, 2, 3, 3)))}, r"^parts.noise must have the shape"),
        ({"times": np.zeros(N)}, r"^times must be finite and strictly increasing"),
        ({"times": np.append(np.arange(N - 1.0), np.nan)}, r"^times must be finite"),
        ({"intervals": np.full(N, 50.0)}, r"^intervals must add up to the diff"),
        ({"converged": np.ones(N, dtype=bool)}, r"^covariance must be finite wherever converged"),
        ({"theta": np.full((N, 3), np.nan)}, r"^theta must be finite wherever converged"),
        ({"targets": np.full(N, -5)}, r"^targets must not be negative"),
        ({"inliers": np.full(N, 57.0)}, r"^inliers must lie within \[0, 1\]"),
        (all_with(np.eye(3)), r"^parts must add up to covariance"),
        (all_with([[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), "^covariance must be sym"),
        (all_with(-np.eye(3)), "^covariance must have variances that are not negative"),
        (all_with([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), "^covariance must have"),
    ],
    ids=[
        *["rows", "reasons", "parts", "order", "nan-time", "milliseconds"],
        *["nan-covariance", "nan-velocity", "targets", "percent", "parts-of-another"],
        *["one-sided", "negative", "correlated"],
    ],
)
def test_what_is_no_track_is_refused(changed, said):
    """Breaks if times out of order are interpolated, or nan passes for an estimate."""
    with pytest.raises(ValueError, match=said):
        replace(example(), **changed)


def test_a_table_that_holds_no_track_is_named(tmp_path):
    """Breaks if a nan in an accepted row is read as a velocity."""
    path = tmp_path / "velocities.txt"
    example().write_velocities(path)
    lines = path.read_text().splitlines()
    words = lines[5].split()
    words[2] = "nan"
    path.write_text("\n".join([*lines[:5], " ".join(words), *lines[6:]]))
    with pytest.raises(ValueError, match=f"^{path} holds no track: theta must be finite"):
        Track.read_velocities(path)


def test_an_empty_track_is_refused_where_an_estimate_is_needed(tmp_path):
    """Breaks if it is told in NumPy's words about indices."""
    driven = Track(*np.zeros((2, 0)), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0, bool))
    for call in (lambda: driven.at([1.0]), lambda: driven.write_tum(tmp_path / "empty.tum")):
        with pytest.raises(ValueError, match=r"^the track must hold at least one estimate"):
            call()


def test_intervals_fit_the_times_to_within_the_rounding_of_stamps():
    """Breaks if a path is driven for longer than it took, or a log with rounded times refused."""
    driven = example()
    rounded = replace(driven, times=driven.times.round(3))  # to milliseconds
    assert_array_equal(rounded.poses(), driven.poses())
    kept = np.delete(np.arange(N), 7)
    names = [field.name for field in fields(Track) if field.name != "parts"]
    rows = {name: getattr(driven, name)[kept] for name in names}
    with pytest.raises(ValueError, match=r"^intervals must add up .* to number 7 they"):
        Track(**rows)
    rows["intervals"] = np.append(driven.intervals[0], np.diff(rows["times"]))
    assert Track(**rows).poses().shape == (N, 3)


# ---- At other times


def test_at_the_times_of_its_estimates_a_track_gives_them():
    """Breaks if a neighbour has a say at the time itself, or a failed estimate passes for one."""
    driven = example()
    found = driven.at(driven.times)
    good = driven.converged
    assert_array_equal(found.theta[good], driven.theta[good])
    assert_array_equal(found.covariance[good], driven.covariance[good])
    assert np.isnan(found.theta[~good]).all()
    assert np.isnan(found.covariance[~good]).all()


def test_between_two_estimates_a_track_is_linear():
    """Breaks if weights are exchanged, or one direction gets those of another."""
    driven = replace(example(), times=0.1 * np.arange(N), intervals=np.full(N, 0.1))
    i = np.array([0, 7, 30])
    for share in (0.25, 0.5, 0.9):
        found = driven.at(driven.times[i] + share * np.diff(driven.times)[i])
        theta = (1.0 - share) * driven.theta[i] + share * driven.theta[i + 1]
        assert_allclose(found.theta, theta, rtol=1e-9)
        sigma = (1.0 - share) * driven.covariance[i] + share * driven.covariance[i + 1]
        assert_allclose(found.covariance, sigma, rtol=1e-9)


def test_the_covariance_between_is_a_bound_whatever_the_correlation():
    """Breaks if the two errors are taken as independent, which says too little if they are not."""
    driven = example()
    weight = 0.3
    found = driven.at(driven.times[10:11] + weight * np.diff(driven.times)[10])
    one, two = (np.linalg.cholesky(driven.covariance[i]) for i in (10, 11))
    for sign in (-1.0, 0.0, 1.0):
        mixed = np.hstack([(1.0 - weight) * one, weight * two])
        both = np.block([[np.eye(3), sign * np.eye(3)], [sign * np.eye(3), np.eye(3)]])
        rest = found.covariance[0] - mixed @ both @ mixed.T
        assert np.linalg.eigvalsh(rest).min() > -1e-6


def test_outside_next_to_failures_and_in_gaps_nothing_is_known():
    """Breaks if a velocity is invented where there was none."""
    driven = example()
    step = driven.times[:-1] + 0.5 * np.diff(driven.times)
    theta = driven.at([driven.times[0] - 1e-3, *step, driven.times[-1] + 1e-3]).theta
    unknown = np.isnan(theta[1:-1]).all(axis=1)
    assert_array_equal(np.flatnonzero(unknown), [3, 4, 19, 20, 21])
    assert np.isnan(theta[[0, -1]]).all()
    later = replace(
        driven,
        times=driven.times + 10.0 * (np.arange(N) >= 30),
        intervals=driven.intervals + 10.0 * (np.arange(N) == 30),
    )
    assert np.isnan(later.at([later.times[29] + 5.0]).theta).all()


@pytest.mark.parametrize("times", [1.0, [[1.0]], [np.nan], "now"], ids=repr)
def test_wrong_times_are_refused(times):
    with pytest.raises(ValueError, match=r"^times must"):
        example().at(times)


# ---- npz


@pytest.mark.parametrize("parts", [False, True])
@pytest.mark.parametrize("known", [False, True])
def test_a_saved_track_loads_bit_by_bit(tmp_path, parts, known):
    """Breaks if a field is lost, a type changes or None becomes an array."""
    driven = example(parts=parts, known=known)
    driven.save(tmp_path / "drive.npz")
    assert_same(Track.load(tmp_path / "drive.npz"), driven)
    assert os.listdir(tmp_path) == ["drive.npz"]


def test_a_file_gets_the_name_that_was_asked_for(tmp_path, monkeypatch):
    """Breaks if NumPy adds its suffix, or a tilde is a folder's name."""
    monkeypatch.setenv("HOME", str(tmp_path))
    example().save("~/drive.track")
    assert os.listdir(tmp_path) == ["drive.track"]
    assert_same(Track.load("~/drive.track"), example())


def test_what_was_cut_off_is_refused(tmp_path):
    """Breaks if half a file loads, or the error is zipfile's own."""
    file = tmp_path / "drive.npz"
    example().save(file)
    whole = file.read_bytes()
    for length in (0, 1, 100, len(whole) // 2, len(whole) - 1):
        file.write_bytes(whole[:length])
        with pytest.raises(ValueError, match=r"drive\.npz is not a complete file of Track\.save"):
            Track.load(file)


def test_damage_within_is_noticed(tmp_path):
    """Breaks if a flipped bit changes a velocity and nobody is told."""
    file = tmp_path / "drive.npz"
    example().save(file)
    damaged = bytearray(file.read_bytes())
    damaged[len(damaged) // 3] ^= 16
    file.write_bytes(bytes(damaged))
    with pytest.raises(ValueError, match=r"not a complete file"):
        Track.load(file)


def test_a_field_that_is_missing_is_named(tmp_path):
    """Breaks if a part is taken for all."""
    example().save(tmp_path / "whole.npz")
    for gone in ("theta", "parts_systematic"):
        with (
            zipfile.ZipFile(tmp_path / "whole.npz") as source,
            zipfile.ZipFile(tmp_path / "less.npz", "w") as target,
        ):
            for name in source.namelist():
                if name != f"{gone}.npy":
                    target.writestr(name, source.read(name))
        with pytest.raises(ValueError, match=rf"it lacks \['{gone}'\]"):
            Track.load(tmp_path / "less.npz")


def test_foreign_files_are_refused(tmp_path):
    """Breaks if any arrays pass for a track, or Python objects are unpacked."""
    np.savez(tmp_path / "other.npz", times=np.arange(3.0))
    np.save(tmp_path / "array.npy", np.arange(3.0))
    np.save(tmp_path / "objects.npy", np.array([{}], dtype=object), allow_pickle=True)
    (tmp_path / "text.npz").write_text("no archive", encoding="utf-8")
    for name in ("other.npz", "array.npy", "objects.npy", "text.npz"):
        with pytest.raises(ValueError, match=rf"{name} is not a complete file of Track\.save"):
            Track.load(tmp_path / name)
    np.savez(tmp_path / "later.npz", format="d2d.radar.Track 9")
    with pytest.raises(ValueError, match=r"has the format 'd2d\.radar\.Track 9', but this version"):
        Track.load(tmp_path / "later.npz")
    with pytest.raises(FileNotFoundError):
        Track.load(tmp_path / "none.npz")


# ---- Nothing half written

WRITERS = {
    "save": lambda driven, path: driven.save(path),
    "write_tum": lambda driven, path: driven.write_tum(path),
    "write_velocities": lambda driven, path: driven.write_velocities(path),
}
each_writer = pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS.keys())


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
    """Breaks if others may not read it, as of temporary files, or a link is replaced."""
    (tmp_path / "plain").touch()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    write(example(), tmp_path / "link")
    assert (tmp_path / "link").is_symlink()
    rights = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("plain", "real")]
    assert rights[0] == rights[1]


@each_writer
def test_a_folder_that_is_not_there_is_named(tmp_path, write):
    """Breaks if the error names a temporary file that nobody has heard of."""
    with pytest.raises(FileNotFoundError, match=r"nowhere does not exist"):
        write(example(), tmp_path / "nowhere" / "drive")


def test_a_device_is_written_to_and_not_replaced():
    """Breaks if /dev/null becomes a file."""
    if not Path("/dev/null").is_char_device():
        pytest.skip("this system has no /dev/null")
    example().write_velocities("/dev/null")
    assert Path("/dev/null").is_char_device()


# ---- Velocities as text


def test_velocities_are_read_as_they_were_written(tmp_path):
    """Breaks if a digit is lost, columns change places or nan is not read."""
    driven = example()
    driven.write_velocities(tmp_path / "drive.txt")
    left_out = {"reasons": None, "targets": None, "inliers": None, "parts": None}
    symmetric = np.triu(driven.covariance) + np.swapaxes(np.triu(driven.covariance, 1), 1, 2)
    assert_same(
        Track.read_velocities(tmp_path / "drive.txt"),
        replace(driven, covariance=symmetric, **left_out),
    )


def test_the_header_names_columns_and_units_and_numpy_reads_the_rest(tmp_path):
    """Breaks if other programs need this one to read the table."""
    driven = example()
    driven.write_velocities(tmp_path / "drive.txt")
    lines = (tmp_path / "drive.txt").read_text(encoding="utf-8").splitlines()
    names = [line for line in lines if line.startswith("#")][-2].lstrip("# ").split()
    assert names[:5] == ["time[s]", "interval[s]", "v_x[m/s]", "v_y[m/s]", "omega[rad/s]"]
    table = np.loadtxt(tmp_path / "drive.txt")
    assert table.shape == (N, len(names)) == (N, 12)
    assert_array_equal(table[:, names.index("omega[rad/s]")], driven.theta[:, 2])
    assert_array_equal(table[:, names.index("var_v_y[m^2/s^2]")], driven.covariance[:, 1, 1])
    cross = driven.covariance[:, 0, 2]
    assert_array_equal(table[:, names.index("cov_v_x_omega[m*rad/s^2]")], cross)
    assert_array_equal(table[:, names.index("converged[0/1]")], driven.converged)


def test_a_table_that_was_cut_off_is_refused_wherever_that_was(tmp_path):
    """Breaks if a shorter drive, or half a number, is read without a word."""
    file = tmp_path / "drive.txt"
    example().write_velocities(file)
    whole = file.read_bytes()
    for length in (*range(0, len(whole) - 1, 37), len(whole) - 2):
        file.write_bytes(whole[:length])
        with pytest.raises(ValueError, match=r"drive\.txt"):
            Track.read_velocities(file)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda row: row + " 1.0", "line 8: there must be 12 numbers, but are 13"),
        (lambda row: row.replace(row.split()[3], "fast"), "line 8: could not .* 'fast'"),
        (
            lambda row: row.replace(" 1 ", " 0.5 ", 1),
            "line 8: converged must be 0 or 1, but is 0.5",
        ),
        (lambda row: "", "is not complete: its last line must be '# end of 39 estimates'"),
    ],
    ids=["too-many", "word", "half", "none"],
)
def test_a_row_that_cannot_be_read_is_named(tmp_path, change, said):
    file = tmp_path / "drive.txt"
    example().write_velocities(file)
    lines = file.read_text(encoding="utf-8").splitlines()
    lines[7] = change(lines[7])
    file.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(ValueError, match=rf"drive\.txt.* ?{said}"):
        Track.read_velocities(file)


def test_a_tum_file_is_no_table_of_velocities(tmp_path):
    example().write_tum(tmp_path / "drive.tum")
    with pytest.raises(ValueError, match=r"drive\.tum is not a table of velocities: line 1"):
        Track.read_velocities(tmp_path / "drive.tum")


# ---- pandas


def test_a_data_frame_holds_the_track_and_survives_a_file(tmp_path):
    """Breaks if rows and columns are exchanged or an unknown field becomes a column."""
    pandas = pytest.importorskip("pandas")
    driven = example()
    frame = driven.to_dataframe()
    assert len(frame) == N
    assert_array_equal(frame[["v_x", "v_y", "omega"]], driven.theta)
    frame.to_csv(tmp_path / "drive.csv", index=False)
    # pandas 2 reads numbers exactly only if asked to; later versions warn if they are asked
    exactly = {"float_precision": "round_trip"} if pandas.__version__.startswith("2.") else {}
    again = pandas.read_csv(tmp_path / "drive.csv", **exactly)
    for name in ("time", "interval", "cov_v_y_omega", "converged", "targets", "inliers"):
        assert again[name].dtype == frame[name].dtype
        assert_allclose(again[name], frame[name], rtol=1e-15)
    assert_array_equal(again["reasons"].fillna(""), driven.reasons)
    assert_array_equal(frame["cov_v_y_omega"], driven.covariance[:, 1, 2])
    assert_array_equal(frame["targets"], driven.targets)
    assert "targets" not in example(known=False).to_dataframe()


def test_without_pandas_it_is_asked_for(monkeypatch):
    """Breaks if the user is told about an import that somebody else wrote."""
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(
        ModuleNotFoundError, match=r"^to_dataframe needs pandas.*pip install pandas"
    ):
        example().to_dataframe()


# ---- Words and picture


def test_a_track_in_a_few_words():
    """Breaks if arrays fill the screen, or reasons that differ in a number count one by one."""
    driven = replace(example(), times=1.0 + np.arange(N) / 10.0, intervals=np.full(N, 0.1))
    assert repr(driven) == "Track(40 estimates from 1.000 s to 4.900 s, 92.5% converged)"
    assert str(driven).splitlines() == [
        repr(driven),
        "  2 failed: a speed of ... m/s",
        "  1 failed: a scan without targets",
    ]
    assert str(example(known=False)) == repr(example(known=False))


def test_rare_reasons_are_counted_together():
    """Breaks if failures are left out, or a unit's exponent is taken for a number."""
    driven = example()
    reasons = driven.reasons.copy()
    reasons[:9] = 3 * ["an acceleration of 31.5 m/s^2 along x"] + 2 * ["a"] + ["b", "b", "c", "d"]
    words = str(replace(driven, reasons=reasons)).splitlines()
    assert words[1] == "  3 failed: an acceleration of ... m/s^2 along x"
    assert words[-1] == "  4 failed otherwise"
    assert sum(int(line.split()[0]) for line in words[1:]) == 11


def test_slips_to_either_side_are_counted_together():
    """Breaks if the sign of a number makes two reasons of one."""
    driven = example()
    reasons = np.array(["a side slip of -1.20 m/s", "a side slip of 0.90 m/s", *(N - 2) * [""]])
    words = str(replace(driven, reasons=reasons)).splitlines()
    assert words[1:] == ["  2 failed: a side slip of ... m/s"]


@pytest.mark.parametrize("known", [False, True])
def test_the_picture_shows_velocities_bands_and_failures(known):
    """Breaks if an axis lacks its unit, a failed estimate is drawn, or the band is one sigma."""
    driven = example(known=known)
    figure = driven.plot()
    path, *axes = figure.axes
    labels = ["$v_x$ (m/s)", "$v_y$ (m/s)", "$ω$ (deg/s)", *["inlier share"] * known]
    assert [ax.get_ylabel() for ax in axes] == labels
    assert (path.get_xlabel(), axes[-1].get_xlabel()) == ("x (m)", "time (s)")
    assert_array_equal(path.lines[0].get_xydata(), driven.poses()[:, :2])
    line = axes[2].lines[0]
    assert_allclose(
        line.get_ydata(), np.where(driven.converged, np.rad2deg(driven.theta[:, 2]), np.nan)
    )
    band = axes[0].collections[0].get_paths()[0].vertices
    top = driven.theta[0, 0] + 3.0 * np.sqrt(driven.covariance[0, 0, 0])
    assert band[band[:, 0] == driven.times[0], 1].max() == pytest.approx(top)
    for ax in axes:
        assert_array_equal(ax.lines[-1].get_xdata(), driven.times[~driven.converged])
    plt.close(figure)


# ---- Progress

DRIVE = simulate_drive(np.random.default_rng(0), duration=0.4)
TRACKERS = {
    "track": lambda progress: track(DRIVE.scans, DRIVE.mounting, progress=progress),
    "track_joint": lambda progress: track_joint([(DRIVE.scans, DRIVE.mounting)], progress=progress),
}
each_tracker = pytest.mark.parametrize("driven_by", TRACKERS.values(), ids=TRACKERS.keys())


@each_tracker
def test_a_bar_is_shown_only_if_wanted(driven_by, capsys):
    """Breaks if tests and notebooks fill with bars, or the bar counts something else."""
    for silent in (None, False):
        driven_by(silent)
        assert capsys.readouterr() == ("", "")
    shown = driven_by(True)
    said = capsys.readouterr()
    assert said.out == ""
    assert "4/4" in said.err
    assert_same(shown, driven_by(False))


@each_tracker
def test_progress_is_a_flag(driven_by):
    with pytest.raises(ValueError, match=r"^progress must be True or False, but is 'bar'"):
        driven_by("bar")


def test_without_tqdm_only_a_bar_that_was_asked_for_is_missed():
    """Breaks if a track on a terminal needs what the package does not."""
    program = """
import sys
sys.modules["tqdm"] = None
from d2d.radar import progress
progress._on_terminal = lambda: True
print(list(progress.counted(3, None)))
try:
    progress.counted(3, True)
except ModuleNotFoundError as error:
    print(error)
"""
    done = subprocess.run(
        [sys.executable, "-c", program], check=True, capture_output=True, text=True
    )
    assert done.stdout.splitlines() == [
        "[0, 1, 2]",
        "progress=True needs tqdm, which is not installed: pip install tqdm",
    ]


def test_a_track_keeps_its_own_arrays():
    """Breaks if a later change of an argument, or of the track, changes what was estimated."""
    given = example(parts=True)
    values = {field.name: getattr(given, field.name) for field in fields(Track)}
    mine = {n: v.copy() for n, v in values.items() if isinstance(v, np.ndarray)}
    driven = Track(**(values | mine))
    mine["theta"][:] = 7.0
    assert_array_equal(driven.theta, given.theta)
    for array in (driven.theta, driven.times, driven.reasons, *driven.parts):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = array[1]
    listed = {n: v.tolist() if n != "covariance" else v for n, v in mine.items()}
    assert_array_equal(replace(given, **(listed | {"theta": given.theta})).times, given.times)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("theta", lambda v: v * 1j),
        ("theta", lambda v: np.ma.array(v, mask=v > 10.0)),
        ("theta", lambda v: np.where(v > 10.0, None, v)),
        ("times", lambda v: v[::-1].astype(np.uint64)),
        ("times", lambda v: "now"),
        ("converged", lambda v: v.astype(float)),
        ("converged", lambda v: np.ma.array(v, mask=~v)),
        ("reasons", lambda v: v.astype(object)),
        ("targets", lambda v: v + 0.5),
        ("parts", lambda _: "noise"),
    ],
)
def test_what_no_track_holds_is_refused(name, change):
    """Breaks if numbers of another kind are stored, and surprise whoever computes with them."""
    driven = example()
    with pytest.raises(ValueError, match=f"^{name} must"):
        replace(driven, **{name: change(getattr(driven, name))})


def test_an_indefinite_covariance_is_refused():
    """Breaks if only pairs of components are looked at."""
    with pytest.raises(ValueError, match=r"^covariance must be positive semidefinite"):
        replace(example(), **all_with([[1.0, 0.9, 0.9], [0.9, 1.0, -0.9], [0.9, -0.9, 1.0]]))


def test_scans_that_repeat_an_earlier_one_are_not_believed():
    """Breaks if a frozen sensor, or a message that comes twice, gives a velocity."""
    drive = simulate_drive(np.random.default_rng(3), duration=1.5)
    scans = list(drive.scans)
    scans[7] = replace(scans[6], time=scans[7].time)
    reasons = track(scans, drive.mounting).reasons
    assert np.flatnonzero(reasons == "a scan that repeats an earlier one").tolist() == [6]
    frozen = [replace(scans[0], time=scan.time) for scan in scans]
    assert not track(frozen, drive.mounting).converged.any()
    other = simulate_drive(np.random.default_rng(4), duration=1.5)
    together = [(other.scans, other.mounting), (frozen, Mounting(x=1.0))]
    assert not track_joint(together).converged.any()


def test_a_sensor_at_a_standstill_may_measure_the_same_twice():
    """Breaks if a coarse radar loses its estimates where nothing moves."""
    drive = simulate_drive(np.random.default_rng(3), duration=0.5)
    first = drive.scans[0]
    still = [
        RadarScan(0.1 * i, first.range, first.azimuth, 0.0 * first.doppler, 0.15, 0.01, 0.06)
        for i in range(4)
    ]
    found = track(still, drive.mounting)
    assert found.converged.all()
    assert_allclose(found.theta, 0.0, atol=1e-4)
