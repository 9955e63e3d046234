"""Registry entry of a reader, for the command line, the docs and the tests."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from d2d.radar.readers.table import number
from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.scans.reference import Recording
from d2d.radar.scans.scan import SIGMAS, Mounting, RadarScan

# Scans and mounting of each sensor, and the errors that targets share.
Source = tuple[dict[str, tuple[list[RadarScan], Mounting]], ErrorBudget]


class Reader(NamedTuple):
    """A way to read scans."""

    name: str  # of the option that takes the file or folder
    about: str  # what that file or folder is
    load: Callable[..., Any]  # the function for Python
    needed: tuple[str, ...]  # of its options, which `commands.txt` describes
    read: Callable[[Any, Mapping[str, Any]], Source]  # of file or folder, and options by name
    metavar: str = "FILE"
    action: str = "store"  # on the command line


def data_set(title: str, load: Callable[..., Recording], recording: str, sensor: str) -> Reader:
    """The entry of a data set, whose loader takes root folder, recording and sensor."""

    def read(root: str, chosen: Mapping[str, Any]) -> Source:
        names = chosen[sensor]
        check_once(names)
        loaded = {str(name): load(root, chosen[recording], name) for name in names}
        sensors = {name: (each.scans, each.mounting) for name, each in loaded.items()}
        return sensors, next(iter(loaded.values())).budget or ErrorBudget()

    about = f"folder of the {title} data set"
    return Reader(title.lower(), about, load, (recording, sensor), read, "ROOT")


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
