"""One line for each way to track a drive: what was accepted, how far off, how credible."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from d2d._types import Array
from d2d.radar import (
    ErrorBudget,
    Mounting,
    RadarScan,
    Reference,
    Track,
    compare,
    compare_halves,
    compare_tracks,
    track,
)
from d2d.study.book.table import Table, table

ScansAndMounting = tuple[Sequence[RadarScan], Mounting]


class Row(NamedTuple):
    """How well a track agrees with the true motion.

    ``rmse`` (3,) is in m/s, m/s, deg/s; it and ``anees`` are nan if nearly all estimates failed.
    ``reason`` is the most frequent reason of failure, without its numbers.
    """

    name: str
    accepted: float
    rmse: Array
    anees: float
    reason: str


def row(name: str, driven: Track, truth: Reference) -> Row:
    """Compare a track with the true motion."""
    failures = str(driven).splitlines()[1:]  # the most frequent first
    reason = failures[0].split(" failed: ")[1] if failures else ""
    accepted = float(driven.converged.mean())
    if driven.converged.sum() < 4:  # the fewest that can be compared
        return Row(name, accepted, np.full(3, np.nan), float("nan"), reason)
    found = compare(driven, truth)
    return Row(name, accepted, found.rmse, found.credibility.anees, reason)


def row_table(rows: Iterable[Row], caption: str = "") -> Table:
    """The rows as a table that shows itself."""
    return table(
        [(each.name, each.accepted, *each.rmse, each.anees) for each in rows],
        [
            "",
            ("accepted", "", ".1%"),
            ("v_x", "m/s", ".3f"),
            ("v_y", "m/s", ".3f"),
            ("omega", "deg/s", ".2f"),
            "ANEES",
        ],
        caption,
    )


def halves(sensor: ScansAndMounting) -> dict[str, float]:
    """ANEES of the differences between halves of one sensor's scans, by target and by object."""
    found = {}
    for by in ("target", "object"):
        compared = compare_halves([sensor], np.random.default_rng(0), by=by)
        found[f"halves by {by}"] = compared.credibility.anees
    return found


def two_sensors(
    first: ScansAndMounting, second: ScansAndMounting, *, budget: ErrorBudget | None = None
) -> float:
    """ANEES of the differences between the tracks of two sensors, each on its own."""
    tracks = [track(each, budget=budget) for each in (first, second)]
    return compare_tracks(*tracks).credibility.anees
