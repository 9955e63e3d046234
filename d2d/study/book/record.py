"""The evidence on record: what the checks found, stored so that the ledger can be shown at once.

``make record`` runs every check, which takes some minutes, and writes
``chapters/results/claims.json``.  The tests run every check as well, and compare.
"""

import json
import math
import re
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from d2d.study.book.claim import Evidence
from d2d.study.results import results_path

RELATIVE, ABSOLUTE = 0.005, 0.002
_NUMBER = re.compile(r"[-+−]?\d+(\.\d+)?(e[-+]?\d+)?")


def record_path() -> Path:
    """Path of the book's record."""
    return results_path("claims.json")


def write_record(path: Path, evidence: Mapping[str, Evidence]) -> None:
    """Write the evidence, with its numbers rounded to four significant digits."""
    rounded = {
        key: {
            **asdict(item),
            "numbers": {name: float(f"{value:.4g}") for name, value in item.numbers.items()},
        }
        for key, item in evidence.items()
    }
    path.write_text(json.dumps(rounded, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def read_record(path: Path | None = None) -> dict[str, Evidence]:
    """Read what `write_record` wrote; by default the book's record."""
    stored = json.loads((path or record_path()).read_text(encoding="utf-8"))
    return {key: Evidence(**entries) for key, entries in stored.items()}


def differences(fresh: Evidence, recorded: Evidence) -> list[str]:
    """List where fresh evidence differs from that on record.

    Numbers may differ by 0.5 % or by 0.002, because rounding on another machine can change the
    outcome of single draws.  Sentences are compared without their numbers.
    """
    if fresh.numbers.keys() != recorded.numbers.keys():
        return [f"unmatched numbers: {sorted(fresh.numbers.keys() ^ recorded.numbers.keys())}"]
    differing = [
        f"{name}: {value:.4g}, on record {recorded.numbers[name]:.4g}"
        for name, value in fresh.numbers.items()
        if not math.isclose(value, recorded.numbers[name], rel_tol=RELATIVE, abs_tol=ABSOLUTE)
    ]
    if fresh.verdict != recorded.verdict:
        differing.append(f"{fresh.verdict}, on record {recorded.verdict}")
    for sentence, stored in ((fresh.because, recorded.because), (fresh.holds, recorded.holds)):
        if _NUMBER.sub("#", sentence) != _NUMBER.sub("#", stored):
            differing.append(f"{sentence!r}, on record {stored!r}")
    return differing
