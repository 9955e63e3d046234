"""Every claim of the thesis with the check that judges it: ``CLAIMS[id].check()``."""

from collections.abc import Sequence

from d2d.study.book import chapter_box as box
from d2d.study.book.card import Cards, cards
from d2d.study.book.claim import Claim, Evidence, claims_of, judge
from d2d.study.book.record import read_record
from d2d.study.drives import claims as drives
from d2d.study.estimation import claims as estimation
from d2d.study.line.claims import clusters as line_clusters
from d2d.study.line.claims import outliers as line_outliers
from d2d.study.line.claims import surfaces
from d2d.study.mixtures import claims as mixtures
from d2d.study.plane.claims import clusters, combined, indices, outliers, overlapped
from d2d.study.point_sets import claims as point_sets

CLAIMS: dict[str, Claim] = claims_of(
    (
        mixtures,
        point_sets,
        surfaces,
        line_outliers,
        line_clusters,
        estimation,
        overlapped,
        outliers,
        clusters,
        combined,
        indices,
        drives,
    )
)


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
) -> box.ChapterBox:
    """The box atop a chapter, with its verdicts on record: see `d2d.study.book.chapter_box`."""
    return box.chapter_box(
        chapter,
        CLAIMS.values(),
        read_record(),
        asked=asked,
        found=found,
        minutes=minutes,
        needs=needs,
    )


__all__ = ["CLAIMS", "Claim", "Evidence", "chapter_box", "claims_of", "judge", "show"]
