"""The RadarScenes reader, on a tiny data set of the same layout and on the real one.

The tiny one has two sensors that do not run in step, an empty scan, and targets that must be left
out.  It is damaged in many ways: each is refused by an error that names the file and what is wrong.
Bytes are only changed where the tables' rows lie: on damaged bookkeeping the HDF5 library itself
has been seen to write outside its memory.  Where the real one is present, the reader is checked
against the data's own columns.
"""

import json
import re
from itertools import product
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.lib.recfunctions import repack_fields
from numpy.testing import assert_allclose, assert_array_equal

from d2d.radar import Mounting, SlipLaw, compare, doppler_velocity, load_radarscenes, track
from d2d.radar.readers.radarscenes import azimuth_sigma
from d2d.radar.scans.scan import doppler_gradients

SENSORS = {
    "radar_1": {"id": 1, "x": 3.663, "y": -0.873, "yaw": -1.484},
    "radar_3": {"yaw": 0.436, "x": 3.86, "id": 3, "y": 0.7},
    "radar_4": {"id": 4, "x": 3.663, "y": 0.873, "yaw": 1.484},
}
# time stamp (us), sensor, targets: (range, azimuth, rcs, vr)
SCANS = [
    (1_000_000, 3, [(10.0, 0.1, 5.0, -9.0), (20.5, -0.2, -3.0, -8.0), (31.25, 0.3, 7.5, 0.5)]),
    (1_013_000, 1, [(5.0, 0.0, 1.0, 2.0), (6.0, 0.9, 2.0, 3.0)]),
    (1_075_000, 3, []),
    (1_089_000, 1, [(7.0, -0.9, 1.0, 4.0)]),
    (
        1_150_000,
        3,
        [
            (12.0, 0.25, -9.0, -7.0),
            (0.0, 0.1, 30.0, -7.0),  # at no distance
            (13.0, 0.8, 12.0, -6.5),
            (np.nan, 0.1, 30.0, -7.0),
            (14.0, 1.0, 2.0, -6.0),
            (15.0, np.inf, 30.0, -6.0),
            (16.0, -0.8, 11.0, -5.5),
            (17.0, 0.1, 30.0, -np.inf),
        ],
    ),
    (1_226_000, 3, [(18.0, 0.0, 0.0, -5.0)]),
]
ODOMETRY_START, ODOMETRY_STEP = 800_000, 25_000
H5 = "data/sequence_7/radar_data.h5"
SCENES = "data/sequence_7/scenes.json"
MOUNTINGS = "data/sensors.json"


def odometry(time: np.ndarray) -> dict[str, np.ndarray]:
    """Linear in time (s), so that interpolation is exact; yaw goes through +pi."""
    return {
        "x_seq": 100.0 + 20.0 * time,
        "y_seq": -3.0 * time,
        "yaw_seq": (2.95 + 0.2 * time + np.pi) % (2 * np.pi) - np.pi,
        "vx": 10.0 + 2.0 * time,
        "yaw_rate": 0.1 - 0.3 * time,
    }


ORIGINAL = (
    "timestamp:i8 sensor_id:u1 range_sc:f4 azimuth_sc:f4 rcs:f4 vr:f4",
    "timestamp:i8 x_seq:f4 y_seq:f4 yaw_seq:f4 vx:f4 yaw_rate:f4",
)
OTHER = (
    "uuid:S8 vr:f8 rcs:f4 x_cc:f4 azimuth_sc:f8 vr_compensated:f8 label_id:i2 sensor_id:i8 "
    "range_sc:f8 track_id:S4 timestamp:u8",
    "yaw_rate:f8 vy:f4 vx:f8 yaw_seq:f8 timestamp:u8 y_seq:f8 x_seq:f8",
)


def tables(like_the_original: bool) -> tuple[np.ndarray, np.ndarray]:
    """The targets and the odometry, in the columns of the original files or quite others."""
    rows = [(t, s, *target) for t, s, targets in SCANS for target in targets]
    names = ("timestamp", "sensor_id", "range_sc", "azimuth_sc", "rcs", "vr")
    columns = dict(zip(names, map(np.array, zip(*rows, strict=True)), strict=True))
    stamps = ODOMETRY_START + ODOMETRY_STEP * np.arange(15)
    driven = {"timestamp": stamps, **odometry(stamps * 1e-6)}
    found = []
    for layout, content in zip(
        ORIGINAL if like_the_original else OTHER, (columns, driven), strict=True
    ):
        fields = [tuple(field.split(":")) for field in layout.split()]
        table = np.zeros(len(content["timestamp"]), dtype=fields)
        for name, kind in fields:
            if name in content:
                table[name] = content[name]
            elif kind[0] == "f":
                table[name] = 777.0  # must not be read
        found.append(table)
    return found[0], found[1]


def scenes() -> dict[str, Any]:
    """scenes.json; the order of its keys is not that of time."""
    found, first = {}, 0
    for stamp, sensor, targets in SCANS:
        indices = [first, first + len(targets)]
        first = indices[1]
        found[str(stamp)] = {"sensor_id": sensor, "radar_indices": indices, "odometry_index": 0}
    return {"sequence_name": "sequence_7", "scenes": dict(reversed(found.items()))}


def write_h5(path: Path, **contents: Any) -> None:
    """An HDF5 file of these tables."""
    with h5py.File(path, "w") as file:
        for name, content in contents.items():
            file.create_dataset(name, data=content)


def write_dataset(root: Path, like_the_original: bool = False) -> Path:
    """The tiny data set, sequence 7."""
    folder = root / "data" / "sequence_7"
    folder.mkdir(parents=True)
    targets, driven = tables(like_the_original)
    write_h5(folder / "radar_data.h5", radar_data=targets, odometry=driven)
    (folder / "scenes.json").write_text(json.dumps(scenes()))
    (root / "data" / "sensors.json").write_text(json.dumps(SENSORS))
    return root


@pytest.fixture
def root(tmp_path) -> Path:
    """The tiny data set with other columns than the original files."""
    return write_dataset(tmp_path / "RadarScenes")


def test_scans_of_each_sensor_in_time_order(tmp_path):
    """Breaks if columns are read by position, indices are closed, sensors get mixed up, or a zero
    range or nan ends the reading or takes good targets with it."""
    for like_the_original in (True, False):
        root = write_dataset(tmp_path / str(like_the_original), like_the_original)
        third, first = (load_radarscenes(root, 7, sensor) for sensor in (3, 1))
        assert [scan.size for scan in third.scans] == [3, 0, 4, 1]
        times = [scan.time for scan in third.scans]
        assert_allclose(times, [1.0, 1.075, 1.15, 1.226], rtol=0, atol=1e-12)
        assert_allclose(third.scans[3].range, [18.0])
        for scan, *expected in (
            (third.scans[0], [10.0, 20.5, 31.25], [0.1, -0.2, 0.3], [-9.0, -8.0, 0.5]),
            (third.scans[2], [12, 13, 14, 16], [0.25, 0.8, 1.0, -0.8], [-7.0, -6.5, -6.0, -5.5]),
        ):
            assert_allclose([scan.range, scan.azimuth, scan.doppler], expected, rtol=1e-7)
        assert [scan.size for scan in first.scans] == [2, 1]
        assert first.mounting == Mounting(3.663, -0.873, -1.484)
        assert third.mounting == Mounting(3.86, 0.7, 0.436)


def test_a_sequence_may_be_a_number_or_a_name(root, monkeypatch):
    """Breaks if a number that comes from an array is taken for a folder's name, or ~ for one."""
    for sequence in (7, "7", "sequence_7", np.int64(7)):
        assert len(load_radarscenes(str(root), sequence, 3).scans) == 4
    monkeypatch.setenv("HOME", str(root.parent))
    assert len(load_radarscenes(f"~/{root.name}", 7, 3).scans) == 4


def test_the_strongest_targets_are_kept_in_their_order(root):
    """Breaks if the weakest are kept, targets that are left out count, or azimuths are permuted."""
    angles = {12.0: 0.25, 13.0: 0.8, 14.0: 1.0, 16.0: -0.8}
    for strongest, expected in (
        (1, [13.0]),
        (2, [13.0, 16.0]),
        (3, [13.0, 14.0, 16.0]),
        (48, [12.0, 13.0, 14.0, 16.0]),
    ):
        scan = load_radarscenes(root, 7, 3, strongest=strongest).scans[2]
        assert_allclose(scan.range, expected)
        assert_allclose(scan.azimuth, [angles[r] for r in expected])


def test_sigmas_are_those_measured_on_the_data_or_given(root):
    """Breaks if degrees are taken for radians, the azimuth's sigma is not even or does not grow
    off boresight, an option is not handed on, or a function does not see the kept azimuths."""
    azimuth = np.deg2rad([0.0, 44.9, 45.1, 52.5, 60.0, 80.0])
    assert_allclose(np.rad2deg(azimuth_sigma(azimuth)), [0.3, 0.3, 0.5, 0.75, 1.0, 1.0], atol=5e-3)
    assert_array_equal(azimuth_sigma(azimuth), azimuth_sigma(-azimuth))
    scan = load_radarscenes(root, 7, 3).scans[2]
    assert_array_equal(scan.sigma_azimuth, azimuth_sigma(scan.azimuth))
    options = {"sigma_range": 0.3, "sigma_doppler": 0.1, "strongest": 2}
    given = {"sigma_azimuth": lambda azimuth: 0.01 + 0.01 * np.abs(azimuth)}
    scan = load_radarscenes(root, 7, 3, **given, **options).scans[2]
    assert_array_equal(scan.sigma_range, 0.3)
    assert_array_equal(scan.sigma_doppler, 0.1)
    assert_allclose(scan.sigma_azimuth, 0.01 + 0.01 * np.abs(scan.azimuth))


def test_reference_is_the_odometry_at_the_offset_time(root):
    """Breaks if the offset has the other sign, yaw jumps at pi, v_y is not slip v_x omega, or the
    first or last value is held outside, which looks like a vehicle at constant speed."""
    last = (ODOMETRY_START + 14 * ODOMETRY_STEP) * 1e-6
    for offset, slip in product((0.3, 0.11, 0.0, -0.02), (-0.05, 0.0)):
        reference = load_radarscenes(root, 7, 3, time_offset=offset, side_slip=slip).reference
        assert_allclose(reference.times, [1.0, 1.075, 1.15, 1.226], atol=1e-12)
        past = reference.times - offset
        inside = (past >= ODOMETRY_START * 1e-6) & (past <= last)
        assert 2 <= inside.sum() < 4 or offset in (0.11, 0.0)
        assert_array_equal(np.isfinite(reference.theta).all(axis=1), inside)
        assert_array_equal(np.isfinite(reference.poses).all(axis=1), inside)
        then = odometry(past[inside])
        v_y = slip * then["vx"] * then["yaw_rate"]
        theta = np.column_stack([then["vx"], v_y, then["yaw_rate"]])
        yaw = 2.95 + 0.2 * past[inside]
        poses = np.column_stack([then["x_seq"], then["y_seq"], yaw])
        # v_y: omega and v_x are interpolated, not their product
        assert_allclose(reference.theta[inside], theta, rtol=0, atol=1e-9)
        assert_allclose(reference.poses[inside], poses, rtol=0, atol=1e-9)


def test_the_axle_slips_by_a_law_or_in_proportion(root):
    """Breaks if the law is not that of the lateral acceleration, or both slips add up."""
    law = SlipLaw(ahead=0.3, compliance=0.006)
    for options, lever in (({}, lambda v: 0.3 - 0.006 * v**2), ({"side_slip": -0.05}, None)):
        theta = load_radarscenes(root, 7, 3, slip=law, **options).reference.theta
        v_x, v_y, omega = theta[np.isfinite(theta).all(axis=1)].T
        assert_allclose(v_y, (lever(v_x) if lever else -0.05 * v_x) * omega, rtol=1e-12)


def test_a_sequence_or_a_sensor_that_is_not_there_is_named(root):
    """Breaks if another is read, or a recording without scans is returned."""
    for sequence in (8, "sequence_8", "7" * 1000):
        with pytest.raises(FileNotFoundError, match=r"not exist; it should be the folder of that"):
            load_radarscenes(root, sequence, 3)
    with pytest.raises(
        ValueError, match=r"sensors\.json .*of radar_2: it has only radar_1, radar_3"
    ):
        load_radarscenes(root, 7, 2)
    with pytest.raises(ValueError, match=r"scenes\.json has no scan of sensor 4"):
        load_radarscenes(root, 7, 4)


TARGETS, ODOMETRY = tables(like_the_original=True)


def refused(root: Path, file: str) -> str:
    """What the ValueError says, after it named the file."""
    with pytest.raises(ValueError, match=re.escape(str(root / file))) as caught:
        load_radarscenes(root, 7, 3)
    return str(caught.value).replace(str(root), "")


def with_column(table: np.ndarray, name: str, kind: Any) -> np.ndarray:
    """The table with one column of another type, converted where that is possible."""
    layout = [(f, kind if f == name else table.dtype[f]) for f in table.dtype.names]
    changed = np.zeros(len(table), dtype=layout)
    for field in table.dtype.names:
        if field != name:
            changed[field] = table[field]
    return changed


def test_a_file_cut_anywhere_is_refused(root):
    """Breaks if h5py's KeyError or OSError gets through at some length, or half of the data."""
    for file, step, what in ((H5, 251, "radar file"), (SCENES, 61, "scene list")):
        content = (root / file).read_bytes()
        for length in range(0, len(content), step):
            (root / file).write_bytes(content[:length])
            assert f"is not a RadarScenes {what}" in refused(root, file)
        (root / file).write_bytes(content)
    damaged = bytearray((root / H5).read_bytes())
    header = damaged.index(b"range_sc")
    damaged[header : header + 8] = b"\xff" * 8  # for which h5py raises a KeyError
    (root / H5).write_bytes(damaged)
    assert "is not a RadarScenes radar file" in refused(root, H5)


def test_foreign_tables_are_refused(root):
    """Breaks if a wrong table is read as numbers, or the message does not say what is wrong."""
    unsigned = with_column(ODOMETRY, "timestamp", "u8")
    unsigned["timestamp"] = ODOMETRY["timestamp"][::-1]  # their differences wrap around
    spoiled = ODOMETRY.copy()
    spoiled["yaw_seq"][3] = np.nan  # np.unwrap would carry it on to all later headings
    for targets, driven, says in (
        (None, ODOMETRY, "no table 'radar_data'"),
        (TARGETS, None, "no table 'odometry'"),
        (np.zeros((20, 6)), ODOMETRY, "the table 'radar_data' has no column"),
        (TARGETS[0], ODOMETRY, "is not a RadarScenes radar file"),
        (TARGETS.reshape(1, -1), ODOMETRY, "of the table 'radar_data' does not hold numbers"),
        (TARGETS[:0], ODOMETRY, "but the file holds 0"),
        (TARGETS, ODOMETRY[:0], "its odometry is not in time order"),
        (TARGETS, unsigned, "its odometry is not in time order"),
        (TARGETS, spoiled, "its odometry's 'yaw_seq' holds nan or inf"),
    ):
        given = {"radar_data": targets, "odometry": driven}
        write_h5(root / H5, **{name: t for name, t in given.items() if t is not None})
        assert says in refused(root, H5)


def test_a_column_that_is_missing_or_of_another_type_is_named(root):
    """Breaks if the neighbouring column is read for it, or a wrong dtype is read as numbers."""
    contents = {"radar_data": TARGETS, "odometry": ODOMETRY}
    for name, table in contents.items():
        for column in table.dtype.names:
            if (name, column) != ("radar_data", "timestamp"):  # the scene list has them
                kept = [other for other in table.dtype.names if other != column]
                write_h5(root / H5, **(contents | {name: repack_fields(table[kept])}))
                assert f"the table {name!r} has no column {column!r}" in refused(root, H5)
            for kind in ("S4", "c8", "?", ("f4", (2,))):
                write_h5(root / H5, **(contents | {name: with_column(table, column, kind)}))
                assert f"the column {column!r} of the table {name!r}" in refused(root, H5)


@pytest.mark.parametrize(
    ("stamp", "indices", "file", "said"),
    [
        ("1000000", [0, 300], H5, "the scan at 1000000 us has the targets 0 to 300, but"),
        ("1000000", [-2, 3], H5, "has the targets -2 to 3"),
        ("1000000", [3, 0], H5, "has the targets 3 to 0"),
        ("1000000", [2, 4], H5, "holds targets of another sensor than 3"),
        ("1000000", [0.0, 3.9], SCENES, "is not a RadarScenes scene list"),
        ("01000000", [0, 3], SCENES, "is not a RadarScenes scene list"),
        ("1_000_000", [0, 3], SCENES, "is not a RadarScenes scene list"),
        ("+1000000", [0, 3], SCENES, "is not a RadarScenes scene list"),
    ],
)
def test_scans_that_do_not_fit_the_targets_are_refused(root, stamp, indices, file, said):
    """Breaks if a slice is cut, another sensor's targets are read, or a scan has two stamps."""
    content = scenes()
    content["scenes"][stamp] = {"sensor_id": 3, "radar_indices": indices}
    (root / SCENES).write_text(json.dumps(content))
    assert said in refused(root, file)


SENSOR_IDS = (1, 2, 3, 4)


def original(root: Path, sensor: int) -> tuple[np.ndarray, np.ndarray, list[dict[str, Any]]]:
    """The tables as they are in the file, and the sensor's scenes in time order."""
    folder = root / "data" / "sequence_105"
    with h5py.File(folder / "radar_data.h5", "r") as file:
        targets, driven = file["radar_data"][:], file["odometry"][:]
    content = json.loads((folder / "scenes.json").read_text())["scenes"]
    chosen = sorted((int(t), s) for t, s in content.items() if s["sensor_id"] == sensor)
    return targets, driven, [scene for _, scene in chosen]


@pytest.mark.radarscenes
@pytest.mark.parametrize("sensor", SENSOR_IDS)
def test_real_positions_are_the_data_s_own(radarscenes, sensor):
    """Breaks if azimuth, mounting or frame differ from those of x_cc and y_cc."""
    recording = load_radarscenes(radarscenes, 105, sensor)
    targets, _, listed = original(radarscenes, sensor)
    assert len(recording.scans) == len(listed) > 300
    for scan, scene in zip(recording.scans, listed, strict=True):
        rows = targets[slice(*scene["radar_indices"])]
        assert scan.size == len(rows)
        means = scan.point_set(recording.mounting).means
        # ranges up to 100 m in single precision
        assert_allclose(means, np.column_stack([rows["x_cc"], rows["y_cc"]]), rtol=0, atol=1e-5)


@pytest.mark.radarscenes
@pytest.mark.parametrize("sensor", SENSOR_IDS)
def test_real_doppler_is_compensated_as_the_data_does(radarscenes, sensor):
    """Breaks if our Doppler model is not that of vr_compensated, in any sign or lever arm.

    The data compensate with the odometry of the radar's time stamp, without the time offset, and
    with v_y = 0.  That odometry is not recorded to the last digit: in half of the scans it is that
    of odometry_index, in the others it differs by up to one step of v_x, 0.02 m/s.  So v_x and
    omega are fitted to each scan, which must leave nothing but the rounding of single precision.
    """
    recording = load_radarscenes(radarscenes, 105, sensor)
    targets, driven, listed = original(radarscenes, sensor)
    exact = []
    for scan, scene in zip(recording.scans, listed, strict=True):
        rows = targets[slice(*scene["radar_indices"])]
        taken_off = scan.doppler - rows["vr_compensated"]
        here = driven[scene["odometry_index"]]
        gain = doppler_gradients(scan.azimuth, recording.mounting)[0][:, [0, 2]]
        fitted = np.linalg.lstsq(gain, taken_off, rcond=None)[0]
        assert_allclose(gain @ fitted, taken_off, rtol=0, atol=1e-5)
        assert abs(fitted[0] - here["vx"]) < 0.021
        assert abs(fitted[1] - here["yaw_rate"]) < 0.01
        model = doppler_velocity(
            [here["vx"], 0.0, here["yaw_rate"]], scan.azimuth, recording.mounting
        )
        exact.append(np.abs(model - taken_off).max())
    assert max(exact) < 0.04
    assert np.mean(np.array(exact) < 1e-5) > 0.45


@pytest.mark.radarscenes
def test_real_drive_with_and_without_doppler(radarscenes):
    """Breaks if the estimates on sequence 105, sensor 3, get worse than the project promises."""
    recording = load_radarscenes(radarscenes, 105, 3)
    sharp, plain = (
        compare(track(recording, doppler=d), recording.reference) for d in (True, False)
    )
    v_x, v_y, omega = sharp.rmse
    assert sharp.share > 0.99
    assert v_x <= 0.06
    assert v_y <= 0.15
    assert omega <= 1.8
    assert plain.rmse[0] >= 8.0 * v_x
