"""Estimates on a RadarScenes sequence, kept in a small file that holds no measurement.

    python -m d2d.study.radarscenes <root> [--sequence 105] [--sensor 3]

writes ``chapters/results/radarscenes_<sequence>_<sensor>.csv``: our estimates, their covariances
and their errors, so that the chapter can be read without the data set.
"""

import argparse
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

from d2d._checks import Array
from d2d.radar import Recording, Track, load_radarscenes, track
from d2d.study.drives import DriveErrors

VARIANTS = {"with Doppler": True, "without Doppler": False}
COLUMNS = (
    *("doppler", "time_s", "interval_s", "converged", "vx", "vy", "omega"),
    *("cov_xx", "cov_xy", "cov_xw", "cov_yy", "cov_yw", "cov_ww"),
    *("error_vx", "error_vy", "error_omega"),
)
_UPPER = np.triu_indices(3)


class Result(NamedTuple):
    """The estimates of one variant, and their errors (n, 3), nan where no reference is known."""

    track: Track
    errors: Array

    @property
    def judged(self) -> DriveErrors:
        """The errors that can be judged, with their covariances."""
        return DriveErrors.from_errors(self.track, self.errors)


def estimate(recording: Recording) -> dict[str, Result]:
    """Track the recording with and without Doppler; times count from the first scan."""
    results = {}
    for name, doppler in VARIANTS.items():
        driven = track(recording.scans, recording.mounting, doppler=doppler)
        errors = driven.theta - recording.reference.theta[1:]
        since_start = driven.times - recording.scans[0].time
        results[name] = Result(
            Track(since_start, driven.intervals, driven.theta, driven.covariance, driven.converged),
            errors,
        )
    return results


def write(path: Path, results: dict[str, Result]) -> None:
    """Write all variants as one comma-separated table in SI units."""
    rows = []
    for name, (driven, errors) in results.items():
        flag = np.full(len(driven.times), float(VARIANTS[name]))
        upper = driven.covariance[:, _UPPER[0], _UPPER[1]]
        rows.append(
            np.column_stack(
                [
                    flag,
                    driven.times,
                    driven.intervals,
                    driven.converged,
                    driven.theta,
                    upper,
                    errors,
                ]
            )
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    header = ",".join(COLUMNS)
    np.savetxt(path, np.concatenate(rows), "%.8g", delimiter=",", header=header, comments="")


def read(path: Path) -> dict[str, Result]:
    """Read what `write` wrote."""
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    results = {}
    for name, doppler in VARIANTS.items():
        rows = table[table[:, 0] == float(doppler)]
        covariance = np.empty((len(rows), 3, 3))
        covariance[:, _UPPER[0], _UPPER[1]] = rows[:, 7:13]
        covariance[:, _UPPER[1], _UPPER[0]] = rows[:, 7:13]
        driven = Track(rows[:, 1], rows[:, 2], rows[:, 4:7], covariance, rows[:, 3] > 0)
        results[name] = Result(driven, rows[:, 13:16])
    return results


def default_path(sequence: int, sensor: int) -> Path:
    """Where the chapter looks for the results of that sequence and sensor."""
    chapters = Path(__file__).resolve().parents[2] / "chapters"
    return chapters / "results" / f"radarscenes_{sequence}_{sensor}.csv"


def data_root() -> Path | None:
    """The data set's folder that the environment variable D2D_RADARSCENES names, if it does."""
    root = os.environ.get("D2D_RADARSCENES")
    return Path(root) if root else None


def main() -> None:
    """Estimate one sequence and write its results."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("root", help="folder of the data set")
    parser.add_argument("--sequence", type=int, default=105)
    parser.add_argument("--sensor", type=int, default=3)
    arguments = parser.parse_args()
    recording = load_radarscenes(arguments.root, arguments.sequence, arguments.sensor)
    results = estimate(recording)
    path = default_path(arguments.sequence, arguments.sensor)
    write(path, results)
    for name, result in results.items():
        print(f"{name}: {result.judged.summary()}")
    print(f"written to {path}")


if __name__ == "__main__":
    main()
