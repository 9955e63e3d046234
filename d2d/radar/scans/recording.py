"""What a reader of a data set returns: the scans of one sensor, its mounting, the true motion."""

from dataclasses import dataclass

from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.scans.reference import Reference
from d2d.radar.scans.scan import Mounting, RadarScan


@dataclass(frozen=True, eq=False)
class Recording:
    """One sensor's scans of a drive, its mounting, and the motion according to other sensors.

    Attributes
    ----------
    scans : list of RadarScan
    mounting : Mounting
    reference : Reference
        The motion at the times of the scans; nan outside the time span of the reference's source,
        and in its gaps.
    budget : ErrorBudget, optional
        What the targets of this data set's radars share, for ``track(..., budget=)``.
    """

    scans: list[RadarScan]
    mounting: Mounting
    reference: Reference
    budget: ErrorBudget | None = None
