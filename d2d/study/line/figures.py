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
_LETTER = 0.07  # inches: the width of a letter
_FULL = 0.6  # share of an axis above which there is no room for more letters
_VISIBLE = 0.03  # of the highest maximum: a lower one lies on the axis
LOWEST = 1e-60  # 1/m to the number of targets: the lower end of a logarithmic axis


def line_targets(
    ax: Axes, points: PointSet, true: Array, names: Sequence[str], own: str = "fixed"
) -> None:
    """Targets of a 1D set: density (curve), true place (hollow) and observed place (filled).

    The marks are those of the set (``own``).
    """
    low, high = true.min() - 2.0, true.max() + 2.0
    x = np.linspace(low, high, 1201)
    peak = 1.0 / np.sqrt(2.0 * np.pi * points.covariances.min())
    for k, name in enumerate(names):
        mean, variance = points.means[k, 0], points.covariances[k, 0, 0]
        density = np.exp(-0.5 * (x - mean) ** 2 / variance) / np.sqrt(2.0 * np.pi * variance)
        ax.plot(x, density, **_target_line(k, name))
        ax.plot(true[k], -0.07 * peak, **set_marks(own) | {"mfc": "none"})
        ax.plot(mean, -0.17 * peak, **set_marks(own))
        if name == "O":
            ax.plot(mean, -0.17 * peak, **set_marks("outlier"))
    places = [(float(mean), peak, name) for (mean,), name in zip(points.means, names, strict=True)]
    _write_letters(ax, places, high - low)
    ax.set_xlabel("x (m)")
    ax.set_ylabel("density (1/m)")
    ax.set_ylim(-0.25 * peak, 1.15 * peak)
    ax.set_yticks([tick for tick in ax.get_yticks() if 0.0 <= tick <= 1.15 * peak])


def _target_line(k: int, name: str) -> dict[str, Any]:
    """Style of a target's curve."""
    if name == "O":
        return {"color": OUTLIER, "ls": "-", "lw": 1.8, "zorder": 1.8}  # below the others
    color, line = TARGETS[k]
    return {"color": color, "ls": line, "lw": 1.2}


def _write_letters(ax: Axes, places: Sequence[tuple[float, float, str]], span: float) -> None:
    """Letters above places (x, height, letter); where they would overprint, they form one word.

    Where the letters would fill the line, none is written: nobody could tell which is whose.
    """
    figure = ax.get_figure(root=True)
    width = 5.0 if figure is None else float(figure.get_figwidth())  # inches
    letter_width = _LETTER * span / (ax.get_position().width * width)
    if len(places) * letter_width > _FULL * span:
        return
    groups = [[place] for place in sorted(places)]
    i = 0
    while i + 1 < len(groups):
        (x, _, word), (next_x, _, next_word) = map(_word, groups[i : i + 2])
        if next_x - x < 0.5 * (len(word) + len(next_word) + 0.5) * letter_width:
            groups[i : i + 2] = [groups[i] + groups[i + 1]]
            i = max(i - 1, 0)  # the longer word may touch the one before
        else:
            i += 1
    for x, height, word in map(_word, groups):
        ax.annotate(
            word,
            (x, height),
            (0, 2),
            textcoords="offset points",
            ha="center",
            color="0.25",
            fontsize=9,
        )


def _word(group: Sequence[tuple[float, float, str]]) -> tuple[float, float, str]:
    """Mean place, height and letters, each once, of neighbours (x, height, letter)."""
    x, height = np.mean([x for x, *_ in group]), max(height for _, height, _ in group)
    return float(x), height, "".join(dict.fromkeys(letter for *_, letter in group))


def surface(
    ax: Axes,
    translations: Array,
    values: Array,
    *,
    ylabel: str = "density (1/m)",
    **style: Any,
) -> None:
    """A cost surface over t_x."""
    ax.plot(translations, values, **({"color": BLACK} | style))
    ax.set_xlabel("$t_x$ (m)")
    ax.set_ylabel(ylabel)
    ax.margins(x=0.0)


def both_sets(
    axes: Sequence[Axes],
    sets: tuple[PointSet, PointSet],
    true: tuple[Array, Array],
    names: tuple[Sequence[str], Sequence[str]],
) -> None:
    """The previous set in the first panel, the current one in the second."""
    titles = ("previous set F", "current set M")
    for ax, points, positions, name, title, own in zip(
        axes, sets, true, names, titles, ("fixed", "moving"), strict=False
    ):
        line_targets(ax, points, positions, name, own)
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
    """The surface of each moving target, as a density or as a cost.

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
        seen = [place for place in places if place[1] > _VISIBLE * highest]
        _write_letters(ax, seen, float(np.ptp(translations)))
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
    """The fused surface, as a density in the first panel and as a cost in the second.

    Returns its peaks.
    """
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
    """The fused density on a logarithmic axis, which shows how small it is where it seems zero."""
    values = np.exp(np.maximum(log_surface(cost, translations, *sets), np.log(0.1 * LOWEST)))
    surface(ax, translations, values, ylabel="density", **style)
    ax.set_yscale("log")
    ax.set_ylim(LOWEST, 1e3)
