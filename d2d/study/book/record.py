"""The evidence on record: what the checks found, stored so that the ledger can be shown at once.

``make record`` runs every check, which takes some minutes, and writes
``chapters/results/claims.json``.  The tests run every check as well, and compare.
"""

import math
import re
from collections.abc import Mapping
from itertools import zip_longest
from pathlib import Path
from typing import Any

from d2d.study.book.claim import Evidence
from d2d.study.book.measured import Measured, with_bounds
from d2d.study.results import read_json, results_path, write_json

RECORD = results_path("claims.json")  # of the book
RELATIVE, ABSOLUTE = 0.005, 0.002
_NUMBER = re.compile(r"[-+−]?\d+(\.\d+)?(e[-+]?\d+)?")


def write_record(path: Path, evidence: Mapping[str, Evidence]) -> None:
    """Write the evidence, with its numbers rounded to four significant digits.

    A number with an interval becomes a list with its bounds, and a headline's place on the axis.
    """
    stored = {
        key: {"verdict": item.verdict}
        | vars(item)
        | {"numbers": {name: _stored(value) for name, value in item.numbers.items()}}
        for key, item in evidence.items()
    }
    write_json(path, stored, digits=4)


def _stored(value: float) -> float | list[Any]:
    if not isinstance(value, Measured):
        return float(value)
    mark = ["telling", *value.margin_units] if value.headline else []
    return [*with_bounds(value), *mark]


def read_record(path: Path = RECORD) -> dict[str, Evidence]:
    """Read what `write_record` wrote; by default the book's record."""
    stored = read_json(path)
    for entries in stored.values():
        del entries["verdict"]  # follows from the parts
        entries["numbers"] = {name: _read(value) for name, value in entries["numbers"].items()}
    return {key: Evidence(**entries) for key, entries in stored.items()}


def _read(value: float | list[Any]) -> float:
    if not isinstance(value, list):
        return value
    number, low, high, *mark = value
    return Measured(number, low, high, bool(mark), tuple(mark[1:]))


def differences(fresh: Evidence, recorded: Evidence) -> list[str]:
    """List where fresh evidence differs from that on record, in sentences without their numbers.

    Numbers may differ by 0.5 % or by 0.002: rounding on another machine changes single draws.
    """
    if fresh.numbers.keys() != recorded.numbers.keys():
        return [f"unmatched numbers: {sorted(fresh.numbers.keys() ^ recorded.numbers.keys())}"]
    pairs = {
        f"{name}: {value:.4g}": f"{stored:.4g}"
        for name in fresh.numbers
        for value, stored in zip_longest(
            with_bounds(fresh.numbers[name]),
            with_bounds(recorded.numbers[name]),
            fillvalue=math.nan,
        )
        if not math.isclose(value, stored, rel_tol=RELATIVE, abs_tol=ABSOLUTE)
    }
    if list(fresh.headlines) != list(recorded.headlines):
        pairs[f"headlines: {list(fresh.headlines)}"] = f"{list(recorded.headlines)}"
    if fresh.parts != recorded.parts:
        pairs[f"{fresh.parts}"] = f"{recorded.parts}"
    for field in ("because", "holds", "over"):
        sentence, written = getattr(fresh, field), getattr(recorded, field)
        if _NUMBER.sub("#", sentence) != _NUMBER.sub("#", written):
            pairs[repr(sentence)] = repr(written)
    return [f"{found}, on record {written}" for found, written in pairs.items()]
