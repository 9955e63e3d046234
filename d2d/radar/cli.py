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

import numpy as np

from d2d._checks import check_path
from d2d.radar.readers import READERS
from d2d.radar.readers.csv_log import write_csv
from d2d.radar.readers.reader import Source
from d2d.radar.simulation.drive import simulate_drive
from d2d.radar.tracks.limits import VehicleLimits
from d2d.radar.tracks.rounds import MAX_INTERVAL
from d2d.radar.tracks.track import Track
from d2d.radar.tracks.tracker import track

PROGRAM = "python -m d2d.radar"

_MAX_ACCELERATION = VehicleLimits().acceleration

# Of the error budget: the unit, and what each is the standard deviation of.
BUDGET = {
    "azimuth": ("DEG", "of each sensor's azimuth and mounting"),
    "doppler": ("M/S", "of all Doppler velocities of a scan"),
    "scale": ("SHARE", "relative, of all Doppler velocities"),
    "lag": ("S", "of the scans' time stamps (a common delay)"),
    "neighbours": (
        "M",
        "length over which the position errors of neighbouring targets are correlated",
    ),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line with these arguments, by default those of the process.

    Returns the exit status: 0 on success, 1 on failure, 130 if interrupted; what was wrong is
    written to the standard error.  Raises a ``SystemExit`` with status 2 if the arguments are
    wrong, with 0 after ``--help``.
    """
    parser, of_track = _parsers()
    arguments = parser.parse_args(argv)
    try:
        if arguments.command == "example":
            _write_example(arguments.file)
        else:
            _check_options(of_track, arguments)
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
    which = parser.add_argument_group("what to read (one of them)")
    source = which.add_mutually_exclusive_group(required=True)
    groups: dict[str, argparse._ArgumentGroup] = {}
    for reader in READERS.values():
        source.add_argument(f"--{reader.name}", metavar=reader.metavar, help=reader.about)
    for reader in READERS.values():
        if reader.heading not in groups:
            groups[reader.heading] = parser.add_argument_group(reader.heading)
        for option in reader.options:
            groups[reader.heading].add_argument(
                _flag(option.name), help=option.help, **option.parsing
            )


def _add_estimation(parser: argparse.ArgumentParser) -> None:
    how = parser.add_argument_group("how to estimate and what to write")

    def add(name: str, metavar: str, kind: type = float, default: object = None) -> None:
        how.add_argument(name, type=kind, default=default, metavar=metavar, help=ABOUT[name])

    add("--output", "PREFIX", str, "track")
    add("--baseline", "N", int, 1)
    add("--horizon", "S")
    add("--extent", "M")
    add("--side-slip", "M/S")
    add("--max-acceleration", "M/S^2", default=_MAX_ACCELERATION)
    add("--max-interval", "S", default=MAX_INTERVAL)
    how.add_argument("--no-picture", action="store_true", help="write no picture")
    how.add_argument("--no-progress", action="store_true", help="show no progress bar")


def _add_budget(parser: argparse.ArgumentParser) -> None:
    shared = parser.add_argument_group(
        "error budget",
        "Standard deviations of errors that many targets share. They do not average out, so that\n"
        "covariances without them are too small. The default of each is that of the data set,\n"
        "or zero for a log.",
    )
    for name, (unit, what) in BUDGET.items():
        shared.add_argument(f"--budget-{name}", type=float, metavar=unit, help=what)
    shared.add_argument(
        "--no-budget",
        action="store_true",
        help="use the inverse Hessian of the cost as the covariance, which does not contain shared "
        "errors; not together with the options above",
    )


def _flag(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _check_options(parser: argparse.ArgumentParser, arguments: argparse.Namespace) -> None:
    """Leave with a message if an option is missing, or does not go with another."""
    for reader in READERS.values():
        chosen = getattr(arguments, reader.name) is not None
        for option in reader.options:
            given = getattr(arguments, option.name) is not None
            if given and not chosen:
                parser.error(f"{_flag(option.name)} belongs to --{reader.name}")
            if chosen and option.needed and not given:
                parser.error(
                    f"--{reader.name} needs {_flag(option.name)}; see {PROGRAM} track --help"
                )
    for name in BUDGET if arguments.no_budget else ():
        if getattr(arguments, f"budget_{name}") is not None:
            parser.error(f"--no-budget contradicts --budget-{name}: leave one of them out")


def _source(arguments: argparse.Namespace) -> Source:
    """The source that the arguments name, with the extent and the budget that they give."""
    options = vars(arguments)
    reader = next(each for name, each in READERS.items() if options[name] is not None)
    sensors, budget = reader.read(options[reader.name], options)
    if arguments.extent is not None:
        sensors = {
            name: ([scan.with_extent(arguments.extent) for scan in scans], mounting)
            for name, (scans, mounting) in sensors.items()
        }
    given = {name: options[f"budget_{name}"] for name in BUDGET}
    if given["azimuth"] is not None:
        given["azimuth"] = math.radians(given["azimuth"])
    known = {name: value for name, value in given.items() if value is not None}
    return Source(sensors, replace(budget, **known))


# ---- Estimating and writing


def _track(arguments: argparse.Namespace) -> None:
    sensors, budget = _source(arguments)
    prefix = _prefix(arguments.output)
    count = sum(len(scans) for scans, _ in sensors.values())
    print(f"read {count} scans of {len(sensors)} sensor{'s' * (len(sensors) > 1)}", flush=True)
    slip = arguments.side_slip
    if slip is not None and not 0.0 <= slip < math.inf:
        raise ValueError(f"--side-slip must be a number from 0 on, but is {slip:g}")
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", UserWarning)
        driven = track(
            sensors,
            baseline=arguments.baseline,
            horizon=arguments.horizon,
            max_interval=arguments.max_interval,
            budget=None if arguments.no_budget else budget,
            progress=False if arguments.no_progress else None,
            side_slip=True if slip is None else slip or False,
            limits=VehicleLimits(acceleration=arguments.max_acceleration),
        )
    for each in said:
        print(f"{PROGRAM}: warning: {each.message}", file=sys.stderr)
    print(driven)
    if not driven.converged.any():
        raise ValueError("no estimate was accepted, so nothing was written")
    for path in _write(driven, prefix, picture=not arguments.no_picture):
        print(f"wrote {path}")


def _prefix(output: str) -> Path:
    """The beginning of the files' names; raises an OSError if they could not be written."""
    path = check_path("output", output)
    if output.endswith(("/", os.sep)) or path.is_dir():
        path = path / "track"
    there = next(folder for folder in path.absolute().parents if folder.exists())
    if not there.is_dir() or not os.access(there, os.W_OK):
        raise OSError(f"--output {output}: {there} is not a writable folder")
    return path


def _files(prefix: Path) -> list[Path]:
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


# ---- The text of the help

HELP = f"""\
Estimates how a vehicle moved from the measurements of its Doppler radars.

A first try, with a simulated log that the program writes itself:

  {PROGRAM} example log.csv
  {PROGRAM} track --csv log.csv --mounting radar 0.4 0 0 --output drive

Help on each command: {PROGRAM} track --help
"""

TRACK_HELP = """\
Estimates the velocity of a vehicle from one radar or several, integrates it to a path, and writes

  PREFIX.tum              the path, a line "t x y z qx qy qz qw" per pose, for evo and others
  PREFIX_velocities.txt   v_x, v_y, omega and their covariances; its header names the columns
  PREFIX.npz              everything, for d2d.radar.Track.load
  PREFIX.png              a picture (if matplotlib is installed)

Either all of them are written at the end or none. The first run compiles for up to a minute.
"""

ABOUT = {
    "--output": "beginning of the files' names (default: track); if it is a folder or ends with /, "
    "the files are called track.* in it",
    "--baseline": "register each scan with the Nth before (default: 1); 2 or 3 make the yaw rate "
    "more accurate where the motion is smooth",
    "--horizon": "instead of --baseline: register each scan with the one nearest to S seconds "
    "before; 0.3 is a good choice on the road",
    "--extent": "how far reflections wander on objects from scan to scan, as a standard deviation "
    "(default: the data set's own, or 0 for a log)",
    "--side-slip": "standard deviation of the sideways velocity of the vehicle's origin about "
    "zero; 0 if it never moves sideways, as the middle of a rear axle that does not slip "
    "(default: unknown). It helps a single radar most: the yaw rate becomes more accurate",
    "--max-acceleration": "estimates that need a larger acceleration are not accepted (default: "
    f"{_MAX_ACCELERATION:g}, somewhat beyond a car's)",
    "--max-interval": f"longest usual time between two scans (default: {MAX_INTERVAL:g})",
}

DATA_SETS = "\n".join(
    f"    {PROGRAM} track --{each.name} ROOT {_flag(each.options[0].name)} {each.trial[0]} "
    f"{_flag(each.options[1].name)} {' '.join(map(str, each.trial[1]))}"
    for each in READERS.values()
    if each.trial
)

TRACK_EPILOG = f"""\
A CSV file has a line for each target and a first line that names the columns:

  time,sensor,range,azimuth,doppler,sigma_range,sigma_azimuth,sigma_doppler
  12.05,front,14.21,-0.31,-8.92,0.15,0.009,0.06

  time            s; lines with equal time and sensor are one scan
  sensor          a name; without this column there is one sensor, called "radar"
  range           m
  azimuth         rad (with --degrees: degrees), 0 along the boresight, counter-clockwise positive
  doppler         m/s, positive if the target moves away: ahead of a moving car it is negative
  sigma_...       standard deviations in the same units; or --sigma-range and so on for all targets

Columns may come in any order; others are ignored. If in doubt, use the standard deviations of the
sensor's data sheet. If the sensor rounds its values to steps, add the variance step^2 / 12.

Where a sensor sits: x forward and y left of the vehicle's origin (best the middle of the rear axle)
in m, and the direction of its boresight in degrees, counter-clockwise from straight ahead.

examples:
  one radar at the front bumper, standard deviations for all targets:
    {PROGRAM} track --csv log.csv --degrees --mounting radar 3.7 0 0 \\
        --sigma-range 0.15 --sigma-azimuth 0.5 --sigma-doppler 0.06

  two corner radars together, each scan with the one 0.3 s before, errors that targets share:
    {PROGRAM} track --csv log.csv --mounting left 3.6 0.8 45 --mounting right 3.6 -0.8 -45 \\
        --horizon 0.3 --budget-azimuth 0.2 --budget-doppler 0.04 --output results/drive

  a single side radar of a car that does not slip sideways:
    {PROGRAM} track --csv log.csv --mounting left 3.6 0.8 90 --side-slip 0.05

  data sets in their own layout:
{DATA_SETS}

What is printed at the end says how many estimates were accepted, and why the others were not:

  a scan without targets          nothing to estimate; the path continues with the last velocity
  a scan that repeats an ...      the sensor froze, or its message was delivered twice
  no optimum near the start       too few targets are seen in both scans: more sensors
  an optimum that rejects ...     scans do not fit each other: too small standard deviations, a
                                  wrong mounting, azimuths of the wrong sign
  an optimum that rests on ...    too few targets agree: --side-slip, more sensors
  a yaw rate with a sigma of ...  the targets tell too little: --horizon 0.3, --side-slip
  a velocity with a sigma of ...  few targets agree, or they move: more sensors
  the first scan after a gap      nothing near enough to register it with
  a turn of ... between scans     times in another unit than s, or a much too long --horizon
  a side slip, an acceleration,   no vehicle moves like that: a wrong optimum, or a wrong mounting
  a speed or a yaw rate of ...    if it is most of them

If the path runs backwards, the sign of the Doppler velocities or the yaw of a mounting is wrong; if
it bends the wrong way, the sign of the azimuths. The book's pages "Your own radar" and "When a path
looks wrong" explain how to choose standard deviations and a budget, and how to test a
covariance.
"""
