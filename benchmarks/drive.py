"""Throughput on real data, RadarScenes, including the time to read it."""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from d2d.radar import load_radarscenes, track

SEQUENCE, SENSOR = 105, 3
STRONGEST = 200


@dataclass(frozen=True)
class Throughput:
    """Number of scans and of targets in a scan; seconds driven, to read, to read and register."""

    scans: int
    targets: float
    driven: float
    reading: float
    total: float

    @property
    def times_real_time(self) -> float:
        """Seconds driven per second of computing."""
        return self.driven / self.total


def measure(root: Path) -> Throughput:
    """Read one sensor of one sequence and track it with the joint cost; the best of three."""
    best = None
    for _ in range(3):
        begin = time.perf_counter()
        recording = load_radarscenes(root, SEQUENCE, SENSOR, strongest=STRONGEST)
        read = time.perf_counter()
        track(recording)
        end = time.perf_counter()
        scans = recording.scans
        result = Throughput(
            len(scans),
            float(np.mean([scan.size for scan in scans])),
            scans[-1].time - scans[0].time,
            read - begin,
            end - begin,
        )
        if best is None or result.total < best.total:
            best = result
    assert best is not None
    return best
