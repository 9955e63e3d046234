"""Recording of one sensor, as readers of data sets return it: scans, mounting, true motion."""

from dataclasses import dataclass

from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.scans.reference import Reference
from d2d.radar.scans.scan import Mounting, RadarScan


@dataclass(frozen=True, eq=False)
class Recording:
    """One sensor's scans of a drive, its mounting, and the motion according to other sensors.

    The reference is at the times of the scans, and nan outside the time span of its source and in
    its gaps.  The budget, for ``track(..., budget=)``, is what the targets of these radars share.
    """

    scans: list[RadarScan]
    mounting: Mounting
    reference: Reference
    budget: ErrorBudget | None = None
