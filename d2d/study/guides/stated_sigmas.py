"""Estimates whose stated standard deviations are too small or too large."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from matplotlib.axes import Axes

from d2d.radar import Drive, RadarScan, Sensor, simulate_drive, track
from d2d.radar.simulation.drive import CAR_MOUNTING, CAR_SPEED
from d2d.study.book.drawing import label
from d2d.study.book.grammar import GREY, OCHRE, PURPLE, TRUTH
from d2d.study.book.style import write_out_ticks
from d2d.study.guides.rows import Row, row

FACTORS = (0.25, 0.5, 1.0, 2.0, 4.0)
MEASURED = ("range", "azimuth", "doppler")
_IN_WORDS = {"doppler": "Doppler"}
# Of each curve: colour, marker, the end at which its name stands, and how far from there.
_LOOKS = {
    "range": (GREY, "^", 0, (8, -6)),
    "azimuth": (PURPLE, "o", 2, (-27, 20)),
    "doppler": (OCHRE, "s", -1, (-80, -3)),
}
_DURATION = 40.0  # s, a lap


@cache
def front_drive() -> Drive:
    """A lap of the car with a front radar that knows its errors exactly."""
    rng, sensor = np.random.default_rng(5), Sensor(quantised=False)
    return simulate_drive(rng, _DURATION, CAR_SPEED, mounting=CAR_MOUNTING, sensor=sensor)


@cache
def stated_sigmas() -> dict[str, list[Row]]:
    """Track the same drive with one of the three standard deviations multiplied by each factor.

    The limits of the vehicle are the default ones.  The errors themselves do not change.
    """
    drive = front_drive()

    right = track(drive)

    def tracked(name: str, factor: float) -> Row:
        scans = [scaled(scan, factor, (name,)) for scan in drive.scans]
        driven = right if factor == 1.0 else track((scans, drive.mounting))
        return row(f"{_IN_WORDS.get(name, name)} x {factor:g}", driven, drive.truth)

    return {name: [tracked(name, factor) for factor in FACTORS] for name in MEASURED}


def scaled(scan: RadarScan, factor: float, measured: Sequence[str] = MEASURED) -> RadarScan:
    """The scan with the standard deviations of what is ``measured`` multiplied by ``factor``."""
    names = (f"sigma_{name}" for name in measured)
    return replace(scan, **{name: factor * getattr(scan, name) for name in names})


def rounded(scans: Sequence[RadarScan], step: float, added: float = 0.0) -> list[RadarScan]:
    """Doppler velocities rounded to multiples of ``step``, and ``added`` to their sigmas."""
    return [
        replace(
            scan,
            doppler=np.round(scan.doppler / step) * step,
            sigma_doppler=np.hypot(scan.sigma_doppler, added),
        )
        for scan in scans
    ]


def draw_stated_sigmas(axes: Sequence[Axes], rows: dict[str, list[Row]]) -> None:
    """Errors of v_x and omega over those with the true values, and the ANEES."""
    for name, of_name in rows.items():
        color, marker, end, shift = _LOOKS[name]
        right = of_name[FACTORS.index(1.0)]
        curves = np.array([(r.v_x / right.v_x, r.omega / right.omega, r.anees) for r in of_name])
        for ax, values in zip(axes, curves.T, strict=True):
            ax.plot(FACTORS, values, marker=marker, color=color)
        label(
            axes[0],
            (FACTORS[end], curves[end, 0]),
            f"σ of {_IN_WORDS.get(name, name)}",
            color,
            shift,
        )
    for ax, title in zip(axes, ("error of $v_x$", r"error of $\omega$", "ANEES"), strict=True):
        ax.axhline(1.0, **TRUTH)
        ax.set(xscale="log", xlabel="stated σ over true σ", title=title)
        ax.set_xticks(FACTORS, ["¼", "½", "1", "2", "4"])
        ax.minorticks_off()
    axes[1].sharey(axes[0])
    axes[2].set_yscale("log")
    write_out_ticks(axes[2].yaxis, (0.5, 1, 2, 5, 10))
    axes[0].set(ylabel="times that with the true σ", ylim=(0.8, 3.3))
