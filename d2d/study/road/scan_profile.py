"""Where the targets of a radar's scans lie: a summary of recordings that cannot be shown."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from d2d._types import Array
from d2d.radar import RadarScan, load_radarscenes
from d2d.study.book.grammar import GREY, PURPLE
from d2d.study.results import read_json, results_path, write_json
from d2d.study.road.drive import Source

SENSOR = 3
RESULTS = results_path("radarscenes_scans.json")
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
        name: [round(float(n), 2) for n in np.histogram(values, edges)[0] / len(scans)]
        for (name, edges), values in zip(EDGES.items(), measured, strict=True)
    }
    return {"scans": len(scans), "targets": round(len(measured[0]) / len(scans), 1)} | counts


def read_profile() -> dict[str, Any]:
    """The stored profile of the recording."""
    return read_json(RESULTS)


def profile_panels(axes: Sequence[Axes], profiles: Mapping[str, Mapping[str, Any]]) -> None:
    """Targets in a scan in each bin of range, azimuth and Doppler velocity, for each profile."""
    for ax, (name, edges) in zip(axes, EDGES.items(), strict=True):
        for (of, profile), color in zip(profiles.items(), (GREY, PURPLE), strict=False):
            ax.stairs(profile[name], edges, color=color, fill=color == GREY, alpha=0.5)
            ax.stairs(profile[name], edges, color=color, lw=1.5, label=of)
        ax.set(xlabel=name, ylabel="targets", title="by " + name.split(" (")[0])


def write(source: Source) -> None:
    """Summarise the scans of one sensor of a sequence, and store the result."""
    recording = load_radarscenes(source.root, source.name, SENSOR)
    write_json(RESULTS, scan_profile(recording.scans))
