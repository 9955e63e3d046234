"""The command line `python -m d2d.radar`: tracks from logs and data sets, written to files."""

import argparse
import gc
import inspect
import io
import itertools
import math
import os
import re
import shlex
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, TextIO

import numpy as np

import d2d
from d2d._checks import check_path
from d2d.radar.evaluation.calibrate import calibrate
from d2d.radar.evaluation.compare import check_reference, compare
from d2d.radar.evaluation.diagnose import Finding, agreement, diagnose
from d2d.radar.files import write_together
from d2d.radar.live import LINES, estimates_of
from d2d.radar.readers import READERS
from d2d.radar.readers.bag import write_bag
from d2d.radar.readers.csv_log import load_csv, write_csv
from d2d.radar.readers.odometry import load_gyro, load_reference
from d2d.radar.readers.reader import Options, Source, mountings_of, option_table, options_of
from d2d.radar.readers.shared import brief
from d2d.radar.report import png_of, report_page
from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.scans.reference import Reference
from d2d.radar.scans.scan import SIGMAS, Mounting, RadarScan
from d2d.radar.simulation.drive import simulate_drive
from d2d.radar.tracks.gyro import Gyro
from d2d.radar.tracks.limits import VehicleLimits
from d2d.radar.tracks.rounds import HORIZON, MAX_INTERVAL, SensorScans
from d2d.radar.tracks.track import Track
from d2d.radar.tracks.tracker import Tracker, track

PROGRAM = "python -m d2d.radar"

# Limits of vehicles that are not a car's.
VEHICLES: dict[str, dict[str, float]] = {
    "car": {},
    "robot": {"speed": 10.0, "yaw_rate": 6.0, "yaw_acceleration": 15.0, "uncertainty": 0.3},
    "omni": {
        **{"speed": 30.0, "yaw_rate": 6.0, "yaw_acceleration": 15.0, "uncertainty": 0.3},
        "yaw_rate_of_slip": math.inf,
    },
    "train": {"speed": 150.0, "yaw_rate": 0.3, "acceleration": 4.0, "yaw_acceleration": 0.3},
}

# ---- The options, as `option_table` reads them

GATES = option_table("""
--range M M          targets between these ranges
--azimuth DEG DEG    targets between these azimuths in the sensor's frame
--elevation DEG DEG  targets between these elevations in the sensor's frame
""")
ESTIMATION = option_table(f"""
--horizon S    register each scan with the one nearest to S seconds before (default: {HORIZON:g})
--baseline N   register each scan with the Nth before, instead of --horizon
--side-slip M/S  standard deviation of the sideways velocity of the vehicle's origin about zero; 0
               if it never moves sideways, as the middle of a rear axle that does not slip (default:
               unknown). It helps a single radar most: v_y and the heading become more accurate
--vehicle {"|".join(VEHICLES)}=car  what the vehicle can do, for the limits below (default: car); an
               omni moves sideways, too
""")
# In the order of the fields of `VehicleLimits`; an estimate beyond one is not accepted.
LIMITS = option_table("""
--max-speed M/S                 of the vehicle's origin; this and the following may be inf
--max-yaw-rate DEG/S            of the vehicle
--max-acceleration M/S^2        along and across
--max-yaw-acceleration DEG/S^2  of the vehicle
--max-yaw-rate-sigma DEG/S      of an estimate's own standard deviation
--max-speed-sigma M/S           of an estimate's own standard deviation
--max-yaw-rate-of-slip DEG/S    by which the yaw rate may change if v_y is taken as zero
""")
GYRO = option_table(f"""
--gyro-sigma DEG/S  of a single yaw rate's noise (default: {math.degrees(Gyro().sigma):g})
--gyro-bias DEG/S   of the gyro's bias, which is learnt (default: {math.degrees(Gyro().bias):g})
""")
OF_LOGS = option_table(f"""
--gyro FILE         yaw rates of a gyro by the radars' clock: a CSV file with time (s) and yaw_rate
                    (rad/s, counter-clockwise) or yaw_rate_deg, or a bag with Imu
--gyro-topic TOPIC  of a gyro in a bag (default: its only one)
--extent M          how far reflections wander on objects from scan to scan, as a standard deviation
                    (default: the data set's own, or 0 for a log)
--max-interval S={MAX_INTERVAL:g}  longest usual time between two scans (default: {MAX_INTERVAL:g})
""")
OUTPUT = option_table("""
--output PREFIX=track  beginning of the files' names (default: track); if it is a folder or ends
                       with /, the files are called track.* in it
--report PAGE.html     also write a page with path, velocities, residuals, findings and settings
--output-bag BAG       also write messages Odometry and TwistWithCovarianceStamped to a bag of ROS 1
                       (a file .bag) or of ROS 2 (a folder)
--force                write the files even if they are surely of no use, or too few estimates were
                       accepted in a row (status 3)
--no-picture           write no picture
--no-progress          show no progress bar
""")
# Standard deviations of an `ErrorBudget`.
BUDGET = option_table("""
--budget-azimuth DEG   of each sensor's azimuth and mounting
--budget-doppler M/S   of all Doppler velocities of a scan
--budget-scale SHARE   relative, of all Doppler velocities
--budget-lag S         of the scans' time stamps (a common delay)
--budget-neighbours M  length over which the position errors of neighbouring targets are correlated
""")
NO_BUDGET = option_table("--no-budget  state none of these errors but those that are given")
REFERENCE = option_table("""
--odometry FILE  a TUM trajectory (t x y z qx qy qz qw), or a CSV file with the columns time (s),
                 speed (m/s) and yaw_rate (rad/s) or yaw_rate_deg (deg/s), or a bag with Odometry or
                 TwistWithCovariance
--topic TOPIC    of a reference that is a bag (default: its only one of these types)
--max-lag S=0.5  search the lag of the clocks from -S to S (default: 0.5)
--lag S=0        how late the radars' clock is beside the reference's, as calibrate finds it
""")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line with these arguments, by default those of the process.

    Returns the exit status: 0 on success, 1 on failure, 3 if a path is refused, 130 if interrupted;
    what was wrong is written to the standard error.  Raises a ``SystemExit`` with status 2 if the
    arguments are wrong, with 0 after ``--help``.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal may know no letters beyond ASCII
            stream.reconfigure(errors="replace")
    words = sys.argv[1:] if argv is None else argv
    arguments = _parser().parse_args(words, argparse.Namespace(words=words))
    _check_options(arguments)
    try:
        with _plain_warnings():
            return int(arguments.run(arguments) or 0)
    except BrokenPipeError:  # whoever read the output has gone
        _drop_unwritten(sys.stdout)
        return 1
    except (ValueError, OSError, ModuleNotFoundError) as error:
        _complain(f"error: {error}")
        _drop_unwritten(sys.stdout)
        return 1
    except KeyboardInterrupt:
        rest = ", nothing was written" if arguments.command == "track" else ""
        _complain(f"interrupted{rest}")
        return 130  # as shells report it


@contextmanager
def _plain_warnings() -> Iterator[None]:
    """Inside, a warning is a line on the standard error."""

    def show(message: Warning | str, *_where: object) -> None:
        _complain(f"warning: {message}")

    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        warnings.simplefilter("ignore", DeprecationWarning)  # of libraries beneath
        warnings.showwarning = show  # type: ignore[assignment]
        yield


@contextmanager
def _compiling() -> Iterator[bool]:
    """Inside, say on a terminal, if it is one, what takes longer than a second and a half."""
    timer = threading.Timer(1.5, _complain, ["compiling, once on this machine, for up to a minute"])
    watched = sys.stderr is not None and sys.stderr.isatty()
    if watched:
        timer.start()
    try:
        yield watched
    finally:
        timer.cancel()


def _complain(text: str) -> None:
    """Write a line to the standard error; drop it if that cannot be written to."""
    if sys.stderr is not None:
        with suppress(OSError, ValueError):
            print(f"{PROGRAM}: {brief(_plain(text), 1000)}", file=sys.stderr)
        _drop_unwritten(sys.stderr)


def _drop_unwritten(stream: TextIO | None) -> None:
    """Close the file of a stream that cannot be written to, else Python tries again at exit."""
    if stream is None or stream.closed:
        return
    try:
        stream.flush()
    except OSError:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), stream.fileno())


def _plain(text: object) -> str:
    """A message with the log's own names of sensors."""
    return re.sub(r"sensors\['(.*?)'\]\.scans", r"\1", str(text))


def _parser() -> argparse.ArgumentParser:
    plain = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(PROGRAM, description=HELP, formatter_class=plain)
    parser.add_argument("--version", action="version", version=f"d2d {d2d.__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def command(
        name: str, about: str, run: Callable[[Any], int | None], how: str = "", epilog: str = ""
    ) -> argparse.ArgumentParser:
        texts: dict[str, Any] = {"help": about, "description": how or about, "epilog": epilog}
        added = commands.add_parser(name, **texts, formatter_class=plain, allow_abbrev=False)
        added.set_defaults(run=run, error=added.error)
        return added

    about = "estimate a drive and write its path and velocities"
    of_track = command("track", about, _track, TRACK_HELP, TRACK_EPILOG)
    which = of_track.add_argument_group("what to read (one of them)")
    source = which.add_mutually_exclusive_group(required=True)
    for reader in READERS.values():
        how: Any = {"metavar": reader.metavar, "help": reader.about, "action": reader.action}
        source.add_argument(_flag(reader.name), **how)
    # those of one heading follow each other in the table
    for heading, readers in itertools.groupby(READERS.values(), lambda reader: reader.heading):
        of_readers = {name: how for reader in readers for name, how in reader.options.items()}
        _add(of_track, heading, of_readers)
    _add(of_track, ABOUT_GATES, GATES)
    _add(of_track, "how to estimate", ESTIMATION | LIMITS | OF_LOGS | GYRO)
    _add(of_track, "what to write", OUTPUT)
    _add(of_track, ABOUT_BUDGET, BUDGET | NO_BUDGET)
    about = "estimate while scans arrive: lines of JSON in, lines of JSON out"
    live, log = command("live", about, _live, LINES), READERS["csv"]
    of_lines = {name: log.options[name] for name in ("mounting", *SIGMAS, "degrees")}
    _add(live, "options of a scan", of_lines, "mounting")
    _add(live, ABOUT_GATES, GATES)
    _add(live, "how to estimate", ESTIMATION | LIMITS | GYRO)
    _add(live, ABOUT_BUDGET, BUDGET | NO_BUDGET)
    about = "find clock, speed, slip and mounting angles by an odometry"
    calibrating = command("calibrate", about, _calibrate, CALIBRATE_HELP)
    files = {"csv": {"metavar": "FILE", "help": log.about, "action": log.action}}
    files |= {name: REFERENCE[name] for name in ("odometry", "topic", "max_lag")}
    _add(calibrating, "what to read", files, "csv", "odometry")
    _add(calibrating, log.heading, log.options, *log.needed)
    _add(calibrating, ABOUT_GATES, GATES)
    comparing = command("compare", "compare a track with a reference", _compare)
    comparing.add_argument("track", metavar="TRACK", help="PREFIX.npz")
    about = REFERENCE["odometry"]["help"]
    comparing.add_argument("reference", metavar="REFERENCE", help=about)
    _add(comparing, "options", {name: REFERENCE[name] for name in ("topic", "lag")})
    example = command("example", "write a log, simulated or real, as a CSV file", _write_example)
    about = "45 s of a Delphi ESR on a car (Apache License 2.0; see examples/esr)"
    example.add_argument("--real", action="store_true", help=about)
    example.add_argument("file", metavar="FILE", help="the CSV file; an existing one is replaced")
    return parser


def _add(parser: argparse.ArgumentParser, heading: str, table: Options, *needed: str) -> None:
    """Add a group of options, of which some are needed."""
    group = parser.add_argument_group(*heading.split(": ", 1))
    for name, how in table.items():
        group.add_argument(_flag(name), required=name in needed, **how)


def _flag(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _check_options(arguments: argparse.Namespace) -> None:
    """Leave with a message if an option is missing, or does not go with another."""
    options, error = vars(arguments), arguments.error
    if arguments.command == "track":
        chosen = next(each for name, each in READERS.items() if options[name] is not None)
        for name in {name: None for each in READERS.values() for name in each.options}:
            owners = [_flag(owner) for owner, each in READERS.items() if name in each.options]
            if options[name] is not None and _flag(chosen.name) not in owners:
                error(f"{_flag(name)} belongs to {' and '.join(owners)}")
        for name in chosen.needed:
            if options[name] is None:
                error(f"{_flag(chosen.name)} needs {_flag(name)}; see {PROGRAM} track --help")


def _source(arguments: argparse.Namespace) -> Source:
    """The source that the arguments name, with the extent and the budget that they give."""
    options = vars(arguments)
    reader = next(each for name, each in READERS.items() if options.get(name) is not None)
    sensors, budget = reader.read(options[reader.name], options)
    gates, extent = {name: options[name] for name in GATES}, options.get("extent")

    def used(scan: RadarScan) -> RadarScan:
        kept = scan.within(**gates)
        return kept if extent is None else kept.with_extent(extent)

    return {name: ([*map(used, scans)], at) for name, (scans, at) in sensors.items()}, budget


def _options(arguments: argparse.Namespace, budget: ErrorBudget) -> dict[str, Any]:
    """The options of `track` and `Tracker` that the arguments give."""
    given = {name.partition("_")[2]: getattr(arguments, name) for name in BUDGET}
    known = {name: value for name, value in given.items() if value is not None}
    slip = arguments.side_slip
    return {
        "baseline": arguments.baseline,
        "horizon": arguments.horizon,
        "budget": replace(ErrorBudget() if arguments.no_budget else budget, **known),
        "side_slip": True if slip is None else slip or False,
        "limits": _limits(vars(arguments)),
        "gyro": _gyro(vars(arguments)),
    }


def _gyro(options: dict[str, Any]) -> Gyro | None:
    """The gyro of the options, with its yaw rates if they are in a file."""
    stated = {name: options[f"gyro_{name}"] for name in ("sigma", "bias")}
    known: dict[str, Any] = {name: value for name, value in stated.items() if value is not None}
    if options.get("gyro") is not None:
        times, rates = load_gyro(options["gyro"], options["gyro_topic"])
        return Gyro(times=times, yaw_rates=rates, **known)
    if known and options["command"] == "track":
        raise ValueError("--gyro-sigma and --gyro-bias need --gyro FILE")
    return Gyro(**known) if known else None


def _limits(options: dict[str, Any]) -> VehicleLimits:
    """The limits of the vehicle that the options name, with the numbers that they give."""
    named = zip(fields(VehicleLimits), LIMITS, strict=True)
    known = {field.name: options[name] for field, name in named if options[name] is not None}
    return VehicleLimits(**VEHICLES[options["vehicle"]] | known)


# ---- What the commands do


def _track(arguments: argparse.Namespace) -> int:
    sensors, budget = _source(arguments)
    prefix = _prefix(arguments.output)
    options = {**_options(arguments, budget), "max_interval": arguments.max_interval}
    count = sum(len(scans) for scans, _ in sensors.values())
    print(f"read {count} scans of {len(sensors)} sensor{'s' * (len(sensors) > 1)}", flush=True)
    with _compiling() as watched:
        if watched:
            Tracker({"": Mounting()}, **{n: options[n] for n in options if n != "max_interval"})
    driven = track(sensors, **options, progress=False if arguments.no_progress else None)
    print(driven, flush=True)
    findings = _judge(sensors, driven, options)
    refused = [str(driven.support)] * (not driven.support.enough)
    refused += [finding.symptom for finding in findings if finding.sure]
    if refused and not arguments.force:
        _complain(f"nothing was written: {refused[0]}; --force writes the files all the same")
        return 3
    parts = driven.segments
    written: list[Path] = []
    # one beside the other where the clock steps back
    for number, part in enumerate(parts, start=1):
        own = prefix if len(parts) == 1 else prefix.with_name(f"{prefix.name}_{number}")
        written += _write(part, own, picture=not arguments.no_picture)
    if arguments.report is not None:
        settings = {"command": shlex.join(arguments.words), **options}
        named = [_plain(finding) for finding in findings]
        page = report_page(prefix.name, sensors, driven, named, settings)
        check_path("report", arguments.report).write_text(page, encoding="utf-8")
        written.append(Path(arguments.report))
    if arguments.output_bag is not None:
        write_bag(arguments.output_bag, driven)
        written.append(Path(arguments.output_bag))
    for path in written:
        print(f"wrote {path}")
    return 0


def _judge(
    sensors: dict[str, SensorScans], driven: Track, options: dict[str, Any]
) -> list[Finding]:
    """Print what speaks for and against a track, and return what looks wrong."""
    alone = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        for name, sensor in sensors.items() if len(sensors) > 1 else ():
            try:
                alone[name] = track(sensor, **options, progress=False)
            except ValueError:  # too few scans
                continue
    for (first, one), (second, other) in itertools.combinations(alone.items(), 2):
        anees = agreement(one, other)
        known = "unknown" if np.isnan(anees) else f"{anees:.1f}"
        print(f"ANEES of the differences between {first} and {second} (ideally 1): {known}")
    found = diagnose(sensors, driven, alone)
    if found:
        print('what looks wrong, by the rows of the page "When a path looks wrong":')
        print("\n".join(f"  {_plain(finding)}" for finding in found), flush=True)
    return list(found)


def _live(arguments: argparse.Namespace) -> None:
    if sys.stdin is None:
        raise ValueError("live reads scans from the standard input, which is closed")
    if sys.stdout is None:
        raise ValueError("live writes estimates to the standard output, which is closed")
    with _compiling():
        options = _options(arguments, ErrorBudget())
        tracker = Tracker(mountings_of(vars(arguments)), keep=1, **options)
        gc.freeze()  # no round waits for a collection of all that Numba holds
    if isinstance(sys.stdin, io.TextIOWrapper):
        # JSON is UTF-8, which may begin with a mark; a wrong byte is one wrong line
        sys.stdin.reconfigure(encoding="utf-8-sig", errors="replace")

    sigmas = options_of(vars(arguments))
    degrees = bool(arguments.degrees)
    gates = {name: getattr(arguments, name) for name in GATES}
    for line in estimates_of(sys.stdin, tracker, _complain, gates, degrees=degrees, **sigmas):
        print(line, flush=True)


def _calibrate(arguments: argparse.Namespace) -> None:
    sensors, _ = _source(arguments)
    odometry = load_reference(arguments.odometry, arguments.topic)
    logs = [(scans, mounting, odometry) for scans, mounting in sensors.values()]
    found = calibrate(logs, max_lag=arguments.max_lag)
    print(found)
    print("\nThe mountings for the other commands:")
    for name, mounting in zip(sensors, found.mountings, strict=True):
        yaw, *inclined = np.rad2deg([mounting.yaw, mounting.pitch, mounting.roll])
        ends = "".join(f" {angle:g}" for angle in inclined) if any(inclined) else ""
        print(f"  --mounting {name} {mounting.x:g} {mounting.y:g} {yaw:.3f}{ends}")


def _compare(arguments: argparse.Namespace) -> None:
    driven = Track.load(check_path("TRACK", arguments.track))
    known = load_reference(arguments.reference, arguments.topic)
    late = Reference(known.times + arguments.lag, known.theta, known.poses)
    found = compare(driven, late)
    check_reference(driven, late)
    print(found)
    for column, name in ((0, "speed"), (2, "yaw rate")):
        if np.isnan(known.theta[:, column]).all():
            print(f"The odometry has no {name}, which is not compared.")
    if np.isnan(known.poses).all() and not np.isnan(known.theta[:, 1]).all():
        print("The odometry has no v_y: it is compared with zero.")


def _prefix(output: str) -> Path:
    """The beginning of the files' names; raises an OSError if they could not be written."""
    path = check_path("output", output)
    if output.endswith(("/", os.sep)) or path.is_dir():
        path = path / "track"
    there = next(folder for folder in path.absolute().parents if folder.exists())
    if not there.is_dir() or not os.access(there, os.W_OK):
        raise OSError(f"--output {output}: {there} is not a writable folder")
    return path


def _write(driven: Track, prefix: Path, *, picture: bool) -> list[Path]:
    """Write all files elsewhere, and put them in their places only when all are complete."""

    def draw(path: Path) -> None:
        if picture:
            try:
                path.write_bytes(png_of(driven.plot()))
            except ModuleNotFoundError as error:
                _complain(f"no picture: {error} (pip install matplotlib)")

    writers: dict[str, Callable[[Path], None]] = {
        ".png": draw,
        ".tum": driven.write_tum,
        "_velocities.csv": driven.write_velocities,
        ".npz": driven.save,  # the whole track comes last
    }
    prefix.parent.mkdir(parents=True, exist_ok=True)
    contents = {}
    with tempfile.TemporaryDirectory() as folder:
        for end, write in writers.items():
            part = Path(folder) / f"track{end}"
            write(part)
            path = prefix.with_name(f"{prefix.name}{end}")
            contents[path] = part.read_bytes() if part.exists() else None
    write_together(contents)
    return [path for path, content in contents.items() if content is not None]


def _write_example(arguments: argparse.Namespace) -> None:
    file = arguments.file
    if arguments.real:
        places = (Path(d2d.__file__).parents[1] / "examples", Path(sys.prefix) / "share" / "d2d")
        found = [place / "esr" / "front_radar.csv.gz" for place in places]
        path = next((path for path in found if path.exists()), found[0])
        check_path("file", file).write_bytes(path.read_bytes())
        about, options = "45 s of a Delphi ESR on a car", REAL_OPTIONS
    else:
        drive = simulate_drive(np.random.default_rng(0), duration=60.0)
        write_csv(file, {"radar": drive.scans})
        x, y, yaw = drive.mounting.pose
        about = "a minute of a simulated robot"
        options = f"--mounting radar {x:g} {y:g} {np.rad2deg(yaw):g}"
    print(f"wrote {file}, {about}; now try\n  {PROGRAM} track --csv {file} {options}")


REAL_OPTIONS = (
    "--columns time=time_ns,range=track_range_m,azimuth=track_angle_rad,"
    "doppler=track_range_rate_m_per_s --scan-gap 0.01 --skip-invalid --azimuth -40 11.5 "
    "--mounting radar 3.5 0 0"
)

# ---- The text of the help

HELP = f"""\
Estimates how a vehicle moved from the measurements of its Doppler radars.

A first try, with a simulated log that the program writes itself:

  {PROGRAM} example log.csv
  {PROGRAM} track --csv log.csv --mounting radar 0.4 0 0 --output drive

Help on each command: {PROGRAM} track --help
"""

CALIBRATE_HELP = """\
Compares the Doppler velocities of static targets with an odometry, and prints the lag of the
radars' clock, the factor on the odometry's speed, the side slip, the angle to add to each mounting,
and the mountings with it.  Drive bends to both sides, and change the speed.
"""

ABOUT_GATES = "which targets to use (by default all)"
ABOUT_BUDGET = """\
error budget: Standard deviations of errors that many targets share. They do not average out, so
that covariances without them are too small. The default of each is that of the data set, or zero
for a log."""

TRACK_HELP = """\
Estimates the velocity of a vehicle from one radar or several, integrates it to a path, and writes

  PREFIX.tum              the path, a line "t x y z qx qy qz qw" per pose, for evo and others
  PREFIX_velocities.csv   v_x, v_y, omega and their covariances, a table for pandas and others
  PREFIX.npz              everything, for d2d.radar.Track.load
  PREFIX.png              a picture (if matplotlib is installed)

Either all of them are written at the end or none: PREFIX.npz is there only beside the others. Where
the clock steps back, as between two runs of a logger, each part has files of its own: PREFIX_1, ...
The first run compiles for up to a minute.
"""

# What a log holds, as the documentation says it.
LOG = "\n\n".join((inspect.getdoc(load_csv) or "").replace("``", "").split("\n\n")[1:4])
TRACK_EPILOG = f"""\
A log is a table with a line for each target.  {LOG}

As a CSV file:

  time,sensor,range,azimuth,doppler,sigma_range,sigma_azimuth,sigma_doppler
  12.05,front,14.21,-0.31,-8.92,0.15,0.009,0.06

Standard deviations are best those of the data sheet; if the sensor rounds its values to steps, add
the variance step^2 / 12.

Where a sensor sits: x forward and y left of the vehicle's origin (best the middle of the rear axle)
in m, and the direction of its boresight in degrees, counter-clockwise from straight ahead.

One radar at the front bumper of a car, standard deviations for all targets:

  {PROGRAM} track --csv log.csv --degrees --mounting radar 3.7 0 0 --side-slip 0.05 \\
      --sigma-range 0.15 --sigma-azimuth 0.5 --sigma-doppler 0.06

The book's pages "Your own radar" and "When a path looks wrong" explain which options logs of other
forms need, with a stamp for each target, in two files or in a bag, how to choose standard
deviations and a budget, how to test a covariance, what the reasons of estimates that were not
accepted mean, and what mistakes with a log look like.
"""
