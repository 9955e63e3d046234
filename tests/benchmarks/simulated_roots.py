"""Roots of data sets in their official layouts, with simulated drives."""

import json
from pathlib import Path

import h5py
import numpy as np

from d2d.radar import Drive, Mounting, simulate_drive
from d2d.radar.simulation.drive import CAR_SPEED
from d2d.study.recordings.estimates import SENSORS
from d2d.study.recordings.turning import CHANNELS
from tests.radar.readers.test_nuscenes import quaternion

YAWS = np.deg2rad([0.0, 90.0, -90.0, 175.0, -175.0])
MOUNTINGS = [Mounting(1.5 + 2.0 * np.cos(yaw), np.sin(yaw), yaw) for yaw in YAWS]
PCD = ("x", "y", "vx", "vy", "rcs", "invalid_state", "ambig_state")


def drives_of(seed: int, sensors: int, seconds: float) -> list[Drive]:
    """A drive, seen by several radars at once, from a place of the lap that the seed chooses."""
    rng = np.random.default_rng(seed)
    start, world, found = rng.uniform(0.0, 30.0), None, []
    for mounting in MOUNTINGS[:sensors]:
        found.append(
            simulate_drive(rng, seconds, CAR_SPEED, start=start, mounting=mounting, world=world)
        )
        world = found[0].world
    return found


# The delays of the radars' time stamps that the readers assume, us.
RADARSCENES_LATE, NUSCENES_LATE = 110_000, -30_000


def stamps(drive: Drive) -> np.ndarray:
    """Times in us, from one second on."""
    return np.round(1e6 * (1.0 + drive.truth.times)).astype(np.int64)


def write_radarscenes(root: Path, drives: int, seconds: float) -> None:
    """Sequences 1, 2, ... of four radars."""
    data = root / "data"
    data.mkdir(parents=True)
    named = zip(SENSORS, MOUNTINGS, strict=False)
    places = {f"radar_{s}": {"id": s, "x": m.x, "y": m.y, "yaw": m.yaw} for s, m in named}
    (data / "sensors.json").write_text(json.dumps(places))
    for number in range(1, drives + 1):
        folder = data / f"sequence_{number}"
        folder.mkdir()
        seen = drives_of(number, len(SENSORS), seconds)
        rows, listed = [], {}
        for sensor, drive in zip(SENSORS, seen, strict=True):
            for stamp, scan in zip(stamps(drive).tolist(), drive.scans, strict=True):
                stamp += sensor  # no two scans have the same key
                indices = [len(rows), len(rows) + scan.size]
                listed[str(stamp)] = {"sensor_id": sensor, "radar_indices": indices}
                columns = zip(scan.range, scan.azimuth, scan.doppler, strict=True)
                rows += [(stamp, sensor, *target, 1.0) for target in columns]
        kinds = "timestamp:i8 sensor_id:u1 range_sc:f4 azimuth_sc:f4 vr:f4 rcs:f4"
        targets = np.array(rows, dtype=[tuple(kind.split(":")) for kind in kinds.split()])
        truth = seen[0].truth
        fields = ("x_seq", "y_seq", "yaw_seq", "vx", "yaw_rate")
        odometry = np.zeros(
            len(truth.times), dtype=[("timestamp", "i8"), *((field, "f8") for field in fields)]
        )
        odometry["timestamp"] = stamps(seen[0]) - RADARSCENES_LATE
        columns = np.column_stack([truth.poses, truth.theta[:, [0, 2]]]).T
        for field, column in zip(fields, columns, strict=True):
            odometry[field] = column
        (folder / "scenes.json").write_text(json.dumps({"scenes": listed}))
        with h5py.File(folder / "radar_data.h5", "w") as file:
            file["radar_data"], file["odometry"] = targets, odometry


def write_nuscenes(root: Path, drives: int, seconds: float) -> None:
    """scene-0001, scene-0002, ... of five radars, without a CAN bus."""
    tables: dict[str, list[dict[str, object]]] = {
        "scene": [],
        "sample": [],
        "sensor": [{"token": c, "channel": c, "modality": "radar"} for c in CHANNELS],
        "calibrated_sensor": [
            {
                "token": c,
                "sensor_token": c,
                "translation": [m.x, m.y, 0.5],
                "rotation": quaternion(m.yaw),
            }
            for c, m in zip(CHANNELS, MOUNTINGS, strict=True)
        ],
        "sample_data": [],
        "ego_pose": [],
    }
    for number in range(1, drives + 1):
        scene = f"scene-{number:04}"
        tables["scene"].append({"name": scene, "token": scene})
        tables["sample"].append({"token": scene, "scene_token": scene})
        seen = drives_of(number, len(CHANNELS), seconds)
        for channel, drive in zip(CHANNELS, seen, strict=True):
            folder = root / "samples" / channel
            folder.mkdir(parents=True, exist_ok=True)
            for stamp, scan, pose in zip(
                stamps(drive).tolist(), drive.scans, drive.truth.poses, strict=True
            ):
                name = f"{scene}_{stamp}"
                write_pcd(folder / f"{name}.pcd", scan)
                row = {"timestamp": stamp, "token": name, "ego_pose_token": name}
                row |= {"sample_token": scene, "calibrated_sensor_token": channel}
                tables["sample_data"].append(row | {"filename": f"samples/{channel}/{name}.pcd"})
                if channel == CHANNELS[0]:
                    place = {"translation": [*pose[:2], 0.0], "rotation": quaternion(pose[2])}
                    place |= {"token": name, "timestamp": stamp - NUSCENES_LATE}
                    tables["ego_pose"].append(place)
    (root / "v1.0-mini").mkdir(parents=True)
    for name, rows in tables.items():
        (root / "v1.0-mini" / f"{name}.json").write_text(json.dumps(rows))


def write_pcd(path: Path, scan) -> None:
    """A scan as a binary point cloud."""
    cloud = np.zeros(scan.size, dtype=[(field, "f4") for field in PCD])
    cosine, sine = np.cos(scan.azimuth), np.sin(scan.azimuth)
    columns = (scan.range * cosine, scan.range * sine, scan.doppler * cosine, scan.doppler * sine)
    for field, column in zip(PCD, columns, strict=False):
        cloud[field] = column
    cloud["ambig_state"] = 3  # unambiguous
    header = {"VERSION": "0.7", "FIELDS": " ".join(PCD), "SIZE": " ".join("4" * len(PCD))}
    header |= {"TYPE": " ".join("F" * len(PCD)), "COUNT": " ".join("1" * len(PCD))}
    header |= {"WIDTH": str(scan.size), "HEIGHT": "1", "VIEWPOINT": "0 0 0 1 0 0 0"}
    header |= {"POINTS": str(scan.size), "DATA": "binary"}
    lines = "".join(f"{key} {value}\n" for key, value in header.items())
    path.write_bytes(lines.encode() + cloud.tobytes())
