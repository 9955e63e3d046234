"""Write the drive that the first page replays, `_static/labs/replay_data.js`, from our estimates.

    python tools/replay_data.py

The page may be opened from a folder, where a script cannot read a table but can be loaded.  What is
written is computed from the book's stored estimates for RadarScenes; it holds no measurements.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from d2d.radar import Mounting
from d2d.radar.readers.radarscenes import RADARSCENES_BUDGET
from d2d.radar.tracks.path import integrate
from d2d.study.road.estimates import estimates_path, read_estimates

SCRIPT = Path(__file__).parents[1] / "_static" / "labs" / "replay_data.js"
RUN = "sensor 3, baseline 2"
MOUNTING = Mounting(3.86, 0.7, 0.436)  # of sensor 3, as RadarScenes states it

Array = NDArray[np.float64]


def shared_errors(times: Array, theta: Array) -> Array:
    """Covariances (n, 2, 2) of [v_x, v_y] due to the errors that all targets of a scan share.

    ``theta`` (n, 3) are the velocities that the vehicle had at ``times`` (n,).  Of the data set's
    budget this is what a single sensor's velocity determines.  A turned sensor turns its own
    velocity; its Doppler velocities are off along its line of sight, as if all targets were there;
    a scale is along the velocity, and a lag along the acceleration.  The dependence of neighbouring
    targets is left out: it needs the targets, which are not stored.
    """
    v_x, v_y, omega = theta.T
    acceleration = np.gradient(theta[:, :2], times, axis=0)
    budget, yaw = RADARSCENES_BUDGET, MOUNTING.yaw
    ahead = np.broadcast_to([np.cos(yaw), np.sin(yaw)], acceleration.shape)
    turned = np.column_stack([omega * -MOUNTING.x - v_y, v_x - omega * MOUNTING.y])
    effects = (
        budget.azimuth * turned,
        budget.doppler * ahead,
        budget.scale * theta[:, :2],
        budget.lag * acceleration,
    )
    return np.asarray(sum(each[:, :, None] * each[:, None, :] for each in effects))


def drive() -> dict[str, Array]:
    """Each column of the replay, a row for each estimate that can be judged.

    Times in s; the pose [x, y] in m and yaw in rad, estimated and by the odometry; the errors of
    v_x and v_y in m/s, and the entries xx, xy, yy of the two covariances stated for them.
    """
    result = read_estimates(estimates_path(105))[RUN]
    judged, track, reference = result.judged, result.track, result.reference
    assert judged.share == 1.0  # so that rows of the track are rows of the comparison
    own, true = (integrate(theta, track.intervals)[1:] for theta in (track.theta, reference))
    hessian = judged.covariances[:, :2, :2]
    budget = hessian + shared_errors(track.times, reference)
    return {
        "time": track.times,
        **dict(zip(("x", "y", "yaw"), own.T, strict=True)),
        **dict(zip(("trueX", "trueY"), true.T, strict=False)),
        **dict(zip(("errorX", "errorY"), judged.errors.T, strict=False)),
        **{
            f"{name}{entry}": each[:, i, j]
            for name, each in (("hessian", hessian), ("budget", budget))
            for entry, i, j in (("XX", 0, 0), ("XY", 0, 1), ("YY", 1, 1))
        },
    }


def script(columns: dict[str, Array]) -> str:
    """A classic script that defines the columns, to four significant digits."""
    rounded: dict[str, Any] = {
        name: [float(f"{value:.4g}") for value in column] for name, column in columns.items()
    }
    lines = [f'"{name}": {json.dumps(own, separators=(",", ":"))}' for name, own in rounded.items()]
    head = "// Estimates for RadarScenes 105, written by tools/replay_data.py; no measurements."
    return f"{head}\nglobalThis.replayData = {{\n" + ",\n".join(lines) + ",\n};\n"


if __name__ == "__main__":
    SCRIPT.write_text(script(drive()), encoding="utf-8")
