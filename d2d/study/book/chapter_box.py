"""The box atop a chapter: what is asked, what is found, its verdicts, the minutes and the needs.

It is MyST Markdown, so that its sentences may cite, refer and hold formulas as the text does.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from d2d.study.book.card import SIGNS, badge, ledger_link
from d2d.study.book.claim import Claim, Evidence, Verdict
from d2d.study.book.thesis_figures import page_of


@dataclass(frozen=True)
class ChapterBox:
    """What a reader wants to know before a chapter; displays itself.

    Attributes
    ----------
    asked, found : tuple of str
        Sentences in MyST Markdown.
    verdicts : dict of str to list of str
        The ids of the chapter's claims by verdict.
    minutes : int
        To read the chapter, without the exercises.
    needs : str
        What a reader should know, in MyST Markdown.
    """

    asked: tuple[str, ...]
    found: tuple[str, ...]
    verdicts: dict[Verdict, list[str]]
    minutes: int
    needs: str

    def __str__(self) -> str:
        """The same without HTML."""
        verdicts = [
            f"{len(ids)} {verdict}: {', '.join(ids)}" for verdict, ids in self.verdicts.items()
        ]
        return "\n".join(
            [
                *(f"Asked: {sentence}" for sentence in self.asked),
                *(f"Found: {sentence}" for sentence in self.found),
                *verdicts,
                f"About {self.minutes} minutes. You need: {self.needs}",
            ]
        )

    __repr__ = __str__

    def _repr_markdown_(self) -> str:
        """A box of Markdown, with blank lines so that its sentences are parsed."""
        claims = sum(map(len, self.verdicts.values()))
        verdicts = [
            f"{len(ids)} {badge(verdict)}: {', '.join(_linked(id) for id in ids)}"
            for verdict, ids in self.verdicts.items()
        ]
        title = f"Its {claims} claims of the thesis" if claims > 1 else "Its claim of the thesis"
        parts = [
            '<div class="chapter-box">',
            _part("What is asked", self.asked),
            _part("What is found", self.found),
            *([_part(title, verdicts)] if verdicts else []),
            f"**What you need:** {self.needs} **Time:** about {self.minutes} minutes.",
            "</div>",
        ]
        return "\n\n".join(parts)


def chapter_box(
    chapter: str,
    claims: Iterable[Claim],
    record: Mapping[str, Evidence],
    *,
    asked: str | Sequence[str],
    found: str | Sequence[str],
    minutes: int,
    needs: str,
) -> ChapterBox:
    """The box of a chapter, with the verdicts of its claims as they are on record.

    Parameters
    ----------
    chapter : str
        The number in the page's file name, "03" or "04a".
    claims : iterable of Claim
        All claims; those on the chapter's sections of the thesis are taken.
    record : mapping of str to Evidence
    asked, found : str or sequence of str
        One sentence, or several; MyST Markdown.
    minutes : int
    needs : str

    Raises
    ------
    ValueError
        If the minutes are not positive.
    """
    if minutes <= 0:
        raise ValueError(f"minutes: expected a positive number, got {minutes}")
    own = [
        claim.id for claim in claims if page_of(claim.section, claim.id).startswith(f"{chapter}_")
    ]
    verdicts = {verdict: [id for id in own if record[id].verdict == verdict] for verdict in SIGNS}
    found_verdicts = {verdict: ids for verdict, ids in verdicts.items() if ids}
    return ChapterBox(_sentences(asked), _sentences(found), found_verdicts, minutes, needs)


def _sentences(text: str | Sequence[str]) -> tuple[str, ...]:
    return (text,) if isinstance(text, str) else tuple(text)


def _part(title: str, sentences: Sequence[str]) -> str:
    if len(sentences) == 1:
        return f"**{title}:** {sentences[0]}"
    listed = "\n".join(f"- {sentence}" for sentence in sentences)
    return f"**{title}**\n\n{listed}"


def _linked(id: str) -> str:
    return ledger_link(id, f"<code>{id}</code>")
