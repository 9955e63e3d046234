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
from string import Template
from typing import Any, TextIO

import numpy as np

import d2d
from d2d._checks import check_path
from d2d.radar.evaluation.calibrate import calibrate
from d2d.radar.evaluation.compare import check_reference, compare
from d2d.radar.evaluation.diagnose import Finding, agreement, diagnose, of_gyro
from d2d.radar.files import brief, write_together
from d2d.radar.live import estimates_of
from d2d.radar.readers import READERS
from d2d.radar.readers.bag import write_bag
from d2d.radar.readers.csv_log import load_csv, write_csv
from d2d.radar.readers.odometry import load_gyro, load_reference
from d2d.radar.readers.reader import Source, mountings_of, options_of
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
ROBOT = {"speed": 10.0, "yaw_rate": 6.0, "yaw_acceleration": 15.0, "uncertainty": 0.3}
VEHICLES: dict[str, dict[str, float]] = {
    "car": {},
    "robot": ROBOT,
    "omni": ROBOT | {"speed": 30.0, "yaw_rate_of_slip": math.inf},
    "train": {"speed": 150.0, "yaw_rate": 0.3, "acceleration": 4.0, "yaw_acceleration": 0.3},
}
GATES = ("range", "azimuth", "elevation")
OF_SCANS = ("mounting", *SIGMAS, "degrees")
# The options of `VehicleLimits`, by their names there.
LIMITS = {field.name: f"max_{field.name}" for field in fields(VehicleLimits)}
LIMITS |= {"uncertainty": "max_yaw_rate_sigma", "speed_uncertainty": "max_speed_sigma"}

# Arguments of `ArgumentParser.add_argument`, by the option's name in Python.
Options = dict[str, dict[str, Any]]
_OPTION = re.compile(r"^--(\S+)((?: \S+)*)  +(.+(?:\n .+)*)", re.MULTILINE)
_SECTION = re.compile(r"^# (command|reader|options) (.+?): (.+)\n((?:(?!# ).*\n)+)", re.MULTILINE)
_UNITS = ("S", "M", "DEG", "DB", "SHARE", "M/S", "DEG/S", "M/S^2", "DEG/S^2")


def _help() -> str:
    """The text of `commands.txt`, with the columns of a log as the documentation says them."""
    text = Path(__file__).with_name("commands.txt").read_text(encoding="utf-8")
    return Template(text).substitute(
        program=PROGRAM,
        log="\n\n".join((inspect.getdoc(load_csv) or "").replace("``", "").split("\n\n")[1:3]),
        vehicles="|".join(VEHICLES),
        horizon=f"{HORIZON:g}",
        max_interval=f"{MAX_INTERVAL:g}",
        gyro_sigma=f"{math.degrees(Gyro().sigma):g}",
        gyro_bias=f"{math.degrees(Gyro().bias):g}",
    )


def _radians(word: str) -> float:
    return math.radians(float(word))


def _pairs(words: str) -> dict[str, str]:
    return dict(pair.partition("=")[::2] for pair in words.split(",") if pair)


def option_table(table: str) -> Options:
    """Return the options of lines "--name METAVAR  what it is", by name in Python.

    A METAVAR that is a unit stands for a number, which becomes one in rad if it is in degrees, N
    for a whole number, a|b for a choice, ... for several values; =1 is a default.  An option
    without one is a flag, which is None if not given.  One whose values have several names and dots
    may be given several times.
    """
    found: Options = {}
    for name, metavars, text in _OPTION.findall(table):
        words = metavars.replace("...", "").split() or [""]
        metavar, _, default = words[0].partition("=")
        real = _radians if metavar.startswith("DEG") else float
        kind: Any = real if metavar in _UNITS else {"N": int, "PAIRS": _pairs}.get(metavar, str)
        how: dict[str, Any] = {"type": kind, "default": kind(default) if default else None}
        if "|" in metavar:
            how["choices"] = metavar.split("|")
        elif metavar:
            how["metavar"] = metavar if len(words) == 1 else (metavar, " ".join(words[1:]))
        else:
            how = {"action": "store_true", "default": None}
        if "..." in metavars or len(words) > 1:
            how["nargs"] = "+" if "..." in metavars else len(words)
        if "..." in metavars and len(words) > 1:
            how["action"] = "append"
        found[name.replace("-", "_")] = how | {"help": " ".join(text.split())}
    return found


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
    """Print each warning of a block as a line on the standard error."""

    def show(message: Warning | str, *_where: object) -> None:
        _complain(f"warning: {message}")

    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        warnings.simplefilter("ignore", DeprecationWarning)  # of libraries beneath
        warnings.showwarning = show  # type: ignore[assignment]
        yield


@contextmanager
def _compiling() -> Iterator[bool]:
    """Say on a terminal that a block compiles, if that takes long; yield whether it is one."""
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
    plain: dict[str, Any] = {"formatter_class": argparse.RawDescriptionHelpFormatter}
    text = _help()
    parser = argparse.ArgumentParser(PROGRAM, description=text.partition("\n# ")[0], **plain)
    parser.add_argument("--version", action="version", version=f"d2d {d2d.__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    added: dict[str, argparse.ArgumentParser] = {}
    owners: dict[str, list[str]] = {}
    for kind, among, title, body in _SECTION.findall(text):
        names, options = among.split(), option_table(body)
        if kind == "command":
            about, _, epilog = body.partition("---\n")
            texts: dict[str, Any] = {"help": title, "description": about, "epilog": epilog}
            added[among] = commands.add_parser(among, **texts, **plain, allow_abbrev=False)
            added[among].set_defaults(run=RUN[among], error=added[among].error, owners=owners)
            _add_files(among, added[among])
        elif kind == "options":
            for name in names:
                _add(added[name], title, options, "odometry", about=body.partition("--")[0])
        else:
            for name in options:
                owners.setdefault(name, []).extend(map(_flag, names))
            _add(added["track"], title, options)
            if "csv" in names:
                _add(added["calibrate"], title, options, "mounting")
                of_scans = {name: how for name, how in options.items() if name in OF_SCANS}
                _add(added["live"], title, of_scans, "mounting")
    return parser


def _add_files(command: str, parser: argparse.ArgumentParser) -> None:
    """Add what a command reads or writes."""
    files: Options = {
        name: {"metavar": reader.metavar, "help": reader.about, "action": reader.action}
        for name, reader in READERS.items()
    }
    if command == "track":
        group = parser.add_argument_group("what to read (one of them)")
        source = group.add_mutually_exclusive_group(required=True)
        for name, how in files.items():
            source.add_argument(_flag(name), **how)
    elif command == "calibrate":
        _add(parser, "what to read", {"csv": files["csv"]}, "csv")
    elif command == "compare":
        parser.add_argument("track", metavar="TRACK", help="PREFIX.npz")
        parser.add_argument("reference", metavar="REFERENCE", help="as the --odometry of calibrate")
    elif command == "example":
        about = "the CSV file; an existing one is replaced"
        parser.add_argument("file", metavar="FILE", help=about)


def _add(
    parser: argparse.ArgumentParser, heading: str, table: Options, *needed: str, about: str = ""
) -> None:
    """Add a group of options, of which some are needed."""
    group = parser.add_argument_group(heading, about.strip() or None)
    for name, how in table.items():
        group.add_argument(_flag(name), required=name in needed, **how)


def _flag(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _check_options(arguments: argparse.Namespace) -> None:
    """Leave with a message if an option of a reader is missing, or belongs to another one."""
    options, error = vars(arguments), arguments.error
    chosen = next(each for name, each in READERS.items() if options[name] is not None)
    for name, owners in arguments.owners.items():
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
    gates = {name: options[name] for name in GATES}
    extent = options.get("extent")

    def used(scan: RadarScan) -> RadarScan:
        kept = scan.within(**gates)
        return kept if extent is None else kept.with_extent(extent)

    return {name: ([*map(used, scans)], at) for name, (scans, at) in sensors.items()}, budget


def _options(arguments: argparse.Namespace, budget: ErrorBudget) -> dict[str, Any]:
    """The options of `track` and `Tracker` that the arguments give."""
    given = {name: value for name, value in vars(arguments).items() if value is not None}
    shared = {n.removeprefix("budget_"): given[n] for n in given if n.startswith("budget_")}
    limits = {name: given[option] for name, option in LIMITS.items() if option in given}
    gyro = {name: given[f"gyro_{name}"] for name in ("sigma", "bias") if f"gyro_{name}" in given}
    if "gyro" in given:
        gyro["times"], gyro["yaw_rates"] = load_gyro(arguments.gyro, arguments.gyro_topic)
    elif (gyro or "gyro_topic" in given) and arguments.command == "track":
        raise ValueError("--gyro-sigma, --gyro-bias and --gyro-topic need --gyro FILE")
    return {
        "baseline": arguments.baseline,
        "horizon": arguments.horizon,
        "budget": replace(ErrorBudget() if arguments.no_budget else budget, **shared),
        "side_slip": given.get("side_slip", True) or False,
        "limits": VehicleLimits(**VEHICLES[arguments.vehicle] | limits),
        "gyro": Gyro(**gyro) if gyro else None,
    }


# ---- What the commands do


def _track(arguments: argparse.Namespace) -> int:
    _check_options(arguments)
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
            with suppress(ValueError):  # too few scans
                alone[name] = track(sensor, **options, progress=False)
        free = options | {"gyro": None}
        without = driven if options["gyro"] is None else track(sensors, **free, progress=False)
    for (first, one), (second, other) in itertools.combinations(alone.items(), 2):
        anees = agreement(one, other)
        known = "unknown" if np.isnan(anees) else f"{anees:.1f}"
        print(f"ANEES of the differences between {first} and {second} (ideally 1): {known}")
    found = [*diagnose(sensors, driven, alone), *of_gyro(driven, without)]
    if found:
        print('what looks wrong, by the rows of the page "When a path looks wrong":')
        print("\n".join(f"  {_plain(finding)}" for finding in found), flush=True)
    return found


def _live(arguments: argparse.Namespace) -> None:
    if sys.stdin is None or sys.stdout is None:
        raise ValueError("live needs the standard input and output, but one of them is closed")
    with _compiling():
        options = _options(arguments, ErrorBudget())
        tracker = Tracker(mountings_of(vars(arguments)), keep=1, **options)
        gc.freeze()  # no round waits for a collection of all that Numba holds
    if isinstance(sys.stdin, io.TextIOWrapper):
        # JSON is UTF-8, which may begin with a mark; a wrong byte is one wrong line
        sys.stdin.reconfigure(encoding="utf-8-sig", errors="replace")

    given = {"degrees": bool(arguments.degrees), **options_of(vars(arguments))}
    gates = {name: getattr(arguments, name) for name in GATES}
    for line in estimates_of(sys.stdin, tracker, _complain, gates, **given):
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


def _example(arguments: argparse.Namespace) -> None:
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
RUN: dict[str, Callable[[Any], int | None]] = {
    run.__name__.strip("_"): run for run in (_track, _live, _calibrate, _compare, _example)
}
