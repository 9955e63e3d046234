"""The conventions of a log and of a mounting, in one picture."""

import cmath
import math

from matplotlib.axes import Axes
from matplotlib.patches import Arc, Rectangle

from d2d.radar import Mounting
from d2d.study.book.grammar import BLACK, GREY, OCHRE, PURPLE

# Places in the picture are complex numbers, x + iy in m.
_AZIMUTH, _RANGE = math.radians(35.0), 4.6  # of the target that is drawn


def draw_conventions(ax: Axes, mounting: Mounting) -> None:
    """Axes of the vehicle, a sensor's mounting, range, azimuth, sign of the Doppler velocity."""
    _vehicle(ax)
    place = complex(mounting.x, mounting.y)
    _sensor(ax, mounting, place)
    sight = cmath.rect(1.0, mounting.yaw + _AZIMUTH)
    target = place + _RANGE * sight
    _line(ax, place, target, color=OCHRE, lw=1.0)
    ax.plot(target.real, target.imag, "^", color=OCHRE, ms=9)
    _text(ax, place + 0.62 * _RANGE * sight - 1.15, "range", OCHRE)
    _arc(ax, place, 2.3, mounting.yaw, mounting.yaw + _AZIMUTH, OCHRE)
    _text(ax, place + cmath.rect(2.7, mounting.yaw + 0.8 * _AZIMUTH), "azimuth > 0", OCHRE)
    _arrow(ax, target, target + 1.3 * sight, GREY)
    _text(ax, target + 1.3 * sight - 2.3, "doppler > 0:\nmoves away", GREY)
    ax.set(xlim=(-2.2, 8.2), ylim=(-2.7, 7.3), xlabel="x (m)", ylabel="y (m)", aspect="equal")


def _vehicle(ax: Axes) -> None:
    ax.add_patch(Rectangle((-1.0, -0.9), 4.7, 1.8, facecolor="0.93", edgecolor="0.6"))
    for x in (0.0, 2.8):
        for y in (-0.85, 0.85):
            ax.plot([x - 0.3, x + 0.3], [y, y], color="0.3", lw=5, solid_capstyle="butt")
    ax.plot(0.0, 0.0, "o", color=BLACK)
    _text(ax, complex(-1.6, -1.75), "origin, best the middle\nof the rear axle", BLACK)
    for end, name, shift in ((2.0, "x, forward", -1.4 - 0.5j), (2.0j, "y, left", -1.1 - 0.1j)):
        _arrow(ax, 0.0, end, BLACK)
        _text(ax, end + shift, name, BLACK)
    _arc(ax, 0.0, 0.75, math.radians(20.0), math.radians(70.0), BLACK)
    _arrow(ax, cmath.rect(0.75, 1.2), cmath.rect(0.75, 1.45), BLACK)
    _text(ax, 0.65 + 0.45j, r"$\omega > 0$", BLACK)


def _sensor(ax: Axes, mounting: Mounting, place: complex) -> None:
    ax.plot(place.real, place.imag, "s", color=PURPLE, ms=7)
    end = place + cmath.rect(3.0, mounting.yaw)
    _line(ax, place, end, color=PURPLE, lw=1.0, ls="-.")
    _text(ax, end + complex(0.1, -0.25), "boresight", PURPLE)
    _line(ax, place, place + 2.4, color="0.4", lw=1.0, ls=":")
    _arc(ax, place, 1.7, 0.0, mounting.yaw, PURPLE)
    _text(ax, place + cmath.rect(1.85, 0.5 * mounting.yaw) - 0.1j, "yaw > 0", PURPLE)
    _line(ax, place, complex(place.real, -2.0), color=PURPLE, lw=0.6)
    words = f"mounting: x = {mounting.x:g} m, y = {mounting.y:g} m"
    _text(ax, complex(place.real - 2.2, -2.4), words, PURPLE)


def _text(ax: Axes, at: complex, words: str, color: str) -> None:
    ax.text(at.real, at.imag, words, color=color, fontsize=9)


def _line(ax: Axes, start: complex, end: complex, *, color: str, lw: float, ls: str = "-") -> None:
    ax.plot([start.real, end.real], [start.imag, end.imag], color=color, lw=lw, ls=ls)


def _arrow(ax: Axes, start: complex, end: complex, color: str) -> None:
    style = {"arrowstyle": "-|>", "color": color, "lw": 1.5}
    ax.annotate("", (end.real, end.imag), (start.real, start.imag), arrowprops=style)


def _arc(ax: Axes, at: complex, radius: float, low: float, high: float, color: str) -> None:
    angles = {"theta1": math.degrees(low), "theta2": math.degrees(high)}
    ax.add_patch(Arc((at.real, at.imag), 2.0 * radius, 2.0 * radius, color=color, **angles))
