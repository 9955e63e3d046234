"""The command line `python -m d2d.radar`: tracks from logs and data sets, written to files."""

import argparse
import math
import os
import sys
import tempfile
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from d2d._checks import check_path
from d2d.radar.cli_help import HELP, PROGRAM, TRACK_EPILOG, TRACK_HELP
from d2d.radar.readers.csv_log import load_csv, write_csv
from d2d.radar.readers.nuscenes import load_nuscenes
from d2d.radar.readers.radarscenes import load_radarscenes
from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.scans.recording import Recording
from d2d.radar.scans.scan import Mounting, RadarScan
from d2d.radar.simulation.drive import simulate_drive
from d2d.radar.tracks.limits import VehicleLimits
from d2d.radar.tracks.rounds import MAX_INTERVAL
from d2d.radar.tracks.track import Track
from d2d.radar.tracks.tracking import track

# The options that belong to each source, and those of them that it needs.
_OF_SOURCE = {
    "radarscenes": ("sequence", "sensor"),
    "nuscenes": ("scene", "channel"),
    "csv": ("mounting", "degrees", "sigma_range", "sigma_azimuth", "sigma_doppler"),
}
_NEEDED = ("sequence", "sensor", "scene", "channel", "mounting")
_BUDGET = ("azimuth", "doppler", "scale", "lag", "neighbours")


class Source(NamedTuple):
    """What is tracked: the scans and mounting of each sensor, and the errors that targets share."""

    sensors: list[tuple[list[RadarScan], Mounting]]
    budget: ErrorBudget


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status.

    Parameters
    ----------
    argv : sequence of str, optional
        The arguments, by default those of the process.

    Returns
    -------
    int
        0 on success, 1 on failure, 130 if interrupted; what was wrong is written to the standard
        error.

    Raises
    ------
    SystemExit
        With status 2 if the arguments are wrong, with 0 after ``--help``.
    """
    parser, of_track = _parsers()
    arguments = parser.parse_args(argv)
    try:
        if arguments.command == "example":
            _write_example(arguments.file)
        else:
            _check_source(of_track, arguments)
            _check_budget(of_track, arguments)
            _track(arguments)
    except (ValueError, OSError) as error:
        print(f"{PROGRAM}: error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"{PROGRAM}: interrupted, nothing was written", file=sys.stderr)
        return 130  # as shells report it
    return 0


def _parsers() -> tuple[argparse.ArgumentParser, argparse.ArgumentParser]:
    """The parser of the program and that of its command ``track``."""
    plain = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(PROGRAM, description=HELP, formatter_class=plain)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    found = commands.add_parser(
        "track",
        help="estimate a drive and write its path and velocities",
        description=TRACK_HELP,
        epilog=TRACK_EPILOG,
        formatter_class=plain,
        allow_abbrev=False,
    )
    _add_sources(found)
    _add_estimation(found)
    _add_budget(found)
    example = commands.add_parser("example", help="write a simulated log as a CSV file")
    example.add_argument("file", metavar="FILE", help="the CSV file; an existing one is replaced")
    return parser, found


def _add_sources(parser: argparse.ArgumentParser) -> None:
    which = parser.add_argument_group("what to read (one of three)")
    source = which.add_mutually_exclusive_group(required=True)
    source.add_argument("--csv", metavar="FILE", help="a log, as described below")
    source.add_argument("--radarscenes", metavar="ROOT", help="folder of the RadarScenes data set")
    source.add_argument("--nuscenes", metavar="ROOT", help="folder of the nuScenes data set")
    log = parser.add_argument_group("options of a CSV file")
    log.add_argument(
        "--mounting",
        action="append",
        nargs=4,
        metavar=("NAME", "X", "Y", "YAW"),
        help="where a sensor sits, in m, m, degrees; once for each sensor",
    )
    log.add_argument(
        "--degrees",
        action="store_true",
        default=None,
        help="the file's azimuths and their standard deviations are in degrees",
    )
    for name, unit in (("range", "M"), ("azimuth", "DEG"), ("doppler", "M/S")):
        log.add_argument(
            f"--sigma-{name}",
            type=float,
            metavar=unit,
            help=f"standard deviation of the {name} of all targets, instead of a column",
        )
    scenes = parser.add_argument_group("options of a data set")
    scenes.add_argument("--sequence", metavar="N", help="RadarScenes: number of the sequence")
    scenes.add_argument("--sensor", type=int, nargs="+", metavar="N", help="RadarScenes: 1 to 4")
    scenes.add_argument("--scene", metavar="NAME", help="nuScenes: name, such as scene-0061")
    scenes.add_argument(
        "--channel", nargs="+", metavar="NAME", help="nuScenes: radars, such as RADAR_FRONT"
    )


def _add_estimation(parser: argparse.ArgumentParser) -> None:
    how = parser.add_argument_group("how to estimate and what to write")
    how.add_argument(
        "--output",
        default="track",
        metavar="PREFIX",
        help="beginning of the files' names (default: track); if it is a folder or ends with /, "
        "the files are called track.* in it",
    )
    how.add_argument(
        "--baseline",
        type=int,
        default=1,
        metavar="N",
        help="register each scan with the Nth before (default: 1); 2 or 3 make the yaw rate more "
        "accurate where the motion is smooth",
    )
    how.add_argument(
        "--horizon",
        type=float,
        metavar="S",
        help="instead of --baseline: register each scan with the one nearest to S seconds before; "
        "0.3 is a good choice on the road",
    )
    how.add_argument(
        "--extent",
        type=float,
        metavar="M",
        help="how far reflections wander on objects from scan to scan, as a standard deviation "
        "(default: the data set's own, or 0 for a log)",
    )
    how.add_argument(
        "--side-slip",
        type=float,
        metavar="M/S",
        help="standard deviation of the sideways velocity of the vehicle's origin about zero; 0 if "
        "it never moves sideways, as the middle of a rear axle that does not slip (default: "
        "unknown). It helps a single radar most: the yaw rate becomes more accurate",
    )
    how.add_argument(
        "--max-acceleration",
        type=float,
        default=VehicleLimits().acceleration,
        metavar="M/S^2",
        help="estimates that need a larger acceleration are not accepted (default: "
        f"{VehicleLimits().acceleration:g}, far beyond a car's); with few targets in dense traffic "
        "use the limit of your vehicle, such as 8",
    )
    how.add_argument(
        "--max-interval",
        type=float,
        default=MAX_INTERVAL,
        metavar="S",
        help=f"longest time between two scans (default: {MAX_INTERVAL:g})",
    )
    how.add_argument("--no-picture", action="store_true", help="write no picture")
    how.add_argument("--no-progress", action="store_true", help="show no progress bar")


def _add_budget(parser: argparse.ArgumentParser) -> None:
    shared = parser.add_argument_group(
        "error budget",
        "Standard deviations of errors that many targets share. They do not average out, so that\n"
        "covariances without them are too small. The default of each is that of the data set,\n"
        "or zero for a log.",
    )
    shared.add_argument(
        "--budget-azimuth", type=float, metavar="DEG", help="of each sensor's azimuth and mounting"
    )
    shared.add_argument(
        "--budget-doppler", type=float, metavar="M/S", help="of all Doppler velocities of a scan"
    )
    shared.add_argument(
        "--budget-scale", type=float, metavar="SHARE", help="relative, of all Doppler velocities"
    )
    shared.add_argument(
        "--budget-lag", type=float, metavar="S", help="of the scans' time stamps (a common delay)"
    )
    shared.add_argument(
        "--budget-neighbours",
        type=float,
        metavar="M",
        help="length over which the position errors of neighbouring targets are correlated",
    )
    shared.add_argument(
        "--no-budget",
        action="store_true",
        help="use the inverse Hessian of the cost as the covariance, which does not contain shared "
        "errors; not together with the options above",
    )


def _check_source(parser: argparse.ArgumentParser, arguments: argparse.Namespace) -> None:
    """Leave with a message if an option of the source is missing, or one of another is given."""
    for source, options in _OF_SOURCE.items():
        chosen = getattr(arguments, source) is not None
        for option in options:
            given = getattr(arguments, option) is not None
            flag = f"--{option.replace('_', '-')}"
            if given and not chosen:
                parser.error(f"{flag} belongs to --{source}")
            if chosen and not given and option in _NEEDED:
                parser.error(f"--{source} needs {flag}; see {PROGRAM} track --help")


def _check_budget(parser: argparse.ArgumentParser, arguments: argparse.Namespace) -> None:
    """Leave with a message if a budget is both given and refused."""
    given = [name for name in _BUDGET if getattr(arguments, f"budget_{name}") is not None]
    if arguments.no_budget and given:
        parser.error(f"--no-budget contradicts --budget-{given[0]}: leave one of them out")


# ---- Reading


def _source(arguments: argparse.Namespace) -> Source:
    """The source that the arguments name, with the extent and the budget that they give."""
    if arguments.csv is not None:
        sensors, budget = _of_csv(arguments), ErrorBudget()
    else:
        recordings = _recordings(arguments)
        sensors = [(each.scans, each.mounting) for each in recordings]
        budget = recordings[0].budget or ErrorBudget()
    if arguments.extent is not None:
        sensors = [
            ([scan.with_extent(arguments.extent) for scan in scans], mounting)
            for scans, mounting in sensors
        ]
    given = {name: getattr(arguments, f"budget_{name}") for name in _BUDGET}
    if given["azimuth"] is not None:
        given["azimuth"] = np.deg2rad(given["azimuth"])
    known = {name: value for name, value in given.items() if value is not None}
    return Source(sensors, replace(budget, **known))


def _check_once(names: Sequence[object]) -> None:
    """Raise a ValueError if a sensor would count twice."""
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise ValueError(f"{twice[0]} is given twice")


def _recordings(arguments: argparse.Namespace) -> list[Recording]:
    _check_once(arguments.sensor or arguments.channel)
    if arguments.radarscenes is not None:
        return [
            load_radarscenes(arguments.radarscenes, arguments.sequence, sensor)
            for sensor in arguments.sensor
        ]
    return [
        load_nuscenes(arguments.nuscenes, arguments.scene, channel) for channel in arguments.channel
    ]


def _of_csv(arguments: argparse.Namespace) -> list[tuple[list[RadarScan], Mounting]]:
    _check_once([name for name, *_ in arguments.mounting])
    mountings = {}
    for name, *numbers in arguments.mounting:
        try:
            x, y, yaw = map(float, numbers)
            mountings[name] = Mounting(x, y, np.deg2rad(yaw))
        except ValueError as error:
            raise ValueError(f"--mounting {name} {' '.join(numbers)}: {error}") from None
    angle = arguments.sigma_azimuth
    scans = load_csv(
        arguments.csv,
        degrees=bool(arguments.degrees),
        sigma_range=arguments.sigma_range,
        sigma_azimuth=None if angle is None else float(np.deg2rad(angle)),
        sigma_doppler=arguments.sigma_doppler,
    )
    if scans.keys() != mountings.keys():
        raise ValueError(
            f"the sensors of {arguments.csv} are {', '.join(sorted(scans))}, but --mounting names "
            f"{', '.join(sorted(mountings))}; each needs one --mounting NAME X Y YAW"
        )
    return [(scans[name], mountings[name]) for name in scans]


# ---- Estimating and writing


def _track(arguments: argparse.Namespace) -> None:
    source = _source(arguments)
    prefix = _prefix(arguments.output)
    options = {
        "baseline": arguments.baseline,
        "horizon": arguments.horizon,
        "max_interval": arguments.max_interval,
        "budget": None if arguments.no_budget else source.budget,
        "progress": False if arguments.no_progress else None,
        "side_slip": _side_slip(arguments.side_slip),
        "limits": VehicleLimits(acceleration=arguments.max_acceleration),
    }
    count = sum(len(scans) for scans, _ in source.sensors)
    several = "s" * (len(source.sensors) > 1)
    print(f"read {count} scans of {len(source.sensors)} sensor{several}", flush=True)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", UserWarning)
        driven = track(source.sensors, **options)
    for each in said:
        print(f"{PROGRAM}: warning: {each.message}", file=sys.stderr)
    print(driven)
    if not driven.converged.any():
        raise ValueError("no estimate was accepted, so nothing was written")
    for path in _write(driven, prefix, picture=not arguments.no_picture):
        print(f"wrote {path}")


def _side_slip(sigma: float | None) -> bool | float:
    """The value of the option ``side_slip`` for a standard deviation of v_y, or for none."""
    if sigma is None:
        return True
    if not 0.0 <= sigma < math.inf:
        raise ValueError(f"--side-slip must be a number from 0 on, but is {sigma:g}")
    return sigma or False


def _prefix(output: str) -> Path:
    """The beginning of the files' names; raises an OSError if they could not be written."""
    path = check_path("output", output)
    if output.endswith(("/", os.sep)) or path.is_dir():
        path = path / "track"
    there = next(folder for folder in path.absolute().parents if folder.exists())
    if not there.is_dir() or not os.access(there, os.W_OK):
        raise OSError(f"--output {output}: {there} is not a writable folder")
    for file in _files(path):
        if file.is_dir():
            raise IsADirectoryError(f"--output {output}: {file} is a folder")
    return path


def _files(prefix: Path) -> list[Path]:
    """The path, the velocities, all of the track, the picture."""
    ends = (".tum", "_velocities.txt", ".npz", ".png")
    return [prefix.with_name(f"{prefix.name}{end}") for end in ends]


def _write(driven: Track, prefix: Path, *, picture: bool) -> list[Path]:
    """Write all files aside, and move them to their places only when all are complete."""
    prefix.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".", suffix=".part", dir=prefix.parent) as folder:
        aside = _files(Path(folder) / prefix.name)
        tum, velocities, everything, drawn = aside
        driven.write_tum(tum)
        driven.write_velocities(velocities)
        driven.save(everything)
        if picture:
            _draw(driven, drawn)
        pairs = [pair for pair in zip(aside, _files(prefix), strict=True) if pair[0].exists()]
        for part, path in pairs:
            os.replace(part, path)
    return [path for _, path in pairs]


def _draw(driven: Track, path: Path) -> None:
    try:
        figure = driven.plot()
    except ModuleNotFoundError as error:
        print(f"{PROGRAM}: no picture: {error} (pip install matplotlib)", file=sys.stderr)
        return
    from matplotlib import pyplot as plt

    figure.savefig(path, dpi=150)
    plt.close(figure)


def _write_example(file: str) -> None:
    drive = simulate_drive(np.random.default_rng(0), duration=60.0)
    write_csv(file, {"radar": drive.scans})
    place = drive.mounting
    print(f"wrote {file}, a minute of a simulated robot; now try")
    print(
        f"  {PROGRAM} track --csv {file} "
        f"--mounting radar {place.x:g} {place.y:g} {np.rad2deg(place.yaw):g}"
    )
