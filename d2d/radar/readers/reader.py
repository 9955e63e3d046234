"""Registry entry of a reader, for the command line, the docs and the tests."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.scans.reference import Recording
from d2d.radar.scans.scan import Mounting, RadarScan


class Source(NamedTuple):
    """Input of a track: scans and mounting of each sensor, and the errors that targets share."""

    sensors: dict[str, tuple[list[RadarScan], Mounting]]
    budget: ErrorBudget = ErrorBudget()


class Option(NamedTuple):
    """An option that the command line has for one reader."""

    name: str  # with _ for -; no other reader has it
    help: str
    parsing: Mapping[str, Any] = {}  # further arguments of `argparse.ArgumentParser.add_argument`
    needed: bool = False


@dataclass(frozen=True)
class Reader:
    """A way to read scans."""

    name: str  # of the option that takes the file or folder
    about: str  # what that file or folder is
    load: Callable[..., Any]  # the function for Python
    options: tuple[Option, ...]
    read: Callable[[str, Mapping[str, Any]], Source]  # of file or folder, and options by name
    metavar: str = "FILE"
    heading: str = "options of a CSV file"
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
