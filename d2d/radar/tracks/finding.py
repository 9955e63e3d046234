"""A mistake in a log that leaves a trace, as `track` warns of it and `findings` returns it."""

import sys
import warnings
from typing import NamedTuple


class Finding(NamedTuple):
    """What is probably wrong, and the number that shows it."""

    symptom: str  # its row in the page "When a path looks wrong"
    sensor: str  # its name; empty if it is about all
    number: float
    unit: str
    sure: bool  # whether the estimates are surely of no use
    about: str  # the same in words, with what to look at

    def __str__(self) -> str:
        whose = f"{self.sensor}: " if self.sensor else ""
        return f"{whose}{self.symptom} ({self.about})"


class FindingWarning(UserWarning):
    """A warning that holds what was found, as ``finding``."""

    def __init__(self, finding: Finding, text: str) -> None:
        super().__init__(text)
        self.finding = finding


def warn_of(finding: Finding, text: str) -> None:
    """Warn of a finding, at the line outside of the package that led to it."""
    frame, level = sys._getframe(), 1
    while frame.f_back is not None and frame.f_globals["__name__"].startswith("d2d."):
        frame, level = frame.f_back, level + 1
    warnings.warn(FindingWarning(finding, text), stacklevel=level)
