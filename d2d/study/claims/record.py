"""The evidence on record: what the checks found, kept so that the ledger opens at once.

    python -m d2d.study.claims.record [path]

runs every check, which takes some minutes, and writes ``chapters/results/claims.json``. The
tests run every check too, and compare.
"""

import json
import math
import sys
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path

from d2d.study.claims import CLAIMS
from d2d.study.claims.base import Claim, Evidence

PATH = Path("chapters") / "results" / "claims.json"
RELATIVE, ABSOLUTE = 0.05, 0.02


def measure(claims: Iterable[Claim]) -> dict[str, Evidence]:
    """Run the check of each claim."""
    return {claim.id: claim.check() for claim in claims}


def write(path: Path, evidence: Mapping[str, Evidence]) -> None:
    """Write the evidence, its numbers to four significant digits."""
    rounded = {
        key: {
            **asdict(each),
            "numbers": {name: float(f"{value:.4g}") for name, value in each.numbers.items()},
        }
        for key, each in evidence.items()
    }
    path.write_text(json.dumps(rounded, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def read(path: Path) -> dict[str, Evidence]:
    """Read what ``write`` wrote."""
    stored = json.loads(path.read_text(encoding="utf-8"))
    return {key: Evidence(**each) for key, each in stored.items()}


def differences(fresh: Evidence, recorded: Evidence) -> list[str]:
    """Say where fresh evidence is not that on record.

    Numbers may differ by 5 %, or by 0.02: another machine's rounding can send single draws
    elsewhere.
    """
    if fresh.numbers.keys() != recorded.numbers.keys():
        return [f"other numbers: {sorted(fresh.numbers.keys() ^ recorded.numbers.keys())}"]
    found = [
        f"{name}: {value:.4g}, on record {recorded.numbers[name]:.4g}"
        for name, value in fresh.numbers.items()
        if not math.isclose(value, recorded.numbers[name], rel_tol=RELATIVE, abs_tol=ABSOLUTE)
    ]
    if (fresh.verdict, fresh.because) != (recorded.verdict, recorded.because):
        found.append(f"{fresh.verdict}: {fresh.because}")
    return found


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else PATH, measure(CLAIMS.values()))
