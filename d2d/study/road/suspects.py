"""Why the errors on the road are larger than their covariances state: one experiment per suspect.

All of them need only what `d2d.study.road.estimates` stores: tracks and their errors.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from d2d._types import Array
from d2d.radar import Comparison, Recording, Reference, Track, compare_halves
from d2d.radar.evaluation.compare import NAMES
from d2d.study.book.grammar import BLACK, GREY, OCHRE, TRUTH
from d2d.study.book.style import write_out_ticks
from d2d.study.book.table import Table, table
from d2d.study.drives.figures import SYMBOLS

# Of v_x, v_y and omega: marker, colour, height above the row, which keeps equal values apart.
_MARKS = (("o", BLACK, 0.0), ("s", OCHRE, 0.24), ("D", GREY, -0.24))


def judge_halves(recording: Recording) -> dict[str, Any]:
    """Two halves of each scan against each other, divided target by target or object by object.

    Mean whitened squares, their mean (the ANEES) and its 95 % interval; see `compare_halves`.
    """
    view = [(recording.scans, recording.mounting)]
    return {
        by: parts(compare_halves(view, np.random.default_rng(0), by=by, baseline=2))
        for by in ("target", "object")
    }


def parts(found: Comparison) -> dict[str, Any]:
    """The ANEES of a comparison, its interval (block bootstrap), and the mean whitened squares."""
    return {
        "whitened": found.measures.whitened_squares.tolist(),
        "anees": float(found.measures.anees),
        "interval": found.intervals().anees.tolist(),
    }


def without_slow_part(found: Comparison, seconds: float) -> Comparison:
    """The comparison with the mean of each error's neighbours within ``seconds`` subtracted."""
    near = np.abs(found.times[:, np.newaxis] - found.times) <= 0.5 * seconds
    slow = (near @ found.errors) / near.sum(axis=1, keepdims=True)
    return replace(found, errors=found.errors - slow)


def beside_changed_reference(
    track: Track, errors: Array, lag: float = 0.0, speed: float = 0.0
) -> Comparison:
    """The track beside its reference read ``lag`` (s) earlier and faster by a factor 1 + ``speed``.

    The reference follows from the track and its errors (n, 3), and is linear in between.
    """
    known = np.asarray(np.isfinite(errors).all(axis=-1))
    theta = (track.theta - errors)[known]
    reference = Reference(track.times[known], theta, 0.0 * theta)
    changed = reference.at(track.times - lag, max_gap=1e9).theta * [1.0 + speed, 1.0, 1.0]
    return Comparison.from_errors(track, np.where(known[:, None], track.theta - changed, np.nan))


def parts_table(judged: Mapping[str, Mapping[str, Any]], caption: str = "") -> Table:
    """ANEES with its interval and the three parts, a row for each of what `parts` gives."""
    rows = {
        name: (found["anees"], "{:.1f} to {:.1f}".format(*found["interval"]), *found["whitened"])
        for name, found in judged.items()
    }
    parts = ((f"part of {name}", "", ".1f") for name in NAMES)
    return table(rows, ["experiment", ("ANEES", "", ".1f"), "95 % interval", *parts], caption)


def draw_choices(
    ax: Axes, judged: Mapping[str, Comparison], beside: str, groups: Sequence[int]
) -> None:
    """The RMSE of every run over that of the run ``beside``; ``groups`` begin below a thin rule."""
    rows = np.arange(len(judged))[::-1]
    factors = np.array([found.rmse / judged[beside].rmse for found in judged.values()])
    for found, symbol, (marker, color, above) in zip(factors.T, SYMBOLS, _MARKS, strict=True):
        ax.plot(found, rows + above, marker, color=color, ms=6)
        ax.text(1.12 * found[1], rows[1] + above, symbol, color=color, va="center")
    for first in groups:
        ax.axhline(len(judged) - first - 0.5, color="0.8", lw=0.8)
    ax.axvline(1.0, **TRUTH)
    ax.set(xscale="log", xlabel=f"RMSE over the RMSE of {beside}")
    ax.set_yticks(rows, list(judged))
    write_out_ticks(ax.xaxis, (0.02, 0.05, 0.1, 0.2, 0.5, 1))
