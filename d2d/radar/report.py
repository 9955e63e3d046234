"""A report of a drive as one page: path, velocities, residuals, findings, settings."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from d2d.radar.evaluation.sensor_motion import residuals_of
from d2d.radar.tracks.rounds import SensorScans
from d2d.radar.tracks.track import Track

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_BIN = np.deg2rad(4.0)
_FEW = 20  # residuals, of which a median says little


def report_page(
    title: str,
    sensors: Mapping[str, SensorScans],
    driven: Track,
    findings: Iterable[object],
    settings: Mapping[str, object],
) -> str:
    """The text of a page that needs no other file; matplotlib must be installed."""
    listed = "".join(f"<li>{escape(str(finding))}</li>" for finding in findings)
    rows = "".join(
        f"<tr><td>{escape(name)}</td><td>{escape(str(value))}</td></tr>"
        for name, value in settings.items()
    )
    page = Path(__file__).with_name("report.html").read_text(encoding="utf-8")
    return page.format(
        title=escape(title),
        summary=escape(str(driven)),
        findings=f"<ul>{listed}</ul>" if listed else "<p>Nothing was found.</p>",
        picture=base64.b64encode(png_of(driven.plot())).decode(),
        residuals=base64.b64encode(png_of(_drawn(sensors, driven))).decode(),
        settings=rows,
    )


def _drawn(sensors: Mapping[str, SensorScans], driven: Track) -> Figure:
    """The medians and quartiles of the residuals of each sensor, over the azimuth."""
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(
        len(sensors), figsize=(5.0, 2.2 * len(sensors)), squeeze=False, layout="constrained"
    )
    for ax, (name, sensor) in zip(axes[:, 0], sensors.items(), strict=True):
        azimuth, residual = residuals_of(sensor, driven)
        step = np.round(azimuth / _BIN)
        groups = [(np.rad2deg(at * _BIN), residual[step == at]) for at in np.unique(step)]
        many = {at: own for at, own in groups if len(own) >= _FEW}
        ax.boxplot(
            [*many.values()], positions=[*many], widths=2.0, whis=0.0, sym="", manage_ticks=False
        )
        ax.axhline(0.0, color="black", lw=0.8)
        ax.set(title=name, xlabel="azimuth (°)", ylabel="residual (m/s)")
    return figure


def png_of(figure: Figure) -> bytes:
    """The content of a PNG file of a figure, which is closed."""
    from matplotlib import pyplot as plt

    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=150)
    plt.close(figure)
    return file.getvalue()
