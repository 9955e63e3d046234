"""What a reader tells the command line, the docs and the tests: an entry of `READERS`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.scans.recording import Recording
from d2d.radar.scans.scan import Mounting, RadarScan


class Source(NamedTuple):
    """What is tracked: the scans and mounting of each sensor, and the errors that targets share."""

    sensors: dict[str, tuple[list[RadarScan], Mounting]]
    budget: ErrorBudget = ErrorBudget()


class Option(NamedTuple):
    """An option that the command line has for one reader."""

    name: str  # with _ for -; options of two readers must not have the same
    help: str
    parsing: Mapping[str, Any] = {}  # further arguments of `argparse.ArgumentParser.add_argument`
    needed: bool = False


@dataclass(frozen=True)
class Reader:
    """A way to read scans.

    Attributes
    ----------
    name : str
        Of the option that takes the file or folder: ``--name``.
    about : str
        What that file or folder is, in one line.
    load : callable
        The function for Python.
    options : tuple of Option
    read : callable
        The `Source` in a file or folder, of the values of the options by name; None for those that
        were not given.
    metavar, heading : str
        In the help, what stands for the file or folder, and the heading of the options.
    trial : (recording, sensors), optional
        Of a data set: a recording that tests may load, and its sensors.
    """

    name: str
    about: str
    load: Callable[..., Any]
    options: tuple[Option, ...]
    read: Callable[[str, Mapping[str, Any]], Source]
    metavar: str = "FILE"
    heading: str = "options of a CSV file"
    trial: tuple[Any, tuple[Any, ...]] | None = None

    @property
    def variable(self) -> str:
        """The environment variable that tells the tests where the data set is."""
        return f"D2D_{self.name.upper()}"


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
        sensors = chosen[sensor.name]
        check_once(sensors)
        loaded = [load(root, chosen[recording.name], each) for each in sensors]
        return Source(
            {
                str(name): (each.scans, each.mounting)
                for name, each in zip(sensors, loaded, strict=True)
            },
            loaded[0].budget or ErrorBudget(),
        )

    return Reader(
        title.lower(),
        f"folder of the {title} data set",
        load,
        (
            Option(recording.name, f"{title}: {recording.help}", recording.parsing, needed=True),
            Option(
                sensor.name,
                f"{title}: {sensor.help}",
                {"nargs": "+", **sensor.parsing},
                needed=True,
            ),
        ),
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
