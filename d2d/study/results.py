"""The one place that knows where stored results are.

Results are small tables that take long to compute, or that come from data that cannot be shipped.
They are stored in ``chapters/results/`` of the repository, whatever the working directory.
"""

from pathlib import Path

_FOLDER = Path(__file__).resolve().parents[2] / "chapters" / "results"


def results_path(name: str) -> Path:
    """Path of the result file ``name``, which need not exist yet."""
    return _FOLDER / name
