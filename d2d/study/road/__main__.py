"""Compute what the book shows of recorded drives, from the data sets.

    python -m d2d.study.road PART FOLDER ...

A folder is that of a data set in its official layout, RadarScenes or nuScenes; ``simulated`` needs
none, and ``recordings`` only for its gyro.  The files in ``chapters/results`` hold no measurements.
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
    scan_profile,
    scores,
    simulated,
)
from d2d.study.road.drive import find_drives, pick

PARTS: dict[str, Any] = {
    "estimates": estimates.write,
    "profile": scan_profile.write,
    "scores": scores.write,
    "displacements": displacements.write,
    "extrapolation": extrapolation.write,
    "protocol": protocol_tables.write,
    "recordings": recordings.write,
    "simulated": simulated.write,
}
OF_ONE_SEQUENCE, NO_DATA = ("estimates", "profile"), ("simulated", "recordings")


def main() -> None:
    """Compute a part."""
    parser = argparse.ArgumentParser("python -m d2d.study.road", description=__doc__.split("\n")[0])
    parser.add_argument("part", choices=PARTS)
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER")
    parser.add_argument("--sequence", default="105", help="of the parts `estimates` and `profile`")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    arguments = parser.parse_args()
    if not arguments.folders and arguments.part not in NO_DATA:
        parser.error("this part needs a FOLDER")
    warnings.simplefilter("ignore")
    sources = find_drives(arguments.folders)
    write = PARTS[arguments.part]
    if arguments.part in OF_ONE_SEQUENCE:
        (source,) = pick(sources.get("RadarScenes", []), [arguments.sequence]).values()
        write(source)
        return
    with joblib.parallel_config(n_jobs=arguments.jobs):
        write(sources)


if __name__ == "__main__":
    main()
