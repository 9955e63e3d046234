"""The table of verdicts in chapter 1 says what the registry says."""

import re
from pathlib import Path

from d2d.study import CLAIMS

PAGE = Path(__file__).resolve().parents[1] / "chapters" / "01_motivation.md"
ROW = re.compile(
    r"^\| [\d.]+ \| `([a-z0-9-]+)` \| .* \| (confirmed|qualified|refuted) \| .* \|$", re.M
)


def test_every_claim_is_listed_with_its_verdict() -> None:
    """A claim that is added, dropped or judged anew must change the page too."""
    listed = ROW.findall(PAGE.read_text(encoding="utf-8"))
    assert len(listed) == len(dict(listed))
    assert dict(listed) == {claim.id: claim.verdict for claim in CLAIMS.values()}


def test_the_count_in_the_text_is_that_of_the_table() -> None:
    """The sentence above the table counts the verdicts."""
    text = PAGE.read_text(encoding="utf-8")
    verdicts = [claim.verdict for claim in CLAIMS.values()]
    confirmed, qualified, refuted = map(verdicts.count, ("confirmed", "qualified", "refuted"))
    assert (
        f"{len(verdicts)} claims so far, {confirmed} confirmed, {qualified} qualified, "
        f"{refuted} refuted" in text
    )
