"""Where the targets of a radar's scans lie."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from d2d._types import Array
from d2d.radar import RadarScan
from d2d.study.book.grammar import GREY, PURPLE

EDGES: dict[str, Array] = {
    "range (m)": np.arange(0.0, 101.0, 10.0),
    "azimuth (°)": np.arange(-75.0, 76.0, 15.0),
    "Doppler velocity (m/s)": np.arange(-30.0, 31.0, 5.0),
}
"""The edges of the histograms, by the label of their axis."""


def scan_profile(scans: Sequence[RadarScan]) -> dict[str, Any]:
    """Targets in a scan, and how many of them lie in each bin of `EDGES`, means over the scans."""
    measured = (
        np.concatenate([scan.range for scan in scans]),
        np.rad2deg(np.concatenate([scan.azimuth for scan in scans])),
        np.concatenate([scan.doppler for scan in scans]),
    )
    counts = {
        name: np.histogram(values, edges)[0] / len(scans)
        for (name, edges), values in zip(EDGES.items(), measured, strict=True)
    }
    return {"targets": len(measured[0]) / len(scans)} | counts


def profile_panels(axes: Sequence[Axes], profiles: Mapping[str, Mapping[str, Any]]) -> None:
    """Targets in a scan in each bin of range, azimuth and Doppler velocity, for each profile."""
    for ax, (name, edges) in zip(axes, EDGES.items(), strict=True):
        for (of, profile), color in zip(profiles.items(), (GREY, PURPLE), strict=False):
            ax.stairs(profile[name], edges, color=color, fill=color == GREY, alpha=0.5)
            ax.stairs(profile[name], edges, color=color, lw=1.5, label=of)
        ax.set(xlabel=name, ylabel="targets", title="by " + name.split(" (")[0])
