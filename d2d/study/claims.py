"""Every claim of the thesis with the check that judges it: ``CLAIMS[id].check()``."""

from collections.abc import Sequence

from d2d.study.book.claim import Claim, Evidence, claims_of, judge
from d2d.study.book.ledger import Cards, ChapterBox, cards, verdicts_of
from d2d.study.book.record import read_record
from d2d.study.drives import claims as drives
from d2d.study.estimation import claims as estimation
from d2d.study.line.claims import clusters as line_clusters
from d2d.study.line.claims import outliers as line_outliers
from d2d.study.line.claims import surfaces
from d2d.study.mixtures import claims as mixtures
from d2d.study.plane.claims import clusters, combined, indices, outliers, overlapped
from d2d.study.point_sets import claims as point_sets

CHAPTERS_2_TO_5 = (mixtures, point_sets, surfaces, line_outliers, line_clusters, estimation)
CHAPTERS_6_AND_7 = (overlapped, outliers, clusters, combined, indices, drives)
CLAIMS: dict[str, Claim] = claims_of(CHAPTERS_2_TO_5 + CHAPTERS_6_AND_7)


def show(*claims: Claim) -> Cards:
    """The cards of claims with the evidence on record; end a cell with it."""
    return cards(claims, read_record())


def chapter_box(
    chapter: str,
    *,
    asked: str | Sequence[str],
    found: str | Sequence[str],
    minutes: int,
    needs: str,
) -> ChapterBox:
    """The box atop a chapter, with the verdicts of its claims as they are on record.

    The chapter is the number in the page's file name, "03" or "04a".  What is asked and found, one
    sentence or several, and what a reader needs to know are MyST Markdown; the minutes are those to
    read the chapter, without the exercises.
    """
    verdicts = verdicts_of(chapter, CLAIMS.values(), read_record())
    return ChapterBox(asked, found, verdicts, minutes, needs)


__all__ = ["CLAIMS", "Claim", "Evidence", "chapter_box", "claims_of", "judge", "show"]
