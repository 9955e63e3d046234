"""The nuScenes reader, on a tiny data set in the official layout.

The tiny one has two scenes, two radars, a lidar whose files are not there, an empty scan, targets
that must be left out, and a vehicle that drives round a bend, so that its velocities are known.
"""

import json
import re
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d import rigid
from d2d.radar import Mounting, Recording, doppler_velocity, load_nuscenes
from d2d.radar.readers.nuscenes import azimuth_sigma

START = 1_532_402_900_000_000  # us
THETA = np.array([8.0, -0.2, 0.3])  # of the vehicle, all the time
POSE = np.array([411.0, 1180.0, 3.0])  # at START; yaw goes through pi
TIMES = START + np.array([0, 75_000, 150_000, 226_000, 299_000]) + 500_000
MOUNTINGS = {"RADAR_FRONT": (3.4, 0.0, 0.02), "RADAR_BACK_LEFT": (-0.5, 0.6, 3.05)}
FIELDS = "x y z dyn_prop id rcs vx vy vx_comp vy_comp is_quality_valid ambig_state x_rms y_rms"
FIELDS += " invalid_state pdh0 vx_rms vy_rms"
KINDS = [*3 * ["f4"], "i1", "i2", *5 * ["f4"], *8 * ["i1"]]
TYPES = [kind[0].upper() for kind in KINDS]
# x, y, rcs, invalid_state, ambig_state of each target
TARGETS = [
    (10.0, 2.0, 5.0, 0, 3),
    (20.0, -4.2, 1.0, 4, 3),
    (30.2, 0.0, 9.0, 17, 3),
    (5.0, 6.0, 7.0, 0, 3),
    (40.0, 1.0, 50.0, 3, 3),  # not valid
    (41.0, 1.0, 50.0, 7, 3),
    (42.0, 1.0, 50.0, 0, 0),  # ambiguous
    (43.0, 1.0, 50.0, 0, 4),
    (0.0, 0.0, 50.0, 0, 3),  # at the sensor
    (np.nan, 1.0, 50.0, 0, 3),
    (44.0, np.inf, 50.0, 0, 3),
]
GOOD = 4


def quaternion(yaw: float) -> list[float]:
    """Of a rotation about z."""
    return [float(np.cos(yaw / 2)), 0.0, 0.0, float(np.sin(yaw / 2))]


def pose_at(microseconds: float) -> np.ndarray:
    """The vehicle's pose; its velocity is always THETA."""
    step = rigid.exponential(THETA * (microseconds - START) * 1e-6)
    return np.append(
        POSE[:2] + rigid.rotation(POSE[2]) @ step[:2],
        (POSE[2] + step[2] + np.pi) % (2 * np.pi) - np.pi,
    )


def pcd(rows: list[tuple[float, ...]], channel: str, **changes: str) -> bytes:
    """A point cloud of static targets, with the radar's vx = v_r / cos(azimuth) and vy = 0."""
    x, y, rcs, invalid, ambiguous = np.array(rows, dtype=float).reshape(-1, 5).T
    layout = {"names": FIELDS.split(), "formats": KINDS}
    cloud = np.full(len(x), 77, dtype=layout)  # must not be read
    good = np.isfinite(x) & np.isfinite(y)
    azimuth = np.arctan2(np.where(good, y, 0.0), np.where(good, x, 1.0))
    radial = doppler_velocity(THETA, azimuth, mounting_of(channel))
    columns = {"x": x, "y": y, "rcs": rcs, "invalid_state": invalid, "ambig_state": ambiguous}
    columns |= {"vx": radial / np.cos(azimuth), "vy": 0.0 * radial}
    for name, column in columns.items():
        cloud[name] = column
    header = {"VERSION": "0.7", "FIELDS": FIELDS, "SIZE": " ".join(kind[1] for kind in KINDS)}
    header |= {"TYPE": " ".join(TYPES), "COUNT": " ".join(["1"] * len(KINDS))}
    header |= {"WIDTH": str(len(x)), "HEIGHT": "1", "VIEWPOINT": "0 0 0 1 0 0 0"}
    header |= {"POINTS": str(len(x)), "DATA": "binary"}
    lines = [f"{key} {value}" for key, value in (header | changes).items()]
    return "\n".join(["# .PCD v0.7 - Point Cloud Data file format", *lines, ""]).encode() + (
        cloud.tobytes()
    )


def mounting_of(channel: str) -> Mounting:
    """As the reader must find it."""
    return Mounting(*MOUNTINGS[channel])


def placed(pose: Any, **row: Any) -> dict[str, Any]:
    """A row of a table with a place and a direction."""
    x, y, yaw = pose
    return row | {"translation": [x, y, 0.5], "rotation": quaternion(yaw)}


def tables() -> dict[str, list[dict[str, Any]]]:
    """The tables, with rows that do not matter among those that do; not in time order."""
    scenes, channels = ["scene-0001", "scene-0002"], [*MOUNTINGS, "LIDAR_TOP"]
    calibrated, data, poses = [], [], []
    for scene, channel in product(scenes, channels):
        x, y, yaw = MOUNTINGS.get(channel, (0.9, 0.0, 0.0))
        place = (x + (scene != scenes[0]), y, yaw)  # the other scene is of another vehicle
        mounted = f"C{scene}{channel}"
        calibrated.append(placed(place, token=mounted, sensor_token=channel))
        for number, time in enumerate(reversed(TIMES.tolist())):
            stamp = time + 11_000 * channels.index(channel)
            token = f"D{scene}{channel}{stamp}"
            file = f"{'sweeps' if number % 2 else 'samples'}/{channel}/{scene}_{stamp}.pcd"
            row = {"token": token, "timestamp": stamp, "filename": file}
            row |= {"sample_token": f"K{scene}", "calibrated_sensor_token": mounted}
            data.append(row | {"ego_pose_token": token})
            poses.append(placed(pose_at(stamp), token=token, timestamp=stamp))
    return {
        "scene": [{"token": f"S{s}", "name": s} for s in scenes],
        "sample": [{"token": f"K{s}", "scene_token": f"S{s}"} for s in scenes],
        "sensor": [
            {"token": c, "channel": c, "modality": c.split("_")[0].lower()} for c in channels
        ],
        "calibrated_sensor": calibrated,
        "sample_data": data,
        "ego_pose": poses,
    }


def can_bus() -> list[dict[str, Any]]:
    """Poses at 50 Hz; the speed is low by a tenth and changes, so that its delay shows."""
    rows = []
    for stamp in START + np.arange(0, 1_500_000, 20_000):
        x, y, yaw = pose_at(stamp)
        row = {"utime": int(stamp), "pos": [x, y, 0.0], "orientation": quaternion(yaw)}
        rows.append(
            row | {"vel": [speed_on_bus(stamp), 0.0, 0.0], "rotation_rate": [0.0, 0.0, 55.0]}
        )
    return rows


def speed_on_bus(microseconds: float) -> float:
    """Linear in time, so that interpolation is exact."""
    return 7.2 + 2.0 * (microseconds - START) * 1e-6


def write_dataset(folder: Path) -> Path:
    """The tiny data set; the first radar's second scan is empty."""
    root = folder / "nuScenes"
    for folder in ("v1.0-mini", "can_bus"):
        (root / folder).mkdir(parents=True)
    content = tables()
    for name, rows in content.items():
        (root / "v1.0-mini" / f"{name}.json").write_text(json.dumps(rows))
    (root / "can_bus" / "scene-0001_pose.json").write_text(json.dumps(can_bus()))
    for row in content["sample_data"]:
        channel = row["filename"].split("/")[1]
        if channel in MOUNTINGS:
            path = root / row["filename"]
            path.parent.mkdir(parents=True, exist_ok=True)
            nothing = [(np.nan, np.nan, np.nan, 0, 3)]
            empty = channel == "RADAR_FRONT" and row["timestamp"] == TIMES[1]
            path.write_bytes(pcd(nothing if empty else TARGETS, channel))
    return root


@pytest.fixture
def root(tmp_path) -> Path:
    return write_dataset(tmp_path)


def load(root: Path, **options: Any) -> Recording:
    """The first scene's front radar."""
    return load_nuscenes(root, "scene-0001", "RADAR_FRONT", **options)


def change(root: Path, name: str, edit: Any) -> None:
    """Edit a table in place: all rows by ``edit(rows)``, or entries that each row gets."""
    path = root / "v1.0-mini" / f"{name}.json"
    rows = json.loads(path.read_text())
    changed = [row | edit for row in rows] if isinstance(edit, dict) else edit(rows) or rows
    path.write_text(json.dumps(changed))


def test_scans_of_one_radar_in_one_scene_in_time_order(root, monkeypatch):
    """Breaks if samples and sweeps are not merged, scenes or channels get mixed up, a tilde is
    taken for a folder's name, or valid states, ambiguity or the columns' order not heeded."""
    recording = load(root)
    assert_allclose([s.time for s in recording.scans], TIMES * 1e-6, rtol=0, atol=1e-6)
    assert [len(s) for s in recording.scans] == [GOOD, 0, GOOD, GOOD, GOOD]
    scan, (x, y) = recording.scans[0], np.array(TARGETS)[:GOOD, :2].T
    assert_allclose(scan.range * np.cos(scan.azimuth), x, rtol=1e-6)
    assert_allclose(scan.range * np.sin(scan.azimuth), y, rtol=1e-6, atol=1e-9)
    monkeypatch.setenv("HOME", str(root.parent))
    back = load_nuscenes(f"~/{root.name}", "scene-0001", "RADAR_BACK_LEFT")
    assert_allclose([s.time for s in back.scans], TIMES * 1e-6 + 0.011, rtol=0, atol=1e-6)


def test_a_table_that_has_changed_is_read_again(root):
    """Breaks if tables are kept from one call to the next whatever happens to the files."""
    assert load(root).mounting.x == MOUNTINGS["RADAR_FRONT"][0]
    change(root, "calibrated_sensor", placed((1.0, 0.5, 0.25)))
    assert load(root).mounting.x == 1.0


def test_velocities_are_projected_onto_the_line_of_sight(root):
    """Breaks if vx or the speed is taken for the Doppler velocity: both are wrong off the axis; or
    if what the radar adds in turns stays, or has another sign or power of the yaw rate."""
    for channel in MOUNTINGS:
        scan = load_nuscenes(root, "scene-0001", channel, prediction_time=0.0).scans[2]
        expected = doppler_velocity(THETA, scan.azimuth, mounting_of(channel))
        assert_allclose(scan.doppler, expected, rtol=0, atol=1e-5)
        assert np.abs(scan.doppler - scan.doppler / np.cos(scan.azimuth)).max() > 0.3
    reported, corrected = (load(root, prediction_time=t).scans[2] for t in (0.0, 0.037))
    added = 0.037 * THETA[2] ** 2 * reported.range
    assert_allclose(reported.doppler - corrected.doppler, added, rtol=2e-2)
    assert_array_equal(reported.range, corrected.range)


def test_mountings_are_those_of_the_scene_s_vehicle(root):
    """Breaks if the yaw is not that of the quaternion, another vehicle's calibration is read, or a
    known error of the mounting is subtracted, or added to the radars of other vehicles."""
    for channel, (x, y, yaw) in MOUNTINGS.items():
        for scene, shift in (("scene-0001", 0.0), ("scene-0002", 1.0)):
            mounting = load_nuscenes(root, scene, channel).mounting
            assert_allclose(mounting.pose, [x + shift, y, yaw], atol=1e-12)
    change(root, "calibrated_sensor", {"rotation": quaternion(np.deg2rad(0.2))})
    assert np.rad2deg(load(root, stated_mounting=True).mounting.yaw) == pytest.approx(0.2)
    assert np.rad2deg(load(root).mounting.yaw) == pytest.approx(0.2 - 0.74)
    yaw, pitch = 0.7, 0.1  # of a tilted radar, whose w and z alone are not its direction
    w, z, c, s = np.cos(yaw / 2), np.sin(yaw / 2), np.cos(pitch / 2), np.sin(pitch / 2)
    change(root, "calibrated_sensor", {"rotation": [w * c, -z * s, w * s, z * c]})
    assert load(root).mounting.yaw == pytest.approx(yaw, abs=1e-12)


def test_standard_deviations_have_the_rounding_in_them(root):
    """Breaks if an option is not handed on, the grid's share is left out, or not divided by the
    range for the azimuth, or a function does not see the kept azimuths."""
    angles = np.deg2rad([0.0, 30.0, 60.0, -60.0])
    assert_allclose(np.rad2deg(azimuth_sigma(angles)), [0.3, 0.45, 0.6, 0.6])
    other = {"sigma_range": 0.4, "sigma_doppler": 0.3}
    for options, along, speed, angle in (
        ({}, 0.15, 0.06, azimuth_sigma),
        (other | {"sigma_azimuth": lambda a: 0.1 + np.abs(a)}, 0.4, 0.3, lambda a: 0.1 + np.abs(a)),
        ({"sigma_azimuth": 0.2}, 0.15, 0.06, lambda a: 0.2),
    ):
        scan = load(root, **options).scans[0]
        assert_allclose(scan.sigma_range, np.sqrt(along**2 + 0.2**2 / 12))
        assert_allclose(scan.sigma_doppler, np.sqrt(speed**2 + 0.25**2 / 12))
        grid = 0.2 / np.sqrt(12.0) / scan.range
        assert_allclose(scan.sigma_azimuth, np.hypot(angle(scan.azimuth), grid))


def test_the_strongest_targets_are_kept_in_their_order(root):
    """Breaks if the weakest are kept, or targets that are left out count."""
    for strongest, kept in ((1, [2]), (3, [0, 2, 3]), (48, [0, 1, 2, 3])):
        scan = load(root, strongest=strongest).scans[0]
        assert_allclose(scan.range, np.hypot(*np.array(TARGETS)[kept, :2].T), rtol=1e-6)


def test_the_reference_is_the_derivative_of_the_poses(root):
    """Breaks if the offset has the other sign, or velocities are not along the vehicle's axes."""
    for offset in (0.08, 0.0, -0.05):
        reference = load(root, time_offset=offset, speed_factor=None).reference
        assert_allclose(reference.times, TIMES * 1e-6, rtol=0, atol=1e-6)
        assert_allclose(reference.theta, np.tile(THETA, (len(TIMES), 1)), rtol=0, atol=5e-3)
        poses = np.array([pose_at(t - 1e6 * offset) for t in TIMES])
        assert_allclose(reference.poses[:, :2], poses[:, :2], rtol=0, atol=5e-3)
        turns = (reference.poses[:, 2] - poses[:, 2]) / (2 * np.pi)
        assert_allclose(turns, np.round(turns), rtol=0, atol=1e-6)
        assert (np.diff(reference.poses[:, 2]) < 0.1).all()


def test_the_speed_on_the_bus_is_late_and_low(root):
    """Breaks if the factor divides, or the delay has the other sign than the offset."""
    for offset in (0.08, -0.05):
        theta = load(root, time_offset=offset, speed_factor=1.1).reference.theta
        front = np.array([1.1 * speed_on_bus(t - 1e6 * offset + 100_000) for t in TIMES])
        sideways = 2.588 * theta[:, 2]  # of the front axle, about the rear one
        assert_allclose(theta[:, 0], np.sqrt(front**2 - sideways**2), rtol=0, atol=1e-6)
        assert_allclose(theta[:, 1:], np.tile(THETA[1:], (len(TIMES), 1)), rtol=0, atol=5e-3)


def test_outside_the_poses_the_reference_is_nan(root):
    """Breaks if a motion is made up where there is no pose on one side."""
    theta = load(root, time_offset=-0.7).reference.theta  # up to 1.499 s of 1.48 s
    assert_array_equal(np.isfinite(theta[:, 1]), [True, True, True, True, False])
    # the speed is missing a tenth of a second earlier
    assert_array_equal(np.isfinite(theta[:, 0]), [True, True, True, False, False])


def test_without_a_can_bus_the_ego_poses_are_differentiated(root):
    """Breaks if poses of the other scene, of one sensor only, or twice at one time are taken, or
    a recording without a reference comes out."""
    (root / "can_bus/scene-0001_pose.json").unlink()
    reference = load(root, time_offset=0.0).reference
    known = np.isfinite(reference.theta[:, 0])
    assert known.sum() >= 4
    assert_allclose(reference.theta[known], np.tile(THETA, (known.sum(), 1)), rtol=0, atol=5e-3)
    (root / "v1.0-mini/ego_pose.json").unlink()
    with pytest.raises(FileNotFoundError, match=r"ego_pose\.json does not exist; it should be"):
        load(root)


def test_the_version_of_the_tables_is_named_if_there_are_several(root):
    """Breaks if the first of them is taken, or a folder without any."""
    with pytest.raises(FileNotFoundError, match=r"v1\.0-\* does not exist; it should be"):
        load(root / "samples")
    (root / "v1.0-trainval").mkdir()  # of several versions the first may not hold the scene
    with pytest.raises(ValueError, match=r"version must be given.*: v1\.0-mini, v1\.0-trainval"):
        load(root)
    assert len(load(root, version="v1.0-mini").scans) == len(TIMES)
    with pytest.raises(FileNotFoundError, match=r"v1\.0-test does not exist"):
        load(root, version="v1.0-test")


def test_an_unknown_scene_or_channel_is_told_which_there_are(root):
    """Breaks if the reader must open the tables to learn the names, or a lidar is offered."""
    channels = r"channel must be one of RADAR_BACK_LEFT, RADAR_FRONT, but is"
    for scene, channel, said in (
        ("scene-0003", "RADAR_FRONT", "scene must be one of scene-0001, scene-0002, but is"),
        ("scene-0001", "RADAR_REAR", channels),
        ("scene-0001", "LIDAR_TOP", channels),
    ):
        with pytest.raises(ValueError, match=f"^{said}"):
            load_nuscenes(root, scene, channel)


def test_a_radar_without_scans_or_with_two_mountings_is_named(root):
    """Breaks if one of the mountings is taken for all scans, or an empty recording returned."""

    def edit(rows):
        rows[0]["calibrated_sensor_token"] = "Cscene-0002RADAR_FRONT"

    change(root, "sample_data", edit)
    with pytest.raises(ValueError, match="2 mountings of RADAR_FRONT in scene-0001"):
        load(root)
    change(root, "sample_data", lambda rows: [r for r in rows if "FRONT" not in r["filename"]])
    with pytest.raises(ValueError, match="no scan of RADAR_FRONT in scene-0001"):
        load(root)


def refused(root: Path, path: Path) -> str:
    """What the ValueError says, after it named the file."""
    with pytest.raises(ValueError, match=re.escape(f"{path} is not a ")) as caught:
        load(root)
    return str(caught.value)


def test_a_foreign_or_truncated_point_cloud_is_named(root):
    """Breaks if columns are read by position, or the error does not say what is wrong."""
    path = next(root.glob(f"s*/RADAR_FRONT/scene-0001_{TIMES[0]}.pcd"))
    whole = path.read_bytes()
    for share in (0.0, 0.1, 0.3, 0.6, 0.9, 0.999):
        path.write_bytes(whole[: int(share * len(whole))])
        assert "is not a binary PCD file of a radar" in refused(root, path)
    for changes, says in (
        ({"FIELDS": FIELDS.replace("rcs", "intensity")}, "it has no field 'rcs'"),
        ({"DATA": "ascii"}, "its data are ascii"),
        ({"DATA": "binary_compressed"}, "its data are binary_compressed"),
        ({"SIZE": "4 4 4"}, "zip()"),
        ({"COUNT": " ".join("2" * len(TYPES))}, "it has a field of several values"),
        ({"POINTS": "12"}, "announces 12 points of 43 bytes"),
    ):
        path.write_bytes(pcd(TARGETS, "RADAR_FRONT", **changes))
        assert says in refused(root, path)
    for content in (b"", b"\x89PNG", b"x,y\n1,2\n", b"\xff" * 9 + b"\nDATA binary\n"):
        path.write_bytes(content)
        refused(root, path)
