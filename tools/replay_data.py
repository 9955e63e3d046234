"""Write the drive that the first page replays, `_static/labs/replay_data.js`.

    python tools/replay_data.py

The page may be opened from a folder, where a script cannot read a table but can be loaded.  What is
written is computed from the book's stored estimates for RadarScenes, and has the targets of some of
its scans (CC BY-NC-SA 4.0, see chapters/data/radarscenes).
"""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from d2d import rigid
from d2d._types import Array
from d2d.radar import Tracker, load_radarscenes
from d2d.radar.readers.radarscenes import RADARSCENES_BUDGET
from d2d.radar.tracks.path import chain
from d2d.study.road.estimates import estimates_path, read_estimates

ROOT = Path(__file__).parents[1]
SCRIPT = ROOT / "_static" / "labs" / "replay_data.js"
RECORDING = load_radarscenes(ROOT / "chapters" / "data" / "radarscenes", 105, 3)
RUN = "sensor 3, baseline 2"


def drive() -> dict[str, Array]:
    """Each column of the replay, a row for each estimate that can be judged.

    Times in s; the pose [x, y] in m and yaw in rad, estimated and by the odometry; the errors of
    v_x and v_y in m/s, and the entries xx, xy, yy of the two covariances stated for them.
    """
    result = read_estimates(estimates_path(105))[RUN]
    judged, bare, reference = result.judged, result.track, result.reference
    assert judged.share == 1.0  # so that rows of the track are rows of the comparison
    moves = (rigid.exponential(bare.intervals[:, None] * each) for each in (bare.theta, reference))
    own, true = (chain(each, np.zeros(3))[1:] for each in moves)
    hessian = judged.covariances[:, :2, :2]
    shared = replace(RADARSCENES_BUDGET, neighbours=0.0)  # errors of whole scans
    tracker = Tracker({"radar": RECORDING.mounting}, baseline=2, budget=shared)
    pairs = [pair for scan in RECORDING.scans for pair in tracker.add("radar", scan)]
    slow = np.array([pair.filter_input.slow for pair in pairs if pair.filter_input])
    budget = hessian + (slow @ slow.swapaxes(1, 2))[:, :2, :2]
    return {
        "time": bare.times,
        **dict(zip(("x", "y", "yaw"), own.T, strict=True)),
        **dict(zip(("trueX", "trueY"), true.T, strict=False)),
        **dict(zip(("errorX", "errorY"), judged.errors.T, strict=False)),
        **{
            f"{name}{entry}": each[:, i, j]
            for name, each in (("hessian", hessian), ("budget", budget))
            for entry, i, j in (("XX", 0, 0), ("XY", 0, 1), ("YY", 1, 1))
        },
    }


def shown_scans(start: float) -> list[list[float]]:
    """Pairs of scans 0.3 s apart, one in 0.9 s: each a time, then x and y of its targets in dm.

    The times count as the estimates do, the first of which is at ``start``; the targets are those
    within 75 m, in the vehicle's frame.
    """
    scans, listed = RECORDING.scans, []
    for scan in (scans[k + late] for k in range(0, len(scans) - 4, 12) for late in (0, 4)):
        means = scan.point_set(RECORDING.mounting).means[scan.range < 75.0]
        time = scan.time - scans[1].time + start
        listed.append([round(time, 3), *np.rint(10.0 * means).astype(int).ravel().tolist()])
    return listed


def script(columns: dict[str, Array]) -> str:
    """A classic script that defines the columns, to four significant digits, and the scans."""
    rounded: dict[str, Any] = {
        name: [float(f"{value:.4g}") for value in column] for name, column in columns.items()
    }
    lines = [f'"{name}": {json.dumps(own, separators=(",", ":"))}' for name, own in rounded.items()]
    shown = json.dumps(shown_scans(float(columns["time"][0])), separators=(",", ":"))
    lines.append(f'"scans": {shown}')
    head = "// RadarScenes 105, by tools/replay_data.py; its scans are under CC BY-NC-SA 4.0."
    return f"{head}\nglobalThis.replayData = {{\n" + ",\n".join(lines) + ",\n};\n"


if __name__ == "__main__":
    SCRIPT.write_text(script(drive()), encoding="utf-8")
