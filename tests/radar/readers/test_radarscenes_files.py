"""Damaged RadarScenes files: each is refused by an error that names the file and what is wrong.

Beyond the foreign and truncated files of test_radarscenes.py: every length of a cut file, columns
of every other type, values that no sensor reports, and everything that JSON can hold where a number
or an index is expected.  Bytes are only changed where the tables' rows lie: on damaged bookkeeping
the HDF5 library itself has been seen to write outside its memory.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from d2d.radar import Recording, load_radarscenes
from tests.radar.readers.test_radarscenes import SENSORS, scenes, tables, write_dataset, write_h5

H5 = "data/sequence_7/radar_data.h5"
SCENES = "data/sequence_7/scenes.json"
MOUNTINGS = "data/sensors.json"
TARGETS, ODOMETRY = tables(like_the_original=True)


@pytest.fixture(scope="module")
def root(tmp_path_factory) -> Path:
    """The tiny data set; whoever damages a file writes it whole."""
    return write_dataset(tmp_path_factory.mktemp("files") / "RadarScenes", like_the_original=True)


@pytest.fixture(autouse=True)
def whole(root):
    """All files as they were, before each test."""
    write_h5(root / H5, radar_data=TARGETS, odometry=ODOMETRY)
    (root / SCENES).write_text(json.dumps(scenes()))
    (root / MOUNTINGS).write_text(json.dumps(SENSORS))


def refused(root: Path, file: str) -> str:
    """What the ValueError says, after it named the file."""
    with pytest.raises(ValueError, match=r"\S") as caught:
        load_radarscenes(root, 7, 3)
    said = str(caught.value)
    assert str(root / file) in said, said
    return said.replace(str(root), "")


def accepted(root: Path) -> Recording:
    """What is read, of finite numbers throughout."""
    recording = load_radarscenes(root, 7, 3)
    for scan in recording.scans:
        for name in ("range", "azimuth", "doppler"):
            assert np.isfinite(getattr(scan, name)).all()
        assert (scan.range > 0).all()
    return recording


def test_the_whole_files_are_read(root):
    """Breaks if all that follows is refused for a reason of its own."""
    assert [scan.size for scan in accepted(root).scans] == [3, 0, 4, 1]


# ---- radar_data.h5


def test_a_file_cut_anywhere_is_refused(root):
    """Breaks if h5py's KeyError or OSError gets through at some length, or half of the data."""
    content = (root / H5).read_bytes()
    for length in range(0, len(content), 61):
        (root / H5).write_bytes(content[:length])
        assert "is not a RadarScenes radar file" in refused(root, H5)


def test_an_unreadable_table_is_refused(root):
    """Breaks if a KeyError gets through: h5py raises one for a table whose header is damaged."""
    content = bytearray((root / H5).read_bytes())
    header = content.index(b"range_sc")
    content[header : header + 8] = b"\xff" * 8
    (root / H5).write_bytes(content)
    assert "is not a RadarScenes radar file" in refused(root, H5)


def test_changed_bytes_of_the_rows_are_left_out_or_refused(root):
    """Breaks if damaged numbers end in a warning, a crash or nan: 400 files, three bytes each."""
    content = (root / H5).read_bytes()
    with h5py.File(root / H5) as file:
        places = np.concatenate(
            [
                file[name].id.get_offset() + np.arange(file[name].id.get_storage_size())
                for name in ("radar_data", "odometry")
            ]
        )
    rng = np.random.default_rng(0)
    outcomes = {"read": 0, "refused": 0}
    for _ in range(400):
        damaged = bytearray(content)
        for place in rng.choice(places, 3):
            damaged[place] = rng.integers(256)
        (root / H5).write_bytes(damaged)
        try:
            accepted(root)
        except ValueError as error:
            assert str(root / H5) in str(error)  # noqa: PT017
            outcomes["refused"] += 1
        else:
            outcomes["read"] += 1
    assert min(outcomes.values()) > 20, outcomes


def with_column(table: np.ndarray, name: str, kind: Any) -> np.ndarray:
    """The table with one column of another type, converted where that is possible."""
    layout = [(f, kind if f == name else table.dtype[f]) for f in table.dtype.names]
    changed = np.zeros(len(table), dtype=layout)
    for field in table.dtype.names:
        if field != name:
            changed[field] = table[field]
    return changed


ALL_COLUMNS = [("radar_data", f) for f in TARGETS.dtype.names] + [
    ("odometry", f) for f in ODOMETRY.dtype.names
]
NO_NUMBERS = {"text": "S4", "complex": "c8", "truth": "?", "pairs": ("f4", (2,))}


@pytest.mark.parametrize("kind", NO_NUMBERS.values(), ids=NO_NUMBERS)
@pytest.mark.parametrize(("table", "column"), ALL_COLUMNS, ids=str)
def test_a_column_of_another_type_is_named(root, table, column, kind):
    """Breaks if a wrong dtype ends in NumPy's words about shapes, or is read as numbers."""
    content = {"radar_data": TARGETS, "odometry": ODOMETRY}
    content[table] = with_column(content[table], column, kind)
    write_h5(root / H5, **content)
    assert f"the column {column!r} of the table {table!r}" in refused(root, H5)


@pytest.mark.parametrize("table", ["radar_data", "odometry"])
def test_a_table_of_two_axes_is_refused(root, table):
    """Breaks if rows of rows are taken for scans, or end in an error of np.interp."""
    content = {"radar_data": TARGETS, "odometry": ODOMETRY}
    content[table] = content[table].reshape(1, -1)
    write_h5(root / H5, **content)
    assert f"of the table {table!r} is not a column of numbers" in refused(root, H5)


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("column", ODOMETRY.dtype.names[1:])
def test_odometry_that_is_not_finite_is_refused(root, column, value):
    """Breaks if one nan heading spoils all headings after it, unnoticed."""
    driven = ODOMETRY.copy()
    driven[column][3] = value
    write_h5(root / H5, radar_data=TARGETS, odometry=driven)
    assert f"its odometry's {column!r} holds nan or inf" in refused(root, H5)


@pytest.mark.parametrize("kind", ["i8", "u8", "f8"])
@pytest.mark.parametrize("disorder", ["backwards", "twice"])
def test_odometry_out_of_time_order_is_refused(root, disorder, kind):
    """Breaks if differences of unsigned stamps wrap around and look like progress."""
    driven = with_column(ODOMETRY, "timestamp", kind)
    stamps = ODOMETRY["timestamp"].astype(kind)
    driven["timestamp"] = stamps[::-1] if disorder == "backwards" else np.maximum(stamps, stamps[2])
    write_h5(root / H5, radar_data=TARGETS, odometry=driven)
    assert "not in time order" in refused(root, H5)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("column", ["range_sc", "azimuth_sc", "vr"])
def test_targets_that_are_not_finite_are_left_out(root, column, value):
    """Breaks if one reading that failed ends the drive: the scan's other targets stay."""
    damaged = TARGETS.copy()
    damaged[column][1] = value
    write_h5(root / H5, radar_data=damaged, odometry=ODOMETRY)
    first = accepted(root).scans[0]
    assert_array_equal(first.range, TARGETS["range_sc"][[0, 2]].astype(float))


def test_a_file_without_targets_does_not_fit_its_scans(root):
    """Breaks if slices beyond the end are quietly empty."""
    write_h5(root / H5, radar_data=TARGETS[:0], odometry=ODOMETRY)
    assert "but the file holds 0" in refused(root, H5)


# ---- scenes.json


def test_a_scene_list_cut_anywhere_is_refused(root):
    """Breaks if a JSONDecodeError gets through that does not say of which file."""
    text = json.dumps(scenes())
    for length in range(0, len(text), 17):
        (root / SCENES).write_text(text[:length])
        assert "is not a JSON file" in refused(root, SCENES)


NO_INDICES = [
    [],
    [0],
    ["a", "b"],
    [None, None],
    [float("nan"), 1],
    [float("inf"), 1],
    [[0], [1]],
    {},
    None,
    True,
    3,
]


@pytest.mark.parametrize("indices", NO_INDICES, ids=str)
def test_indices_that_are_none_are_refused(root, indices):
    """Breaks if an OverflowError, IndexError or TypeError gets through."""
    content = scenes()
    content["scenes"]["1000000"]["radar_indices"] = indices
    (root / SCENES).write_text(json.dumps(content))
    assert "is not a RadarScenes scene list" in refused(root, SCENES)


@pytest.mark.parametrize("indices", [[0, 10**30], [-(10**30), 1], [3, 2], [0, 7]], ids=str)
def test_indices_out_of_range_are_refused(root, indices):
    """Breaks if they are cut to fit, or reach into another sensor's scan."""
    content = scenes()
    content["scenes"]["1000000"]["radar_indices"] = indices
    (root / SCENES).write_text(json.dumps(content))
    assert "the scan at 1000000 us" in refused(root, H5)


@pytest.mark.parametrize("key", ["", "early", "1e6", "1.5", "9" * 5000], ids=lambda k: k[:5])
def test_time_stamps_that_are_none_are_refused(root, key):
    """Breaks if a scan without a time is left out, or int()'s words name no file."""
    content = scenes()
    content["scenes"][key] = content["scenes"].pop("1000000")
    (root / SCENES).write_text(json.dumps(content))
    assert "is not a RadarScenes scene list" in refused(root, SCENES)


@pytest.mark.parametrize("key", ["sensor_id", "radar_indices"])
def test_a_missing_key_is_named(root, key):
    """Breaks if a KeyError gets through, or another key's value stands in."""
    content = scenes()
    del content["scenes"]["1000000"][key]
    (root / SCENES).write_text(json.dumps(content))
    assert key in refused(root, SCENES)


UNREADABLE = {
    "binary": b"\xff\xfe\x00scenes",
    "nested": b"[" * 100_000,
    "empty": b"",
    "a-number": b"3",
}


@pytest.mark.parametrize("content", UNREADABLE.values(), ids=UNREADABLE)
@pytest.mark.parametrize("file", [SCENES, MOUNTINGS])
def test_what_is_no_json_object_is_refused(root, file, content):
    """Breaks if a UnicodeDecodeError or RecursionError gets through."""
    (root / file).write_bytes(content)
    refused(root, file)


# ---- sensors.json


@pytest.mark.parametrize("value", [None, "a", [], {}, [1.0], float("nan"), float("inf")], ids=str)
@pytest.mark.parametrize("field", ["x", "y", "yaw"])
def test_a_mounting_that_is_none_is_refused_by_file_and_field(root, field, value):
    """Breaks if the error says 'x must be finite' and leaves the reader to guess of what."""
    content = json.loads(json.dumps(SENSORS))
    content["radar_3"][field] = value
    (root / MOUNTINGS).write_text(json.dumps(content))
    assert field in refused(root, MOUNTINGS)


# ---- arguments


@pytest.mark.parametrize("strongest", [1.5, np.nan, "a", []], ids=str)
def test_a_number_of_targets_that_is_none_is_refused(root, strongest):
    """Breaks if nan keeps everything, or half a target ends in a TypeError of slicing."""
    with pytest.raises(ValueError, match="strongest"):
        load_radarscenes(root, 7, 3, strongest=strongest)
