"""Registry entry of a reader, for the command line, the docs and the tests."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from d2d.radar.readers.table import number
from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.scans.reference import Recording
from d2d.radar.scans.scan import SIGMAS, Mounting, RadarScan

# Arguments of `ArgumentParser.add_argument`, by the option's name in Python.
Options = dict[str, dict[str, Any]]
_ROW = re.compile(r"^--(\S+)((?: \S+)*)  +(.+(?:\n .+)*)", re.MULTILINE)
_UNITS = ("S", "M", "DEG", "DB", "SHARE", "M/S", "DEG/S", "M/S^2", "DEG/S^2")


def _radians(word: str) -> float:
    return math.radians(float(word))


# Scans and mounting of each sensor, and the errors that targets share.
Source = tuple[dict[str, tuple[list[RadarScan], Mounting]], ErrorBudget]


class Reader(NamedTuple):
    """A way to read scans."""

    name: str  # of the option that takes the file or folder
    about: str  # what that file or folder is
    load: Callable[..., Any]  # the function for Python
    options: Options
    needed: tuple[str, ...]  # of the options
    read: Callable[[Any, Mapping[str, Any]], Source]  # of file or folder, and options by name
    metavar: str = "FILE"
    heading: str = "options of a log"
    action: str = "store"  # on the command line
    trial: tuple[Any, tuple[Any, ...]] | None = None  # a recording and its sensors, for tests


def option_table(table: str) -> Options:
    """Return the options of lines "--name METAVAR  what it is", by name in Python.

    A METAVAR that is a unit stands for a number, which becomes one in rad if it is in degrees, N
    for a whole number, a|b for a choice, ... for several values; =1 is a default.  An option
    without one is a flag, which is None if not given.
    """
    found: Options = {}
    for name, metavars, text in _ROW.findall(table):
        words = metavars.replace("...", "").split() or [""]
        metavar, _, default = words[0].partition("=")
        real = _radians if metavar.startswith("DEG") else float
        kind: Any = real if metavar in _UNITS else int if metavar == "N" else str
        how: dict[str, Any] = {"type": kind, "default": kind(default) if default else None}
        if "|" in metavar:
            how["choices"] = metavar.split("|")
        elif metavar:
            how["metavar"] = metavar if len(words) == 1 else tuple(words)
        else:
            how = {"action": "store_true", "default": None}
        if "..." in metavars or len(words) > 1:
            how["nargs"] = "+" if "..." in metavars else len(words)
        found[name.replace("-", "_")] = how | {"help": " ".join(text.split())}
    return found


def data_set(
    title: str, load: Callable[..., Recording], table: str, trial: tuple[Any, tuple[Any, ...]]
) -> Reader:
    """The entry of a data set with the options recording and sensor.

    Its loader takes root folder, recording and sensor.
    """
    named = option_table(table)
    recording, sensor = named

    def read(root: str, chosen: Mapping[str, Any]) -> Source:
        names = chosen[sensor]
        check_once(names)
        loaded = {str(name): load(root, chosen[recording], name) for name in names}
        budgets = [each.budget for each in loaded.values()]
        sensors = {name: (each.scans, each.mounting) for name, each in loaded.items()}
        return sensors, budgets[0] or ErrorBudget()

    about, heading = f"folder of the {title} data set", "options of a data set"
    return Reader(title.lower(), about, load, named, (*named,), read, "ROOT", heading, trial=trial)


def check_once(names: Sequence[object]) -> None:
    """Raise a ValueError if a sensor would count twice."""
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"{name} is given twice")


def mountings_of(chosen: Mapping[str, Any]) -> dict[str, Mounting]:
    """The mountings that the options name."""
    stated = chosen["mounting"] or []
    check_once([name for name, *_ in stated])
    mountings = {}
    for name, *numbers in stated:
        try:
            if not 3 <= len(numbers) <= 5:
                raise ValueError("there must be NAME X Y YAW, and perhaps PITCH and ROLL")
            x, y, *angles = (number("each of X, Y and YAW", word) for word in numbers)
            mountings[name] = Mounting(x, y, *map(math.radians, angles))
        except ValueError as error:
            raise ValueError(f"--mounting {name} {' '.join(numbers)}: {error}") from None
    return mountings


def options_of(chosen: Mapping[str, Any], *names: str) -> dict[str, Any]:
    """The standard deviations of all targets and other options, as far as they are given."""
    return {name: chosen[name] for name in (*SIGMAS, *names) if chosen[name] is not None}


# Of all logs that are no data set.
LOG_OPTIONS = option_table("""
--mounting NAME X...  where a sensor sits, in m, m, degrees, and if it is inclined its pitch (down)
                      and roll; once for each sensor
--sigma-range M       standard deviation of the range of all targets, instead of a column
--sigma-azimuth DEG   of their azimuth
--sigma-doppler M/S   of their Doppler velocity
--min-snr DB          leave out targets with a smaller signal-to-noise ratio
""")
LOG_OPTIONS["mounting"] |= {"action": "append", "metavar": ("NAME", "X Y YAW")}
