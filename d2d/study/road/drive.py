"""Recorded drives of RadarScenes and nuScenes: where they lie, their sensors, their reference."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from d2d.radar import (
    Comparison,
    ErrorBudget,
    RadarScan,
    Recording,
    Reference,
    Track,
    compare,
    load_nuscenes,
    load_radarscenes,
    track,
)
from d2d.radar.readers.nuscenes import NUSCENES_BUDGET
from d2d.radar.readers.radarscenes import RADARSCENES_BUDGET
from d2d.radar.tracks.rounds import Round, rounds_of

HORIZON = 0.3  # s between the scans of a pair
SENSORS = (1, 2, 3, 4)
CHANNELS = tuple(
    f"RADAR_{place}" for place in ("FRONT", "FRONT_LEFT", "FRONT_RIGHT", "BACK_LEFT", "BACK_RIGHT")
)


@dataclass(frozen=True)
class Drive:
    """The recordings of all sensors of a car on one drive."""

    title: str
    recordings: Sequence[Recording]

    @property
    def budget(self) -> ErrorBudget | None:
        """The budget of the data set."""
        return self.recordings[0].budget

    @cached_property
    def rounds(self) -> list[Round]:
        """The rounds of scans that `track` makes of the recordings."""
        return rounds_of([(list(r.scans), r.mounting) for r in self.recordings], 1, HORIZON)

    @cached_property
    def reference(self) -> Reference:
        """The reference at the times of all sensors' scans."""
        known = [r.reference for r in self.recordings]
        columns = np.concatenate(
            [np.column_stack([each.times, each.theta, each.poses]) for each in known]
        )
        columns = columns[np.argsort(columns[:, 0], kind="stable")]
        return Reference(columns[:, 0], columns[:, 1:4], columns[:, 4:])

    @property
    def cycle(self) -> float:
        """The time between two scans of a sensor, in s."""
        return float(np.median(np.diff([scan.time for scan in self.recordings[0].scans])))

    def track(self, **options: Any) -> Track:
        """Track all sensors together, as bare pairs if there is no budget; options of `track`."""
        carry = options.get("budget") is not None
        return track(self.recordings, **{"carry": carry} | options)

    def compare(self, **options: Any) -> Comparison:
        """Compare the track of all sensors, with these options, with the reference."""
        return compare(self.track(**options), self.reference)

    def in_time_order(self) -> list[tuple[str, RadarScan]]:
        """The scans of all sensors as they were measured, each with its sensor's name."""
        scans = [(str(s), scan) for s, own in enumerate(self.recordings) for scan in own.scans]
        return sorted(scans, key=lambda entry: entry[1].time)

    def extended(self, extent: float) -> "Drive":
        """Give all targets another position scatter ``extent`` (m)."""
        return Drive(self.title, [with_extent(r, extent) for r in self.recordings])


def with_extent(recording: Recording, extent: float) -> Recording:
    """The recording with another position scatter ``extent`` (m) of its targets."""
    return replace(recording, scans=[scan.with_extent(extent) for scan in recording.scans])


class DataSet(NamedTuple):
    """How the drives of a data set are found and read."""

    names: Callable[[Path], list[str]]  # of the drives in a folder
    sensors: tuple[Any, ...]
    load: Callable[..., Recording]  # from the folder, the drive and the sensor
    budget: ErrorBudget
    alone: Mapping[str, int]  # places of single sensors that are judged alone
    title: str = "{}"  # of a drive


def sequences(root: Path) -> list[str]:
    """The numbers of the sequences in a folder of RadarScenes, in order."""
    return sorted((p.name.split("_")[1] for p in (root / "data").glob("sequence_*")), key=int)


def scenes(root: Path) -> list[str]:
    """The names of the scenes in a folder of nuScenes, in the order of its tables."""
    paths = sorted(root.glob("v1.0-*/scene.json"))
    tables = [json.loads(path.read_text(encoding="utf-8")) for path in paths]
    return [name for table in tables for name in sorted(scene["name"] for scene in table)]


DATA_SETS = {
    "RadarScenes": DataSet(
        sequences,
        SENSORS,
        load_radarscenes,
        RADARSCENES_BUDGET,
        {"front": 2, "side": 0},
        "sequence {}",
    ),
    "nuScenes": DataSet(scenes, CHANNELS, load_nuscenes, NUSCENES_BUDGET, {"front": 0, "side": 1}),
}


class Source(NamedTuple):
    """Where a drive can be read."""

    data_set: str
    root: Path
    name: str

    def load(self, **options: Any) -> Drive:
        """Read all sensors; options of the data set's reader."""
        own = DATA_SETS[self.data_set]
        read = [own.load(self.root, self.name, sensor, **options) for sensor in own.sensors]
        return Drive(own.title.format(self.name), read)


def find_drives(roots: Sequence[Path]) -> dict[str, list[Source]]:
    """The drives in folders of data sets, by data set; of equal ones the first."""
    found: dict[str, dict[str, Source]] = {}
    for root in roots:
        own = [
            Source(key, root, name) for key, one in DATA_SETS.items() for name in one.names(root)
        ]
        if not own:
            raise ValueError(f"{root} holds no drive of RadarScenes or nuScenes")
        for source in own:
            found.setdefault(source.data_set, {}).setdefault(source.name, source)
    return {key: list(drives.values()) for key, drives in found.items()}


def pick(sources: Sequence[Source], names: Sequence[str]) -> dict[str, Source]:
    """The drives of these names; a ``ValueError`` if one is missing."""
    known = {source.name: source for source in sources}
    missing = [name for name in names if name not in known]
    if missing:
        raise ValueError(f"the folders must hold {', '.join(missing)}, too")
    return {name: known[name] for name in names}
