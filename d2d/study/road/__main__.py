"""Compute what the book shows of recorded drives, from the data sets.

    python -m d2d.study.road PART FOLDER ...

A folder is that of a data set in its official layout, RadarScenes or nuScenes, and of the whole log
of the ESR for ``poses``; ``simulated`` needs none, and ``recordings`` only for its gyro.  The files
in ``chapters/results`` hold no measurements.
"""

import argparse
import warnings
from pathlib import Path
from typing import Any

import joblib

from d2d.study.road import (
    displacements,
    estimates,
    extrapolation,
    protocol_tables,
    recordings,
    scores,
    simulated,
)
from d2d.study.road.drive import find_drives, pick

PARTS: dict[str, Any] = {
    "estimates": estimates.write,
    "scores": scores.write,
    "displacements": displacements.write,
    "extrapolation": extrapolation.write,
    "protocol": protocol_tables.write,
    "recordings": recordings.write,
    "simulated": simulated.write,
    "poses": recordings.write_poses,
}
NO_DATA = ("simulated", "recordings")


def main() -> None:
    """Compute a part."""
    parser = argparse.ArgumentParser("python -m d2d.study.road", description=__doc__.split("\n")[0])
    parser.add_argument("part", choices=PARTS)
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER")
    parser.add_argument("--sequence", default="105", help="of the part `estimates`")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    arguments = parser.parse_args()
    if not arguments.folders and arguments.part not in NO_DATA:
        parser.error("this part needs a FOLDER")
    warnings.simplefilter("ignore")
    write = PARTS[arguments.part]
    if arguments.part == "poses":
        write(*arguments.folders)
        return
    sources = find_drives(arguments.folders)
    if arguments.part == "estimates":
        (source,) = pick(sources.get("RadarScenes", []), [arguments.sequence]).values()
        write(source)
        return
    with joblib.parallel_config(n_jobs=arguments.jobs):
        write(sources)


if __name__ == "__main__":
    main()
