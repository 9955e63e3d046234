"""The one place that knows where stored results are.

Results are small tables that take long to compute, or that come from data that cannot be shipped.
They are stored in ``chapters/results/`` of the repository, whatever the working directory.
"""

import json
from pathlib import Path
from typing import Any

_FOLDER = Path(__file__).resolve().parents[2] / "chapters" / "results"


def results_path(name: str) -> Path:
    """Path of the result file ``name``, which need not exist yet."""
    return _FOLDER / name


def read_json(path: Path) -> dict[str, Any]:
    """Read what `write_json` wrote."""
    stored: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return stored


def write_json(path: Path, results: dict[str, Any], digits: int | None = None) -> None:
    """Store results, one number a line, rounded to ``digits``, so that versions can be compared."""
    text = json.dumps(results, indent=1, ensure_ascii=False, default=float)
    if digits is not None:
        rounded = json.loads(text, parse_float=lambda number: float(f"{float(number):.{digits}g}"))
        text = json.dumps(rounded, indent=1, ensure_ascii=False)
    path.write_text(text + "\n", encoding="utf-8")
