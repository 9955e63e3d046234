"""The table of verdicts in chapter 1 says what the registry says."""

import re
from collections import Counter
from pathlib import Path

from d2d.study import CLAIMS
from d2d.study.figures import page

PAGE = Path(__file__).resolve().parents[1] / "chapters" / "01_motivation.md"
CHAPTERS = re.compile(r"<(\d\d[ab]?)_\w+>")
COUNTS = re.compile(r"\| (\d+) \| (\d+) \| (\d+) \|$")
VERDICTS = ("confirmed", "qualified", "refuted")


def test_the_verdicts_of_each_chapter_are_those_of_the_registry() -> None:
    """A claim that is added, dropped or judged anew must change the page too."""
    expected = Counter((page(c.section)[:2], c.verdict) for c in CLAIMS.values())
    listed: Counter[tuple[str, str]] = Counter()
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if (counts := COUNTS.search(line)) and (chapter := CHAPTERS.search(line)):
            for verdict, number in zip(VERDICTS, counts.groups(), strict=True):
                listed[chapter[1][:2], verdict] += int(number)
    assert +listed == expected


def test_the_count_in_the_text_is_that_of_the_registry() -> None:
    """The sentence below the table counts the verdicts."""
    verdicts = [claim.verdict for claim in CLAIMS.values()]
    confirmed, qualified, refuted = map(verdicts.count, VERDICTS)
    assert (
        f"{len(verdicts)} claims: {confirmed} confirmed, {qualified} qualified, {refuted} refuted."
        in PAGE.read_text(encoding="utf-8")
    )
