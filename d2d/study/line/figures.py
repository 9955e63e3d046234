"""The panels of the scenes on a line."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.point_set import PointSet
from d2d.study.book.grammar import (
    BLACK,
    DASH_DOTTED,
    DASHED,
    DOTTED,
    OUTLIER,
    TRUTH,
    cost_key,
    cost_line,
    set_marks,
)
from d2d.study.line import scene
from d2d.study.line.surfaces import Peaks, log_surface, peaks, target_log_surfaces

# Targets are grey and known by their letters; the lines tell them apart where curves cross.
TARGETS = (
    ("0.25", "-"),
    ("0.45", DASHED),
    ("0.6", "-"),
    ("0.25", DOTTED),
    ("0.45", DASH_DOTTED),
)
_LETTER = 0.016  # width of a letter over that of a figure
_MOST = 14  # letters that an axis has room for
_VISIBLE = 0.03  # of the highest maximum: a lower one lies on the axis
LOWEST = 1e-60  # 1/m to the number of targets: the lower end of a logarithmic axis


def line_targets(
    ax: Axes, points: PointSet, true: Array, names: Sequence[str], marks: str = "fixed"
) -> None:
    """Draw targets of a 1D set: density (curve), true place (hollow) and observed place (filled).

    The marks are those of the set ``marks``.
    """
    low, high = true.min() - 2.0, true.max() + 2.0
    x = np.linspace(low, high, 1201)
    peak = 1.0 / np.sqrt(2.0 * np.pi * points.covariances.min())
    for k, name in enumerate(names):
        mean, variance = points.means[k, 0], points.covariances[k, 0, 0]
        density = np.exp(-0.5 * (x - mean) ** 2 / variance) / np.sqrt(2.0 * np.pi * variance)
        ax.plot(x, density, **_target_line(k, name))
        ax.plot(true[k], -0.07 * peak, **set_marks(marks) | {"mfc": "none"})
        ax.plot(mean, -0.17 * peak, **set_marks(marks))
        if name == "O":
            ax.plot(mean, -0.17 * peak, **set_marks("outlier"))
    _write_letters(ax, [(float(m), peak, k) for (m,), k in zip(points.means, names, strict=True)])
    ax.set(xlabel="x (m)", ylabel="density (1/m)", ylim=(-0.25 * peak, 1.15 * peak))
    ax.set_yticks([tick for tick in ax.get_yticks() if 0.0 <= tick <= 1.15 * peak])


def _target_line(k: int, name: str) -> dict[str, Any]:
    """Style of a target's curve."""
    if name == "O":
        return {"color": OUTLIER, "ls": "-", "lw": 1.8, "zorder": 1.8}  # below the others
    color, line = TARGETS[k]
    return {"color": color, "ls": line, "lw": 1.2}


def _write_letters(ax: Axes, peaks: Sequence[tuple[float, float, str]]) -> None:
    """Write a letter above each peak (x, height, letter); near ones form one word.

    Where there are too many, none is written: nobody could tell which is whose.
    """
    if len(peaks) > _MOST:
        return
    width = _LETTER * float(np.ptp(ax.get_xlim())) / ax.get_position().width
    words: list[tuple[float, float, str]] = []
    for x, height, letter in sorted(peaks):
        if words and x - words[-1][0] < 0.5 * width * (len(words[-1][2]) + 2.0):
            before, highest, word = words.pop()
            word += letter if letter not in word else ""
            words.append((0.5 * (before + x), max(highest, height), word))
        else:
            words.append((x, height, letter))
    style: dict[str, Any] = {"textcoords": "offset points", "ha": "center", "fontsize": 9}
    for x, height, word in words:
        ax.annotate(word, (x, height), (0, 2), color="0.25", **style)


def surface(
    ax: Axes,
    translations: Array,
    values: Array,
    *,
    ylabel: str = "density (1/m)",
    **style: Any,
) -> None:
    """Draw a cost surface over t_x."""
    ax.plot(translations, values, **({"color": BLACK} | style))
    ax.set(xlabel="$t_x$ (m)", ylabel=ylabel)
    ax.margins(x=0.0)


def both_sets(
    axes: Sequence[Axes],
    sets: tuple[PointSet, PointSet],
    true: tuple[Array, Array],
    names: tuple[Sequence[str], Sequence[str]],
) -> None:
    """Draw the previous set in the first panel, the current one in the second."""
    titles = {"fixed": "previous set F", "moving": "current set M"}
    panels = zip(axes, sets, true, names, titles.items(), strict=False)
    for ax, points, positions, letters, (marks, title) in panels:
        line_targets(ax, points, positions, letters, marks)
        ax.set_title(title)


def every_target(
    ax: Axes,
    translations: Array,
    cost: RegistrationCost,
    sets: tuple[PointSet, PointSet],
    names: Sequence[str],
    *,
    negative_log: bool = False,
) -> None:
    """Draw the surface of each moving target, as a density or as a cost.

    A letter above each maximum of a density names the target, unless it is too low to be seen or
    there is no room for all of them.
    """
    logs = target_log_surfaces(cost, translations, *sets)
    places = []
    for k, name in enumerate(names):
        values = -logs[k] if negative_log else np.exp(logs[k])
        ylabel = "−log density" if negative_log else "density (1/m)"
        surface(ax, translations, values, ylabel=ylabel, label=name, **_target_line(k, name))
        inner = values[1:-1]
        top = np.flatnonzero((inner > values[:-2]) & (inner >= values[2:])) + 1
        places += [(float(translations[i]), float(values[i]), name) for i in top]
    if not negative_log:
        highest = max(height for _, height, _ in places)
        _write_letters(ax, [peak for peak in places if peak[1] > _VISIBLE * highest])
        ax.margins(y=0.1)
    ax.axvline(scene.TRUTH, **TRUTH)
    ax.set_title("targets")


def fused(
    axes: Sequence[Axes],
    translations: Array,
    cost: RegistrationCost,
    sets: tuple[PointSet, PointSet],
    title: str,
) -> Peaks:
    """Draw the fused surface, as a density and as a cost, and return its peaks."""
    values = log_surface(cost, translations, *sets)
    style = cost_line(cost_key(cost), cost.metric)
    surface(axes[0], translations, np.exp(values), ylabel="density", **style)
    surface(axes[1], translations, -values, ylabel="−log density", **style)
    for ax in axes:
        ax.axvline(scene.TRUTH, **TRUTH)
        ax.set_title(title)
    return peaks(translations, values)


def log_axis(
    ax: Axes,
    translations: Array,
    cost: RegistrationCost,
    sets: tuple[PointSet, PointSet],
    **style: Any,
) -> None:
    """Draw the fused density on a logarithmic axis, to show how small it is."""
    values = np.exp(np.maximum(log_surface(cost, translations, *sets), np.log(0.1 * LOWEST)))
    surface(ax, translations, values, ylabel="density", **style)
    ax.set_yscale("log")
    ax.set_ylim(LOWEST, 1e3)
