"""The README says what the record says."""

import re
from pathlib import Path

from d2d.study.book.ledger import SIGNS
from d2d.study.book.record import read_record

README = Path(__file__).resolve().parents[2] / "README.md"


def test_the_readme_counts_the_verdicts_on_record() -> None:
    """Breaks if a claim is added, dropped or judged anew and the first page stays as it was."""
    verdicts = [evidence.verdict for evidence in read_record().values()]
    counts = re.search(
        r"(\d+) claims: (\d+) hold as they stand, (\d+) under a condition, (\d+) do not",
        README.read_text(encoding="utf-8"),
    )
    assert counts is not None
    assert [*map(int, counts.groups())] == [len(verdicts), *map(verdicts.count, SIGNS)]
