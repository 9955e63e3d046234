"""One line for each way to track a drive: what was accepted, how far off, how credible."""

from collections.abc import Iterable
from typing import NamedTuple

from d2d.radar import Reference, Track, compare
from d2d.study.book.table import Table, table

NAN = float("nan")


class Row(NamedTuple):
    """How well a track agrees with the true motion, and the most frequent reason of failure."""

    name: str
    accepted: float  # share of the estimates
    v_x: float  # m/s, root mean square errors
    v_y: float  # m/s
    omega: float  # deg/s
    anees: float
    reason: str


def row(name: str, driven: Track, truth: Reference) -> Row:
    """Compare a track with the true motion."""
    lines = str(driven).splitlines()
    failures = [line for line in lines if " failed: " in line]  # the most frequent first
    reason = failures[0].split(" failed: ")[1] if failures else ""
    accepted = float(driven.converged.mean())
    if driven.converged.sum() < 4:  # the fewest that can be compared
        return Row(name, accepted, NAN, NAN, NAN, NAN, reason)
    comparison = compare(driven, truth)
    v_x, v_y, omega = map(float, comparison.rmse)
    return Row(name, accepted, v_x, v_y, omega, comparison.credibility.anees, reason)


def row_table(rows: Iterable[Row], caption: str = "") -> Table:
    """The rows as a table that shows itself."""
    columns = [("v_x", "m/s", ".3f"), ("v_y", "m/s", ".3f"), ("omega", "deg/s", ".2f")]
    return table(
        [row[:-1] for row in rows], ["", ("accepted", "", ".1%"), *columns, "ANEES"], caption
    )
