"""Registry entry of a reader, for the command line, the docs and the tests."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from d2d.radar.readers.table import number
from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.scans.reference import Recording
from d2d.radar.scans.scan import SIGMAS, Mounting, RadarScan


class Source(NamedTuple):
    """Input of a track: scans and mounting of each sensor, and the errors that targets share."""

    sensors: dict[str, tuple[list[RadarScan], Mounting]]
    budget: ErrorBudget = ErrorBudget()


class Option(NamedTuple):
    """An option that the command line has for one reader."""

    name: str  # with _ for -; readers that share it share the entry
    help: str
    parsing: Mapping[str, Any] = {}  # further arguments of `argparse.ArgumentParser.add_argument`
    needed: bool = False


class Reader(NamedTuple):
    """A way to read scans."""

    name: str  # of the option that takes the file or folder
    about: str  # what that file or folder is
    load: Callable[..., Any]  # the function for Python
    options: tuple[Option, ...]
    read: Callable[[Any, Mapping[str, Any]], Source]  # of file or folder, and options by name
    metavar: str = "FILE"
    heading: str = "options of a log"
    parsing: Mapping[str, Any] = {}  # as of an option
    trial: tuple[Any, tuple[Any, ...]] | None = None  # a recording and its sensors, for tests


def data_set(
    title: str,
    load: Callable[..., Recording],
    *,
    recording: Option,
    sensor: Option,
    trial: tuple[Any, tuple[Any, ...]],
) -> Reader:
    """The entry of a data set, whose loader takes root folder, recording and sensor."""

    def read(root: str, chosen: Mapping[str, Any]) -> Source:
        names = chosen[sensor.name]
        check_once(names)
        loaded = {str(name): load(root, chosen[recording.name], name) for name in names}
        budgets = [each.budget for each in loaded.values()]
        sensors = {name: (each.scans, each.mounting) for name, each in loaded.items()}
        return Source(sensors, budgets[0] or ErrorBudget())

    several = {"nargs": "+", **sensor.parsing}
    options = recording._replace(needed=True), sensor._replace(needed=True, parsing=several)
    return Reader(
        title.lower(),
        f"folder of the {title} data set",
        load,
        tuple(option._replace(help=f"{title}: {option.help}") for option in options),
        read,
        metavar="ROOT",
        heading="options of a data set",
        trial=trial,
    )


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
    given = {name: chosen[name] for name in (*SIGMAS, *names) if chosen[name] is not None}
    if "sigma_azimuth" in given:
        given["sigma_azimuth"] = math.radians(given["sigma_azimuth"])
    return given


def _sigma(name: str, unit: str) -> Option:
    about = f"standard deviation of the {name} of all targets, instead of a column"
    return Option(f"sigma_{name}", about, {"type": float, "metavar": unit})


# Of all logs that are no data set.
LOG_OPTIONS = (
    Option(
        "mounting",
        "where a sensor sits, in m, m, degrees, and if it is inclined its pitch (down) and roll; "
        "once for each sensor",
        {"action": "append", "nargs": "+", "metavar": ("NAME", "X Y YAW")},
        needed=True,
    ),
    _sigma("range", "M"),
    _sigma("azimuth", "DEG"),
    _sigma("doppler", "M/S"),
    Option(
        "min_snr",
        "leave out targets with a smaller signal-to-noise ratio",
        {"type": float, "metavar": "DB"},
    ),
)
